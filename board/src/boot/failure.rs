//! A fault of the program or the machine: it is reported on the console and to the
//! hosts, and the watchdog restarts the computer.
//!
//! A panic in any thread ends up here, before anything is unwound. From then on no
//! frame is processed (see [`gate`](super::gate)), so that nothing feeds the watchdog.
//! Without a watchdog the program restarts the computer itself.

use std::io::Write;
use std::panic::PanicHookInfo;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use plumbline::config::Links;

use super::announce::{AGAIN, Announcer};
use crate::logger;
use crate::machine::watchdog::Watchdog;
use crate::status::{self, Status};

/// The watchdog's timeout if the configuration gives none.
const WATCHDOG_S: u16 = 10;

/// How long after the watchdog's timeout the program restarts the computer itself.
const GRACE: Duration = Duration::from_secs(5);

static FAILED: AtomicBool = AtomicBool::new(false);

/// The links over which a failure is reported, and the watchdog's timeout.
static AUDIENCE: Mutex<Option<(Links, u16)>> = Mutex::new(None);

/// Whether something has failed, so that the computer is about to restart.
pub fn failed() -> bool {
    FAILED.load(Ordering::Relaxed)
}

/// Sets the links over which a failure is reported, and the watchdog's timeout.
pub fn tell(links: &Links, watchdog_s: Option<u16>) {
    let mut audience = AUDIENCE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    *audience = Some((links.clone(), watchdog_s.unwrap_or(WATCHDOG_S)));
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
    // Not through the logger: the thread that failed may hold its lock.
    let _ = writeln!(std::io::stderr(), "ERROR: {text}");
    let audience = AUDIENCE.try_lock().ok().and_then(|audience| audience.clone());
    let (links, watchdog_s) = audience.unwrap_or((Links::default(), WATCHDOG_S));
    // If the session has it open, it is running already, unless the camera was lost; then the
    // restart below comes first.
    if let Ok(mut watchdog) = Watchdog::open(watchdog_s) {
        watchdog.feed();
        std::mem::forget(watchdog);
    }
    let started = Instant::now();
    let mut announcer = Announcer::new(&links);
    while started.elapsed() < Duration::from_secs(watchdog_s.into()) + GRACE {
        // For the screen. Repeated, because now and then the texts are locked.
        logger::keep_complaint(&text);
        announcer.say(&text);
        std::thread::sleep(AGAIN);
    }
    super::restart::now()
}

/// Blocks for ever.
pub fn stand_still() -> ! {
    loop {
        std::thread::park();
    }
}
