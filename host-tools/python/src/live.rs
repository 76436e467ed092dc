//! A box's poses while they come, over the trusted link, by the keys of this computer.
//!
//! ```text
//! box ─▶ link ─▶ publisher ─▶ bounded queue ─▶ __next__: an object for each frame, gap, mark
//! └───────── a thread of its own ─────────┘
//! ```
//!
//! Where the queue is full, what comes is dropped and counted, and said at the end.

use std::io::Sink;
use std::net::SocketAddr;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver as Queue, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use plumbline_bedside::link::{Carried, Way, called};
use plumbline_files::BadInput;
use plumbline_publish::Publisher;
use plumbline_publish::item::Item;
use plumbline_publish::json::lines::line;
use plumbline_stream::link::{BAUD, NOT_HEARD_REMEDY};
use plumbline_stream::receiver::Receiver;
use plumbline_stream::reception;
use pyo3::exceptions::PyTimeoutError;
use pyo3::prelude::*;

use crate::arrays::from_json;
use crate::error::{Raise as _, bad_argument, raised};

/// While nothing comes, Ctrl-C is looked for so often.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// The longest time that can be waited for: a day.
const TIMEOUT_S_MAX: f64 = 86_400.0;

/// A reception: iterate over it. Ended by `close`, or at the end of a `with` block.
#[pyclass(frozen, module = "plumbline")]
pub struct Reception {
    place: String,
    timeout: Duration,
    queue: Mutex<Queue<Item>>,
    zero_unix_s: Mutex<f64>,
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<Ended>>>,
    said: Mutex<Vec<String>>,
}

/// How a reception has ended: what came of it, in words.
type Ended = Result<Vec<String>, BadInput>;

/// What both threads know.
#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    /// Why nothing is heard of the box, and what to do.
    obstacle: Mutex<Option<(String, String)>>,
    warnings: Mutex<Vec<String>>,
}

