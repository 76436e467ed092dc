//! A station: a thread that has one box, and does with it whatever the pages ask for.
//!
//! ```text
//!             ┌──────────────── the link is lost ───────────────┐
//!             ▼                                                 │
//!  look for the box ─▶ meet it ─▶ watch ─┬─▶ examine ─▶ watch ──┤
//!                                        ├─▶ aim: pictures, photographs, exposure ─▶ watch
//!                                        ├─▶ deliver, set up, measure the scene, store it ─▶ meet it
//!                                        └─▶ record a trial of its session ─▶ watch
//! ```
//!
//! It does so by the libraries of the command line. Nothing waits for a page: pages see
//! [`Shared`], and send [`Order`]s through a bounded queue. Whatever happens to one box, the others'
//! stations do not notice.

mod aim;
mod can;
mod fit;
mod jobs;
mod meet;
mod orders;
mod photographs;
mod record;
mod session;
mod shared;
pub(crate) mod show;
mod watch;

use std::cell::RefCell;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use plumbline::config::Config;
use plumbline::packet::Hello;
use plumbline_bedside::box_settings::BoxSettings;
use plumbline_bedside::scene::{Measured, Seen};
use plumbline_files::BadInput;
use plumbline_publish::lsl::Lsl;
use plumbline_publish::{MarkFeed, Publisher, Ways};
use plumbline_stream::link::BoxLink;
use tokio::sync::oneshot;

use crate::marks::MarkBoard;
use crate::memory::Memory;
use crate::wire::{Doing, LinkState, Problem};

pub use fit::PLOT;
pub use orders::{Envelope, Order, Refusal};
pub use shared::Shared;

use self::can::Stage;
use self::fit::Fitting;
use self::photographs::PhotoSet;
use self::session::Open;

/// The orders that can wait.
const ORDERS_MAX: usize = 32;

/// A box that is looked for is listened for this long at a time, so that orders are answered.
const LISTEN: Duration = Duration::from_millis(200);

/// A link that failed is opened again after this time.
const AGAIN_AFTER: Duration = Duration::from_secs(1);

/// The state is shown anew this often.
const SHOW_EVERY: Duration = Duration::from_millis(200);

/// What a station needs beside its box.
#[derive(Debug, Clone)]
pub struct Around {
    /// Where photographs and studies are kept.
    pub folder: PathBuf,
    /// What this program is called at boxes.
    pub program: String,
    /// The streams for other programs.
    pub ways: Ways,
    /// The library of the Lab Streaming Layer, where it is needed.
    pub lsl: Option<Lsl>,
    /// Marks of other programs.
    pub marks: Arc<MarkBoard>,
    /// Which sessions go on.
    pub memory: Arc<Memory>,
}

/// Which box a station is for, and how it is reached.
#[derive(Debug, Clone)]
pub enum Reach {
    /// The box whose key has this identity, over a network.
    Udp(String),
    /// Whatever box is at this serial device.
    Serial {
        /// Its path.
        device: String,
        /// Bits per second.
        baud: u32,
    },
}

