//! What a station shows to the rest of the desk.

use std::net::SocketAddr;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use plumbline_bedside::Told;
use plumbline_stream::transport::HeardElsewhere;

use crate::frames::Frames;
use crate::hub::Hub;
use crate::wire::{BoxState, Can, Doing, Job, LinkState, Notice, Problem, Reference, SettingsView};
use crate::words::on_page;

/// The notices that are kept.
const NOTICES_MAX: usize = 20;

/// The announcements that wait for a link.
const ANNOUNCEMENTS_MAX: usize = 8;

/// A picture of the camera, and its number.
pub type Picture = (u32, Arc<[u8]>);

/// A station, as everybody but its own thread has it.
#[derive(Debug)]
pub struct Shared {
    /// The desk's clock and news.
    pub hub: Arc<Hub>,
    /// The latest frames.
    pub frames: Frames,
    state: Mutex<BoxState>,
    picture: Mutex<Option<Picture>>,
    /// What the box runs with, once it has told.
    settings: Mutex<Option<SettingsView>>,
    /// Where the box announces itself.
    announced: Mutex<Option<SocketAddr>>,
    /// To the link that is open.
    announcements: Mutex<Option<SyncSender<HeardElsewhere>>>,
    /// From exposure to pixels, as pages have reported.
    screen_ms: Mutex<Vec<f64>>,
}

/// The latest reports of pages that count.
const SCREEN_REPORTS_MAX: usize = 300;

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What is in them is whole after every statement.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// A box that is not heard yet.
    pub fn new(hub: Arc<Hub>, id: String, name: String, serial_number: Option<String>) -> Self {
        let link = LinkState::Searching {
            since_at_ms: hub.now_ms(),
            problem: Problem::new(&name, "not heard yet", "switch it on"),
        };
        let state = BoxState {
            id,
            name,
            serial_number,
            has_card: false,
            link,
            hello: None,
            health: None,
            doing: Doing::Nothing,
            job: None,
            failed: None,
            can: Vec::new(),
            notices: Vec::new(),
            examination: None,
            aim: None,
            photographs: None,
            calibration: None,
            scene: None,
            session: None,
            live: None,
            reference: Reference::default(),
        };
        Self {
            hub,
            frames: Frames::default(),
            state: Mutex::new(state),
            picture: Mutex::default(),
            settings: Mutex::default(),
            announced: Mutex::default(),
            announcements: Mutex::default(),
            screen_ms: Mutex::default(),
        }
    }

    /// The box's id.
    pub fn id(&self) -> String {
        locked(&self.state).id.clone()
    }

    /// The state now.
    pub fn state(&self) -> BoxState {
        locked(&self.state).clone()
    }

    /// Whether an action is possible.
    pub fn can(&self, what: Can) -> bool {
        locked(&self.state).can.contains(&what)
    }

    /// From where movement is drawn.
    pub fn reference(&self) -> Reference {
        locked(&self.state).reference
    }

    /// Changes the state, and says so if it is another one then.
    pub fn update(&self, change: impl FnOnce(&mut BoxState)) {
        let mut state = locked(&self.state);
        let before = state.clone();
        change(&mut state);
        let is_changed = *state != before;
        drop(state);
        if is_changed {
            self.hub.changed();
        }
    }

    /// Shows something that happened.
    pub fn notice(&self, is_warning: bool, words: impl Into<String>) {
        let words = on_page(&words.into());
        let notice = Notice { at_ms: self.hub.now_ms(), is_warning, words };
        self.update(|state| {
            if state.notices.len() == NOTICES_MAX {
                state.notices.remove(0);
            }
            state.notices.push(notice);
        });
    }

    /// Shows what a step says.
    pub fn told(&self, told: Told) {
        match told {
            Told::Waiting(words) => {
                let since_at_ms = self.hub.now_ms();
                let words = on_page(&words);
                self.update(|state| state.job = Some(Job { words, since_at_ms, share: None }));
            }
            Told::Done => self.update(|state| state.job = None),
            Told::Note(words) => self.notice(false, words),
            Told::Warning(words) => self.notice(true, words),
        }
    }

    /// Whether the files for its card can be fetched.
    pub fn show_card(&self, has_card: bool) {
        self.update(|state| state.has_card = has_card);
    }

    /// The box has told what it runs with.
    pub fn set_settings(&self, settings: SettingsView) {
        *locked(&self.settings) = Some(settings);
    }

    /// What the box runs with.
    pub fn settings(&self) -> Option<SettingsView> {
        locked(&self.settings).clone()
    }

    /// Shows another picture, under the next number.
    pub fn show_picture(&self, file: Vec<u8>) -> u32 {
        let mut picture = locked(&self.picture);
        let number = picture.as_ref().map_or(1, |(number, _)| number.wrapping_add(1).max(1));
        *picture = Some((number, file.into()));
        number
    }

    /// The latest picture.
    pub fn picture(&self) -> Option<Picture> {
        locked(&self.picture).clone()
    }

    /// The camera's picture is nobody's concern any more.
    pub fn forget_picture(&self) {
        if let Some((_, file)) = &mut *locked(&self.picture) {
            *file = Arc::new([]);
        }
    }

    /// The box has announced itself from here, in this datagram.
    pub fn set_announced(&self, address: SocketAddr, datagram: &[u8]) {
        *locked(&self.announced) = Some(address);
        if let Some(link) = &*locked(&self.announcements) {
            // Where the link does not take them, there is no hurry: the box says so again.
            let _ = link.try_send((address, datagram.to_vec()));
        }
    }

    /// Its announcements from now on, for the link that is opened.
    pub fn announcements(&self) -> Receiver<HeardElsewhere> {
        let (sender, receiver) = sync_channel(ANNOUNCEMENTS_MAX);
        *locked(&self.announcements) = Some(sender);
        receiver
    }

    /// From where it has announced itself last.
    pub fn announced(&self) -> Option<SocketAddr> {
        *locked(&self.announced)
    }

    /// A page has drawn a frame this long after its exposure.
    pub fn drawn(&self, screen_ms: f64) {
        if !screen_ms.is_finite() || !(0.0..=60_000.0).contains(&screen_ms) {
            return;
        }
        let mut reports = locked(&self.screen_ms);
        if reports.len() == SCREEN_REPORTS_MAX {
            reports.remove(0);
        }
        reports.push(screen_ms);
    }

    /// From exposure to pixels: the median and the largest of the latest reports.
    pub fn screen_ms(&self) -> Option<[f64; 2]> {
        let mut reports = locked(&self.screen_ms).clone();
        reports.sort_by(f64::total_cmp);
        let largest = *reports.last()?;
        Some([reports[reports.len() / 2], largest].map(|it| (10.0 * it).round() / 10.0))
    }

    /// The desk's clock at a moment.
    pub fn ms(&self, at: Instant) -> f64 {
        self.hub.ms(at)
    }
}
