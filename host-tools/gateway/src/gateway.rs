//! The gateway: one thread that receives from all boxes, one that judges, one for the broker.

use std::cell::RefCell;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plumbline::seal::KeyId;
use plumbline_bedside::keys::{KnownBox, Store};
use plumbline_desk::wire::CheckGrade;
use plumbline_files::BadInput;
use plumbline_stream::transport::{self, Link, Memory, Udp};

use crate::bed::{Around, Bed, utc};
use crate::broker::{self, Courier};
use crate::commands::{self, Asked, Command};
use crate::judge::Judge;
use crate::notices::Notices;
use crate::outbox::Outbox;
use crate::overview::{BoxNow, Doing, Hearing, Overview};
use crate::payload;
use crate::post::Post;
use crate::topics::{About, Topics, levels};

/// The longest wait for datagrams, and between two turns of a box: so often what is missing is asked for.
const TURN_EVERY: Duration = Duration::from_millis(20);

/// The states of boxes are looked at this often.
const TELL_EVERY: Duration = Duration::from_secs(1);

/// At the end, trials wait no longer than this for what was lost on the way.
const ENDS_WITHIN: Duration = Duration::from_secs(5);

/// At the end, the broker gets what waits within this time; what is kept on the disk stays there.
const LEAVES_WITHIN: Duration = Duration::from_secs(3);

/// For each box, so many trials can wait for their verdict.
const WAITING_PER_BOX: usize = 4;

/// Which boxes are recorded always.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Recorded {
    /// None, unless it is commanded.
    #[default]
    None,
    /// These, by their names, serial numbers or keys.
    These(Vec<String>),
    /// All of them.
    All,
}

/// What the gateway is to do.
#[derive(Clone)]
pub struct Settings {
    /// Where trials are kept, and what waits for the broker; it is made where there is none.
    pub folder: PathBuf,
    /// Where boxes announce themselves to this computer.
    pub udp: SocketAddr,
    /// What this program is called at boxes.
    pub program: String,
    /// The ward's name in topics.
    pub ward: String,
    /// The broker.
    pub broker: broker::Settings,
    /// Whether commands are taken from the broker.
    pub commands: bool,
    /// Which boxes are recorded without a command.
    pub record: Recorded,
    /// How long a trial lasts, unless a command says otherwise.
    pub lasts: Duration,
    /// Whether the names of trials are published.
    pub names: bool,
    /// Healths are published this often.
    pub every: Duration,
}

/// A gateway that runs.
pub struct Gateway {
    overview: Arc<Mutex<Overview>>,
    notices: Arc<Notices>,
    outbox: Arc<Outbox>,
    stop: Arc<AtomicBool>,
    hurry: Arc<AtomicBool>,
    leave: Arc<AtomicBool>,
    ward: Option<JoinHandle<()>>,
    broker: Option<JoinHandle<()>>,
    boxes: Vec<KnownBox>,
}

impl Gateway {
    /// Starts it, for all boxes whose keys are known on this computer.
    ///
    /// # Errors
    /// When there is no key, or the folder, the address or a box that is named cannot be used.
    pub fn start(settings: Settings) -> Result<Self, BadInput> {
        let notices = Arc::<Notices>::default();
        let store = Store::open()?;
        let known = store.all()?;
        for refused in &known.refused {
            notices.say(format!("warning: {refused}"));
        }
        let known = known.known;
        if known.is_empty() {
            return Err(BadInput::whole(
                store.folder().display(),
                "no key of a box is known here, and a box talks to nobody else",
                "bring the keys of the ward's boxes with `plumb keys import`",
            ));
        }
        let always = always(&store, &settings.record, &known)?;
        let udp = Udp::bind(settings.udp)?;
        plumbline_files::make_directory(&settings.folder)?;
        let outbox = Outbox::open(settings.folder.join("outbox"), Arc::clone(&notices))?;
        let outbox = Arc::new(outbox);
        let topics = Topics::new(&settings.ward);
        let [stop, hurry, leave]: [Arc<AtomicBool>; 3] = Default::default();
        let judge = Judge::start(
            settings.folder.join("due"),
            topics.clone(),
            (Arc::clone(&outbox), Arc::clone(&notices)),
            settings.names,
            WAITING_PER_BOX * known.len(),
            Arc::clone(&hurry),
        )?;
        let (sender, asked) = sync_channel(commands::WAITING_MAX);
        let overview = Arc::new(Mutex::new(Overview {
            boxes: Vec::new(),
            standing: outbox.standing(),
            broker: outbox.counts(),
            waiting: outbox.waiting(),
            trials_begun: 0,
            trials_judged: 0,
            trials_waiting: 0,
            datagrams_unknown: 0,
            datagrams_dropped: 0,
            datagrams_dropped_by_system: None,
        }));
        let broker = courier(&settings, &topics, &outbox, &notices, &leave, sender).start()?;
        let boxes = known.clone();
        let ward = Ward {
            known,
            always,
            asked,
            topics,
            judge,
            settings,
            store,
            outbox: Arc::clone(&outbox),
            notices: Arc::clone(&notices),
            overview: Arc::clone(&overview),
            stop: Arc::clone(&stop),
        };
        let ward = std::thread::Builder::new()
            .name("ward".to_owned())
            .spawn(move || ward.run(udp))
            .map_err(|error| BadInput::io("a thread for the boxes", &error))?;
        let (ward, broker) = (Some(ward), Some(broker));
        Ok(Self { overview, notices, outbox, stop, hurry, leave, ward, broker, boxes })
    }