/// A station that runs.
#[derive(Debug)]
pub struct Station {
    /// What it shows.
    pub shared: Arc<Shared>,
    orders: SyncSender<Envelope>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Station {
    /// Starts the thread.
    ///
    /// # Errors
    /// When the system gives none.
    pub fn start(shared: Arc<Shared>, reach: Reach, around: Around) -> Result<Self, BadInput> {
        let (orders, inbox) = sync_channel(ORDERS_MAX);
        let own = Arc::clone(&shared);
        let thread = thread::Builder::new()
            .name(format!("box {}", shared.id()))
            .spawn(move || Worker::new(own, reach, around, inbox).run())
            .map_err(|error| BadInput::io("a thread for a box", &error))?;
        Ok(Self { shared, orders, thread: Mutex::new(Some(thread)) })
    }

    /// A box that another part of the program has: it is shown, and takes no orders.
    #[must_use]
    pub fn shown(shared: Arc<Shared>) -> Self {
        let (orders, _) = sync_channel(0);
        Self { shared, orders, thread: Mutex::new(None) }
    }

    /// Hands over an order; its answer comes when it was carried out, or has begun.
    ///
    /// # Errors
    /// When it is not possible now, or too many wait.
    pub fn order(&self, order: Order) -> Result<oneshot::Receiver<Result<(), Refusal>>, Refusal> {
        let needs = order.needs();
        if !self.shared.can(needs) {
            return Err(can::not_now(&self.shared.state(), needs));
        }
        let (answer, answered) = oneshot::channel();
        self.orders.try_send(Envelope { order, answer }).map_err(|error| {
            let found = match error {
                TrySendError::Full(_) => "too many orders wait",
                TrySendError::Disconnected(_) => "the desk is being ended",
            };
            Refusal { status: 503, problem: Problem::new("the box", found, "try again") }
        })?;
        Ok(answered)
    }

    /// Waits for the end of its thread, which ends when the desk does.
    pub fn join(&self) {
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(thread) = thread {
            // A thread that has panicked has said so.
            let _ = thread.join();
        }
    }
}

/// What is done next with a link.
#[derive(Debug)]
enum Next {
    /// Who is it?
    Meet,
    Watch,
    Job(Job),
    /// Set-up mode, and what was asked for with it.
    Aim(Order),
    Record,
    /// The link is opened anew.
    Reopen,
}

/// What is done with a link in one go.
#[derive(Debug)]
enum Job {
    Examine,
    Deliver(crate::wire::CalibrationDeliver),
    Measure(crate::wire::SceneMeasure),
    StoreScene,
    Settings(BoxSettings),
}

/// The thread's own.
struct Worker {
    shared: Arc<Shared>,
    reach: Reach,
    around: Around,
    inbox: Receiver<Envelope>,
    publisher: Option<Rc<RefCell<Publisher>>>,
    mark_feed: Option<MarkFeed>,
    /// The zero of the publisher's times.
    zero: Instant,
    /// The stage, by which it is decided what is possible.
    stage: Stage,
    hello: Option<Hello>,
    config: Option<Config>,
    /// Where the link was opened to.
    called_at: Option<SocketAddr>,
    show_at: Instant,
    /// The newest frame that the reference has.
    referred: u64,
    /// The frames of the reference that is being taken.
    reference: Option<watch::Referencing>,
    examined: Option<(Instant, u32, Vec<plumbline_bedside::doctor::Check>)>,
    /// When the box was to be examined last.
    examine_tried: Option<Instant>,
    photographs: Option<PhotoSet>,
    fitting: Option<Fitting>,
    calibrated: Option<plumbline_bedside::calibration::Calibrated>,
    measured: Option<(Measured, Seen)>,
    session: Option<Open>,
}

impl Worker {
    fn new(shared: Arc<Shared>, reach: Reach, around: Around, inbox: Receiver<Envelope>) -> Self {
        let now = Instant::now();
        Self {
            shared,
            reach,
            around,
            inbox,
            publisher: None,
            mark_feed: None,
            zero: now,
            stage: Stage::Away,
            hello: None,
            config: None,
            called_at: None,
            show_at: now,
            referred: 0,
            reference: None,
            examined: None,
            examine_tried: None,
            photographs: None,
            fitting: None,
            calibrated: None,
            measured: None,
            session: None,
        }
    }

    fn run(mut self) {
        if let Err(error) = self.publish() {
            self.shared.notice(true, error.to_string());
        }
        self.resume_latest();
        while !self.is_over() {
            let result = self.open().and_then(|link| self.stay(link));
            if let Err(error) = result {
                self.fail(error);
            }
            self.enter(Stage::Away);
            let until = Instant::now() + AGAIN_AFTER;
            while Instant::now() < until && !self.is_over() {
                self.beat();
                thread::sleep(LISTEN / 4);
            }
        }
        self.session = None;
        drop(self.fitting.take());
        if let Some(publisher) = self.publisher.take().and_then(Rc::into_inner) {
            for words in publisher.into_inner().finish() {
                self.shared.notice(false, words);
            }
        }
    }

    fn is_over(&self) -> bool {
        self.shared.hub.is_over()
    }

