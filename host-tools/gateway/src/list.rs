//! The desk's list of boxes: its own page, on which the boxes of the ward are shown as those of a desk are.
//!
//! A gateway has its boxes' links, and a desk beside it would contend for them. So the page is served by
//! the desk's own server and library from here, and only shows: whatever would do something with a box is
//! refused.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use plumbline_bedside::keys::KnownBox;
use plumbline_desk::desk::Desk;
use plumbline_desk::http::{For, Server};
use plumbline_desk::wire::{
    BoxState, CheckGrade, Doing as Shown, Examination, LinkState, Live, Problem, TrunkState,
};
use plumbline_files::BadInput;

use crate::overview::{BoxNow, Doing, Hearing, Overview};

/// What is shown changes this often at most: a page gets the state of all boxes each time.
const SHOW_EVERY: Duration = Duration::from_millis(1500);

/// The list, and the server of its page.
pub struct List {
    desk: Arc<Desk>,
    server: Server,
    shown: Option<Instant>,
}

impl List {
    /// Serves the list of these boxes; the desk remembers in the folder who has signed in.
    ///
    /// # Errors
    /// When nobody can listen there, or the folder cannot be used.
    pub fn open(folder: PathBuf, boxes: &[KnownBox], whom: For) -> Result<Self, BadInput> {
        let desk = Arc::new(Desk::showing(folder, boxes)?);
        let server = Server::start(Arc::clone(&desk), whom)?;
        Ok(Self { desk, server, shown: None })
    }

    /// What a person opens.
    #[must_use]
    pub fn url(&self) -> &str {
        &self.server.url
    }

    /// Shows how the boxes are now, if it is time.
    pub fn show(&mut self, overview: &Overview) {
        if self.shown.is_some_and(|at| at.elapsed() < SHOW_EVERY) {
            return;
        }
        self.shown = Some(Instant::now());
        let now_ms = self.desk.hub.now_ms();
        for it in &overview.boxes {
            self.desk.show(&it.id, |state| show(state, it, now_ms));
        }
    }

    /// Ends the page.
    pub fn end(&mut self) {
        self.desk.stop();
        self.server.end();
    }
}

/// A box as the page has it.
fn show(state: &mut BoxState, it: &BoxNow, now_ms: f64) {
    state.name.clone_from(&it.name);
    state.serial_number.clone_from(&it.serial_number);
    let (found, remedy) = it.problem.clone().unwrap_or_default();
    let problem = Problem::new(&it.name, found, remedy);
    state.link = match (it.hearing, &state.link) {
        (Hearing::Heard, _) => {
            let by = it.address.map_or_else(|| "UDP".to_owned(), |at| format!("UDP {at}"));
            LinkState::Heard { by }
        }
        (Hearing::Searching | Hearing::Unknown, LinkState::Searching { since_at_ms, .. }) => {
            LinkState::Searching { since_at_ms: *since_at_ms, problem }
        }
        (Hearing::Searching | Hearing::Unknown, _) => {
            LinkState::Searching { since_at_ms: now_ms, problem }
        }
        (Hearing::Silent, LinkState::Silent { since_at_ms, .. }) => {
            LinkState::Silent { since_at_ms: *since_at_ms, problem }
        }
        (Hearing::Silent, _) => LinkState::Silent { since_at_ms: now_ms, problem },
    };
    state.health.clone_from(&it.health);
    state.doing = match (it.hearing, it.doing) {
        (Hearing::Heard, Doing::Watching) => Shown::Watching,
        (_, Doing::Recording | Doing::Ending) => Shown::Recording,
        _ => Shown::Nothing,
    };
    state.examination = it.examination.as_ref().map(|(_, checks)| {
        let worst = checks.first().map_or(CheckGrade::Skipped, |it| it.verdict);
        let before = state.examination.as_ref().filter(|before| before.checks == *checks);
        Examination {
            at_ms: before.map_or(now_ms, |before| before.at_ms),
            worst,
            checks: checks.clone(),
        }
    });
    state.live = (it.hearing == Hearing::Heard).then(|| live(it));
}

/// What comes from a box now; its movement is not followed here.
fn live(it: &BoxNow) -> Live {
    let trunk = || TrunkState {
        missing: "not followed by the gateway".to_owned(),
        ..TrunkState::default()
    };
    Live {
        rate_hz: it.rate_hz,
        frames: it.counts.frames,
        lost: it.counts.lost,
        arrival_ms: it.latency_ms,
        clock_error_ms: None,
        screen_ms: None,
        judgement: None,
        reasons: Vec::new(),
        upper: trunk(),
        lower: trunk(),
        time: it.trial.as_ref().map(|trial| format!("trial {trial}")).unwrap_or_default(),
        counts: Vec::new(),
    }
}
