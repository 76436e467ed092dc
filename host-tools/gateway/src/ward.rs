//! The thread that receives from all boxes: it hands each what has come for it, carries out commands, and
//! tells how everything is.

use std::cell::RefCell;
use std::net::SocketAddr;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use plumbline::seal::KeyId;
use plumbline_bedside::keys::{KnownBox, Store};
use plumbline_desk::wire::CheckGrade;
use plumbline_stream::transport::{self, Link, Memory, Udp};

use crate::bed::{Around, Bed, utc};
use crate::commands::{Asked, Command};
use crate::judge::Judge;
use crate::notices::Notices;
use crate::outbox::Outbox;
use crate::overview::{BoxNow, Doing, Hearing, Overview};
use crate::payload;
use crate::post::Post;
use crate::settings::Settings;
use crate::topics::{About, Topics, levels};

/// The longest wait for datagrams, and between two turns of a box: so often what is missing is asked for.
const TURN_EVERY: Duration = Duration::from_millis(20);

/// The states of boxes are looked at this often.
const TELL_EVERY: Duration = Duration::from_secs(1);

/// At the end, trials wait no longer than this for what was lost on the way.
const ENDS_WITHIN: Duration = Duration::from_secs(5);

/// What the receiving thread has.
pub(crate) struct Ward {
    pub known: Vec<KnownBox>,
    pub always: Vec<usize>,
    pub asked: Receiver<Asked>,
    pub topics: Topics,
    pub judge: Judge,
    pub settings: Settings,
    pub store: Store,
    pub outbox: Arc<Outbox>,
    pub notices: Arc<Notices>,
    pub overview: Arc<Mutex<Overview>>,
    pub stop: Arc<AtomicBool>,
}

/// What was published of a box.
#[derive(Debug, Clone, Default)]
struct Told {
    state: String,
    examination: String,
    health_at: Option<Instant>,
}

/// Where a link's box is, for the post and for the store.
struct Met {
    at: Rc<RefCell<Option<SocketAddr>>>,
    store: SyncSender<(KeyId, SocketAddr)>,
}

impl Memory for Met {
    fn met_at(&mut self, key_id: KeyId, address: SocketAddr) {
        *self.at.borrow_mut() = Some(address);
        // The store is a convenience: a box that is not noted announces itself.
        let _ = self.store.try_send((key_id, address));
    }

    fn take_start(&mut self, _: KeyId, _: u32) -> bool {
        // Lines without a way back are serial ones.
        false
    }
}