    /// Begins to publish: to the desk's own pages, and to whoever was asked for.
    fn publish(&mut self) -> Result<(), BadInput> {
        let begun = Instant::now();
        let mut publisher = Publisher::new(begun, true);
        let shared = Arc::clone(&self.shared);
        publisher
            .add_own("the desk", move |items| shared.frames.follow(&items, &shared.hub, begun))?;
        self.zero = begun;
        self.mark_feed = Some(publisher.mark_feed());
        let opened = self.around.ways.open(&mut publisher, self.around.lsl);
        self.publisher = Some(Rc::new(RefCell::new(publisher)));
        for words in opened? {
            self.shared.notice(false, words);
        }
        Ok(())
    }

    /// Stays with a link until it has to be opened anew.
    fn stay(&mut self, mut link: BoxLink) -> Result<(), BadInput> {
        let mut next = Next::Meet;
        while !self.is_over() {
            (link, next) = match next {
                Next::Meet => self.meet(link)?,
                Next::Watch => self.watch(link)?,
                Next::Job(job) => self.job(link, job)?,
                Next::Aim(order) => match self.aim(link, order)? {
                    Some(back) => back,
                    None => return Ok(()),
                },
                Next::Record => self.record(link)?,
                Next::Reopen => return Ok(()),
            };
        }
        Ok(())
    }

    /// Another stage.
    fn enter(&mut self, stage: Stage) {
        self.stage = stage;
        let doing = match stage {
            Stage::Away => Doing::Nothing,
            Stage::Watching => Doing::Watching,
            Stage::Examining => Doing::Examining,
            Stage::Aiming => Doing::Aiming,
            Stage::Exposing => Doing::Exposing,
            Stage::Delivering => Doing::Delivering,
            Stage::Measuring => Doing::MeasuringScene,
            Stage::Recording => Doing::Recording,
        };
        self.shared.update(|state| {
            state.doing = doing;
            state.job = None;
            if stage != Stage::Aiming && stage != Stage::Exposing {
                state.aim = None;
            }
            // What was measured before is not of this stage.
            state.live = None;
        });
        self.show_can();
    }

    /// What a long action, or the link, has failed at.
    fn fail(&mut self, error: BadInput) {
        let problem = Problem::from(error);
        let since_at_ms = self.shared.hub.now_ms();
        self.shared.update(|state| {
            state.job = None;
            state.failed = Some(problem.clone());
            state.link = match &state.link {
                LinkState::Searching { since_at_ms, .. } => {
                    LinkState::Searching { since_at_ms: *since_at_ms, problem }
                }
                _ => LinkState::Silent { since_at_ms, problem },
            };
        });
    }

    /// What is due whatever is done: the session's time, a fit that is over, orders that need no link.
    fn beat(&mut self) {
        let now = Instant::now();
        self.poll_fit();
        self.tick(now);
        while let Some(envelope) = self.next_order() {
            self.take_without_link(envelope);
        }
        if now >= self.show_at {
            self.show_at = now + SHOW_EVERY;
            self.show_session(now);
            self.show_can();
        }
    }

    /// The next order, of which it is certain that it is possible now.
    fn next_order(&mut self) -> Option<Envelope> {
        loop {
            let envelope = self.inbox.try_recv().ok()?;
            let needs = envelope.order.needs();
            if self.possible().contains(&needs) {
                return Some(envelope);
            }
            let refusal = can::not_now(&self.shared.state(), needs);
            let _ = envelope.answer.send(Err(refusal));
        }
    }

    /// Takes an order for which no link is needed.
    fn take_without_link(&mut self, envelope: Envelope) {
        let Envelope { order, answer } = envelope;
        let result = match order {
            Order::SessionBegin(begin) => self.begin_session(&begin),
            Order::SessionResume(resume) => self.resume_session(&resume),
            Order::SessionEvent(event) => self.session_event(&event),
            Order::SessionMark(mark, at) => self.mark(&mark, at),
            Order::SessionClose => self.close_session(),
            Order::CalibrationFit => self.begin_fit(),
            Order::PhotographsRemove(remove) => self.remove_photograph(&remove),
            Order::Reference => {
                self.refer();
                Ok(())
            }
            other => Err(can::not_now(&self.shared.state(), other.needs())),
        };
        self.show_session(Instant::now());
        self.show_can();
        let _ = answer.send(result);
    }
}