/// Nothing is left half done where a thread panics with a lock.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Receives a box's poses while they come, as `plumb receive --json` publishes them.
///
/// `udp`: the address and port to listen at ("0.0.0.0:4210" unless it is given); `serial`, `baud`: a
/// serial device instead; `box`: its name, serial number or key (the first that is heard unless it is
/// given); `timeout_s`: how long the next object is waited for; `past`: what the box has kept of the
/// last minute as well.
#[pyfunction]
#[pyo3(signature = (*, udp = None, serial = None, baud = BAUD, r#box = None, timeout_s = 10.0, past = false))]
pub fn receive(
    py: Python<'_>,
    udp: Option<&str>,
    serial: Option<String>,
    baud: u32,
    r#box: Option<String>,
    timeout_s: f64,
    past: bool,
) -> PyResult<Reception> {
    const NAME: &str = "receive";
    if !(timeout_s > 0.0 && timeout_s <= TIMEOUT_S_MAX) {
        let remedy = "give seconds, more than 0 and at most a day";
        return Err(bad_argument(NAME, "timeout_s", timeout_s, remedy));
    }
    let udp: Option<SocketAddr> = udp.map(str::parse).transpose().map_err(|_| {
        let remedy = "give a numeric address and a port, such as \"0.0.0.0:4210\"";
        bad_argument(NAME, "udp", format!("{:?}", udp.unwrap_or_default()), remedy)
    })?;
    let carried = match serial {
        Some(_) if udp.is_some() => {
            return Err(bad_argument(NAME, "serial", "udp is given, too", "give one of them"));
        }
        Some(device) => Carried::Serial { device, baud },
        None => Carried::Udp(udp),
    };
    let way = Way { carried, called: r#box, at: None };
    let shared = Arc::<Shared>::default();
    let (sender, opened) = sync_channel(1);
    let follower = {
        let shared = Arc::clone(&shared);
        let run = move || follow(&way, past, &shared, sender);
        thread::Builder::new().name("plumbline receive".to_owned()).spawn(run)
    };
    let thread = follower.map_err(|error| BadInput::io("a thread", &error)).raise()?;
    let Ok(Opened { place, queue }) = py.detach(move || opened.recv()) else {
        // It has ended before it could begin.
        let ended = py.detach(|| thread.join()).unwrap_or_else(|_| Err(broken()));
        return Err(raised(ended.err().unwrap_or_else(broken)));
    };
    Ok(Reception {
        place,
        timeout: Duration::from_secs_f64(timeout_s),
        queue: Mutex::new(queue),
        zero_unix_s: Mutex::new(0.0),
        shared,
        thread: Mutex::new(Some(thread)),
        said: Mutex::default(),
    })
}

/// The error of a thread that has ended without one.
fn broken() -> BadInput {
    BadInput::whole("the reception", "it has ended unexpectedly", "report it")
}

/// A link that is open.
struct Opened {
    place: String,
    queue: Queue<Item>,
}

/// Opens the link, says so, and follows it until it is to stop; what came of it, in words.
fn follow(way: &Way, past: bool, shared: &Arc<Shared>, opened: SyncSender<Opened>) -> Ended {
    let warn = {
        let shared = Arc::clone(shared);
        move |warning: &str| locked(&shared.warnings).push(warning.to_owned())
    };
    let link = way.open(&called("Python"), past, warn)?;
    let place = link.place().to_owned();
    let mut transport = link.into_transport();
    let mut publisher = Publisher::new(Instant::now(), true);
    // The queue itself is handed over: nothing else has to wait for it.
    publisher.add_own("Python", move |queue| {
        let _ = opened.send(Opened { place, queue });
        Vec::new()
    })?;
    let mut receiver = Receiver::<Sink>::new(None);
    while !shared.stop.load(Ordering::Relaxed) {
        *locked(&shared.obstacle) = transport.obstacle();
        let until = Instant::now() + LOOK_EVERY;
        reception::follow(
            &mut *transport,
            &mut receiver,
            &mut publisher,
            None,
            &shared.stop,
            &mut |receiver: &mut Receiver<Sink>| {
                // What is noticed is published, too.
                drop(receiver.take_notices());
                match Instant::now() < until {
                    true => ControlFlow::Continue(()),
                    false => ControlFlow::Break(()),
                }
            },
        )?;
    }
    Ok(publisher.finish())
}

impl Reception {
    /// The next item; `None` once nothing more comes.
    fn next_item(&self, py: Python<'_>) -> PyResult<Option<Item>> {
        let until = Instant::now() + self.timeout;
        loop {
            let waited = py.detach(|| locked(&self.queue).recv_timeout(LOOK_EVERY));
            match waited {
                Ok(item) => return Ok(Some(item)),
                Err(RecvTimeoutError::Disconnected) => return self.end(py).map(|()| None),
                Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            }
            if Instant::now() >= until {
                return Err(PyTimeoutError::new_err(self.silence()));
            }
        }
    }

    /// That nothing comes, and why.
    fn silence(&self) -> String {
        let obstacle = locked(&self.shared.obstacle).clone();
        let (why, remedy) =
            obstacle.unwrap_or_else(|| ("no pose comes".to_owned(), NOT_HEARD_REMEDY.to_owned()));
        let seconds = self.timeout.as_secs_f64();
        format!("{}: {why} ({seconds} s were waited); {remedy}", self.place)
    }

    /// Ends the thread; its error is raised once.
    fn end(&self, py: Python<'_>) -> PyResult<()> {
        self.shared.stop.store(true, Ordering::Relaxed);
        let Some(thread) = locked(&self.thread).take() else { return Ok(()) };
        let ended = py.detach(|| thread.join()).unwrap_or_else(|_| Err(broken()));
        *locked(&self.said) = ended.raise()?;
        Ok(())
    }
}

impl Drop for Reception {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
    }
}

#[pymethods]
impl Reception {
    /// Where it listens.
    #[getter]
    fn place(&self) -> &str {
        &self.place
    }

    /// What came of it, in words: frames, losses, what was dropped; empty until it has ended.
    #[getter]
    fn said(&self) -> Vec<String> {
        locked(&self.said).clone()
    }

    /// Keys that could not be used, and the like.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        locked(&self.shared.warnings).clone()
    }

    /// Ends the reception.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.end(py)
    }

    fn __enter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    fn __exit__(
        &self,
        py: Python<'_>,
        _kind: &Bound<'_, PyAny>,
        _error: &Bound<'_, PyAny>,
        _traceback: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        self.end(py)
    }

    fn __iter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(item) = self.next_item(py)? else { return Ok(None) };
        let text = {
            let mut zero_unix_s = locked(&self.zero_unix_s);
            if let Item::Stream(stream) = &item {
                *zero_unix_s = stream.zero_unix_s;
            }
            line(&item, *zero_unix_s)
        };
        from_json(py, &text).map(Some)
    }
}