impl Ward {
    /// Receives until it is told to stop.
    pub fn run(self, udp: Udp) {
        let Self {
            known,
            always,
            asked,
            topics,
            judge,
            settings,
            store,
            outbox,
            notices,
            overview,
            stop,
        } = self;
        let levels = levels(&known);
        let addresses: Vec<_> = known.iter().map(|it| (it.key.id(), it.address)).collect();
        let mut post = Post::new(udp, &addresses);
        let (noted, note) = sync_channel(2 * known.len());
        // A disk may take its time, and nothing waits for it here.
        let noting = std::thread::spawn({
            let notices = Arc::clone(&notices);
            move || note_addresses(&store, &note, &notices)
        });
        let mut beds: Vec<Bed> = Vec::with_capacity(known.len());
        for (place, (level, it)) in levels.iter().zip(&known).enumerate() {
            let met = Rc::<RefCell<_>>::default();
            let memory = Met { at: Rc::clone(&met), store: noted.clone() };
            let the_box =
                transport::KnownBox { name: it.title(), key: it.key.clone(), address: it.address };
            let link = Link::new(post.letterbox(place), vec![the_box], &settings.program);
            let link = link.remembering(Box::new(memory));
            let mut bed = Bed::new(level.clone(), it, link, met);
            bed.records_always = always.contains(&place);
            beds.push(bed);
        }
        let around = Around {
            trials: settings.folder.join("trials"),
            due: settings.folder.join("due"),
            judge,
            notices: Arc::clone(&notices),
            lasts: settings.lasts,
            place: format!("UDP {}", settings.udp),
        };
        let started = utc();
        outbox.state(
            topics.gateway_state(),
            gateway_state("online", Some(&started), &levels),
            None,
        );
        let mut teller = Teller {
            told: vec![Told::default(); beds.len()],
            topics,
            outbox,
            overview,
            every: settings.every,
            health_at: None,
            tell_at: Instant::now(),
        };
        let mut sweep_at = Instant::now();
        let mut ends_at: Option<Instant> = None;
        loop {
            let touched = match post.poll(TURN_EVERY) {
                Ok(touched) => touched,
                Err(error) => {
                    notices.say(format!("error: {error}"));
                    stop.store(true, Ordering::Relaxed);
                    Vec::new()
                }
            };
            let now = Instant::now();
            let is_sweep = now >= sweep_at;
            if is_sweep {
                sweep_at = now + TURN_EVERY;
                for words in post.take_notices() {
                    notices.say(words);
                }
                for one in asked.try_iter() {
                    carry_out(one, &mut beds, &around, &teller.outbox);
                }
            }
            let all = 0..beds.len();
            let places: Vec<usize> = if is_sweep { all.collect() } else { touched };
            for place in places {
                if let Some(address) = beds[place].turn(&around) {
                    post.heard(place, address, now);
                }
            }
            teller.tell(&mut beds, &post, &around, now);
            if stop.load(Ordering::Relaxed) {
                let give_up = *ends_at.get_or_insert_with(|| {
                    for bed in &mut beds {
                        bed.records_always = false;
                        bed.stop();
                    }
                    now + ENDS_WITHIN
                });
                if beds.iter().all(|it| it.trial().is_none()) || now >= give_up {
                    break;
                }
            }
        }
        // Boxes are told, and trials that are still open are cut off: they are judged after the next start.
        teller.leave(&mut beds, &levels);
        drop(beds);
        drop(noted);
        let _ = noting.join();
        let counts = Arc::clone(&around.judge.counts);
        around.judge.end();
        teller.judged(&counts);
    }
}

fn note_addresses(store: &Store, note: &Receiver<(KeyId, SocketAddr)>, notices: &Notices) {
    for (id, address) in note {
        if let Err(error) = store.note_address(id, address) {
            notices.say(format!("warning: where a box is was not noted: {error}"));
        }
    }
}

/// Carries out a command.
fn carry_out(asked: Asked, beds: &mut [Bed], around: &Around, outbox: &Outbox) {
    let Some(bed) = beds.iter_mut().find(|it| it.level == asked.level) else {
        return asked.refuse(outbox, "no such box", "the gateway's state lists those it knows");
    };
    match asked.command.clone() {
        Command::Start { name, seconds } => {
            let lasts = Command::lasts(seconds, around.lasts);
            match bed.start(name, lasts, around) {
                Ok(trial) => {
                    around.notices.say(format!("{}: trial {trial} begins, by command", bed.level));
                    asked.done(outbox, &trial);
                }
                Err((found, remedy)) => asked.refuse(outbox, &found, &remedy),
            }
        }
        Command::Stop { trial } => {
            let is_other = trial.is_some() && trial.as_deref() != bed.trial();
            if bed.trial().is_none() || is_other {
                return asked.refuse(
                    outbox,
                    "that trial is not being recorded",
                    "see the box's state",
                );
            }
            // Whoever stops a box that is always recorded does not want the next trial either.
            bed.records_always = false;
            if let Some(trial) = bed.stop() {
                asked.done(outbox, &trial);
            }
        }
    }
}

/// Publishes how everything is.
struct Teller {
    told: Vec<Told>,
    topics: Topics,
    outbox: Arc<Outbox>,
    overview: Arc<Mutex<Overview>>,
    every: Duration,
    health_at: Option<Instant>,
    tell_at: Instant,
}

impl Teller {
    /// A health expires when three of them did not come.
    fn expires_s(&self) -> Option<u32> {
        u32::try_from(3 * self.every.as_secs().max(1)).ok()
    }