    /// The boxes whose keys it knows.
    #[must_use]
    pub fn boxes(&self) -> &[KnownBox] {
        &self.boxes
    }

    /// How everything is.
    #[must_use]
    pub fn overview(&self) -> Overview {
        self.overview.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What has happened since the last call.
    #[must_use]
    pub fn take_notices(&self) -> Vec<String> {
        self.notices.take()
    }

    /// It is to end: trials are ended, judged and kept.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// It is to end at once: what has no verdict yet gets one after the next start.
    pub fn hurry(&self) {
        self.hurry.store(true, Ordering::Relaxed);
    }

    /// Whether everything has ended but the connection to the broker.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.ward.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Gives the broker what waits, says goodbye to it, and waits for the end of everything.
    pub fn end(&mut self) {
        self.stop();
        if let Some(ward) = self.ward.take() {
            // A thread that has panicked has said so.
            let _ = ward.join();
        }
        let Some(broker) = self.broker.take() else { return };
        let give_up = Instant::now() + LEAVES_WITHIN;
        let is_up = || matches!(self.outbox.standing(), crate::outbox::Standing::Up(_));
        while is_up() && !self.outbox.is_empty() && Instant::now() < give_up {
            std::thread::sleep(TURN_EVERY);
        }
        self.leave.store(true, Ordering::Relaxed);
        self.outbox.leave();
        while !broker.is_finished() && Instant::now() < give_up + LEAVES_WITHIN {
            std::thread::sleep(TURN_EVERY);
        }
        if broker.is_finished() {
            let _ = broker.join();
        }
    }
}

impl Drop for Gateway {
    fn drop(&mut self) {
        self.hurry();
        self.end();
    }
}

/// The places of the boxes that are recorded always.
fn always(store: &Store, record: &Recorded, known: &[KnownBox]) -> Result<Vec<usize>, BadInput> {
    match record {
        Recorded::None => Ok(Vec::new()),
        Recorded::All => Ok((0..known.len()).collect()),
        Recorded::These(names) => {
            let mut places = Vec::new();
            for name in names {
                let found = store.find(name)?;
                places.extend(known.iter().position(|it| it.key == found.key));
            }
            Ok(places)
        }
    }
}

fn courier(
    settings: &Settings,
    topics: &Topics,
    outbox: &Arc<Outbox>,
    notices: &Arc<Notices>,
    leave: &Arc<AtomicBool>,
    sender: SyncSender<Asked>,
) -> Courier {
    let will = gateway_state("offline", None, &[]);
    Courier {
        settings: settings.broker.clone(),
        client_id: format!("plumbline-gateway-{}", settings.ward),
        topics: topics.clone(),
        will,
        outbox: Arc::clone(outbox),
        notices: Arc::clone(notices),
        asked: settings.commands.then_some(sender),
        stop: Arc::clone(leave),
    }
}

fn gateway_state(is: &str, since: Option<&str>, boxes: &[String]) -> String {
    let state = payload::GatewayState { is, version: env!("CARGO_PKG_VERSION"), since, boxes };
    serde_json::to_string(&state).unwrap_or_default()
}

/// What the receiving thread has.
struct Ward {
    known: Vec<KnownBox>,
    always: Vec<usize>,
    asked: Receiver<Asked>,
    topics: Topics,
    judge: Judge,
    settings: Settings,
    store: Store,
    outbox: Arc<Outbox>,
    notices: Arc<Notices>,
    overview: Arc<Mutex<Overview>>,
    stop: Arc<AtomicBool>,
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
    fn run(self, udp: Udp) {
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
