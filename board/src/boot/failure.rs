//! A fault of the program or the machine: it is reported on the console, on the panel and to the
//! hosts that have the box's key, and the watchdog restarts the computer.
//!
//! A panic in any thread ends up here, before anything is unwound. From then on no
//! frame is processed (see [`gate`](super::gate)), so that nothing feeds the watchdog.
//! Without a watchdog the program restarts the computer itself.
//!
//! The session's links belong to a thread that may have failed in the middle of a packet. What
//! failed is therefore reported over links of its own, sealed like the others: to hosts it is another
//! start of the box, which they meet when it announces itself. Nothing of it is said in clear.

use std::io::Write;
use std::panic::PanicHookInfo;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use plumbline::config::Links;
use plumbline::packet::ResetReason;
use plumbline::seal::Key;

use super::announce::Announcer;
use crate::link::Identity;
use crate::logger;
use crate::machine::watchdog::Watchdog;
use crate::random;
use crate::status::{self, Status};

/// The watchdog's timeout if the configuration gives none.
pub const WATCHDOG_S: u16 = 10;

/// How long after the watchdog's timeout the program restarts the computer itself.
const GRACE: Duration = Duration::from_secs(5);

/// The failure is repeated this often.
const AGAIN: Duration = Duration::from_secs(2);

/// How often hosts are heard.
const TURN: Duration = Duration::from_millis(20);

static FAILED: AtomicBool = AtomicBool::new(false);

/// Over which links a failure is reported, to whom, and the watchdog's timeout.
#[derive(Debug, Clone)]
struct Audience {
    links: Links,
    key: Option<Key>,
    watchdog_s: u16,
}

static AUDIENCE: Mutex<Option<Audience>> = Mutex::new(None);

/// Whether something has failed, so that the computer is about to restart.
pub fn failed() -> bool {
    FAILED.load(Ordering::Relaxed)
}

/// Sets the links over which a failure is reported, the key of those who are told, and the watchdog's
/// timeout.
pub fn tell(links: &Links, key: Option<&Key>, watchdog_s: Option<u16>) {
    let mut audience = AUDIENCE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let watchdog_s = watchdog_s.unwrap_or(WATCHDOG_S);
    *audience = Some(Audience { links: links.clone(), key: key.cloned(), watchdog_s });
}

/// From now on a panic in any thread is a failure.
pub fn take_panics() {
    std::panic::set_hook(Box::new(|panic: &PanicHookInfo<'_>| {
        // Its text gives the place and the message on two lines.
        end(&panic.to_string().replace('\n', " "));
    }));
}

/// Reports a failure until the computer restarts.
pub fn end(what: &str) -> ! {
    if FAILED.swap(true, Ordering::Relaxed) {
        // The first failure is the one to report.
        stand_still();
    }
    status::set(Status::Failed);
    let text = format!("{}: {what}", Status::Failed.words());
    // Not through the logger, from now on: the thread that failed may hold its lock.
    log::set_max_level(log::LevelFilter::Off);
    let _ = writeln!(std::io::stderr(), "ERROR: {text}");
    let audience = AUDIENCE.try_lock().ok().and_then(|audience| audience.clone());
    let nobody = Audience { links: Links::default(), key: None, watchdog_s: WATCHDOG_S };
    let Audience { links, key, watchdog_s } = audience.unwrap_or(nobody);
    // If the start's guard or the session has it open, it is running already, unless the camera was
    // lost; then the restart below comes first.
    if let Ok(mut watchdog) = Watchdog::open(watchdog_s) {
        watchdog.feed();
        std::mem::forget(watchdog);
    }
    let started = Instant::now();
    let identity = Identity {
        start: random::start(),
        name: String::new(),
        key: Ok(key),
        store: None,
        reset_reason: ResetReason::Unknown,
        start_count: None,
        refusal: None,
    };
    let mut announcer = Announcer::new(&links, identity, None);
    let mut again_at = started;
    while started.elapsed() < Duration::from_secs(watchdog_s.into()) + GRACE {
        let has_joined = announcer.answer(|_, _| None);
        if has_joined || Instant::now() >= again_at {
            // For the screen. Repeated, because now and then the texts are locked.
            logger::keep_complaint(&text);
            announcer.say(&text);
            again_at = Instant::now() + AGAIN;
        }
        std::thread::sleep(TURN);
    }
    super::restart::now()
}

/// Blocks for ever.
pub fn stand_still() -> ! {
    loop {
        std::thread::park();
    }
}