    fn tell(&mut self, beds: &mut [Bed], post: &Post, around: &Around, now: Instant) {
        if now < self.tell_at {
            return;
        }
        self.tell_at = now + TELL_EVERY;
        let boxes: Vec<BoxNow> = beds.iter_mut().map(|it| it.now(now)).collect();
        let (expires_s, at) = (self.expires_s(), utc());
        for (it, told) in boxes.iter().zip(&mut self.told) {
            let topic = |about| self.topics.of_box(&it.level, about);
            let state = json(&payload::State::of(it));
            if state != told.state {
                self.outbox.state(topic(About::State), state.clone(), None);
                told.state = state;
            }
            if let Some(examination) = examination(it)
                && examination != told.examination
            {
                self.outbox.state(topic(About::Examination), examination.clone(), None);
                told.examination = examination;
            }
            let is_due = told.health_at.is_none_or(|at| now >= at);
            if is_due
                && it.hearing == Hearing::Heard
                && let Some(health) = payload::Health::of(it, &at)
            {
                told.health_at = Some(now + self.every);
                self.outbox.state(topic(About::Health), json(&health), expires_s);
            }
        }
        let counts = &around.judge.counts;
        let (datagrams_unknown, datagrams_dropped) = post.counts();
        let overview = Overview {
            boxes,
            standing: self.outbox.standing(),
            broker: self.outbox.counts(),
            waiting: self.outbox.waiting(),
            trials_begun: counts.begun.load(Ordering::Relaxed),
            trials_judged: counts.judged.load(Ordering::Relaxed),
            trials_waiting: counts.waiting.load(Ordering::Relaxed),
            datagrams_unknown,
            datagrams_dropped,
            datagrams_dropped_by_system: post.dropped_here(),
        };
        if self.health_at.is_none_or(|at| now >= at) {
            self.health_at = Some(now + self.every);
            let health = payload::GatewayHealth::of(&overview, &at);
            self.outbox.state(self.topics.gateway_health(), json(&health), expires_s);
        }
        *self.overview.lock().unwrap_or_else(PoisonError::into_inner) = overview;
    }

    /// The gateway ends, and will not know how boxes are.
    fn leave(&self, beds: &mut [Bed], levels: &[String]) {
        let at = utc();
        let mut boxes = Vec::with_capacity(beds.len());
        for bed in beds {
            let it = bed.now(Instant::now());
            let problem = ("the gateway was ended".to_owned(), "start it again".to_owned());
            let it = BoxNow {
                hearing: Hearing::Unknown,
                since: at.clone(),
                doing: Doing::Watching,
                trial: None,
                problem: Some(problem),
                ..it
            };
            let topic = self.topics.of_box(&it.level, About::State);
            self.outbox.state(topic, json(&payload::State::of(&it)), None);
            boxes.push(it);
        }
        self.overview.lock().unwrap_or_else(PoisonError::into_inner).boxes = boxes;
        let state = gateway_state("offline", Some(&at), levels);
        self.outbox.state(self.topics.gateway_state(), state, None);
    }

    /// The trials that were judged at the end.
    fn judged(&self, counts: &crate::judge::Counts) {
        let mut overview = self.overview.lock().unwrap_or_else(PoisonError::into_inner);
        overview.trials_judged = counts.judged.load(Ordering::Relaxed);
        overview.trials_waiting = counts.waiting.load(Ordering::Relaxed);
        overview.waiting = self.outbox.waiting();
        overview.broker = self.outbox.counts();
    }
}

/// What is published of the gateway itself.
pub(crate) fn gateway_state(is: &str, since: Option<&str>, boxes: &[String]) -> String {
    json(&payload::GatewayState { is, version: env!("CARGO_PKG_VERSION"), since, boxes })
}

fn json(it: &impl serde::Serialize) -> String {
    // Texts and numbers are JSON.
    serde_json::to_string(it).unwrap_or_default()
}

/// What the doctor found, as it is published.
fn examination(it: &BoxNow) -> Option<String> {
    let (at, checks) = it.examination.as_ref()?;
    let is_amiss = |grade| matches!(grade, CheckGrade::Warn | CheckGrade::Fail);
    let amiss = checks.iter().filter(|check| is_amiss(check.verdict)).collect();
    let good = checks.iter().filter(|check| check.verdict == CheckGrade::Good).count();
    Some(json(&payload::Examination { at, amiss, good }))
}
