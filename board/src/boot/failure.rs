//! A fault of the program or the machine: what and where is said, on the console
//! and to the hosts, and the watchdog restarts the computer.
//!
//! A panic of any thread ends here, before anything is unwound; no frame is
//! processed any more (see [`gate`](super::gate)), so that nothing feeds the
//! watchdog. Without a watchdog the program restarts the computer itself.

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

/// The watchdog's time where the configuration gives none.
const WATCHDOG_S: u16 = 10;

/// So much later than the watchdog should have, the program restarts the computer.
const GRACE: Duration = Duration::from_secs(5);

static FAILED: AtomicBool = AtomicBool::new(false);

/// Who is told, and the watchdog's time.
static AUDIENCE: Mutex<Option<(Links, u16)>> = Mutex::new(None);

/// Something has failed; the computer is about to restart.
pub fn failed() -> bool {
    FAILED.load(Ordering::Relaxed)
}

/// Names those who are told, and the watchdog's time.
pub fn tell(links: &Links, watchdog_s: Option<u16>) {
    let mut audience = AUDIENCE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    *audience = Some((links.clone(), watchdog_s.unwrap_or(WATCHDOG_S)));
}

/// From now on a panic of any thread is a failure.
pub fn take_panics() {
    std::panic::set_hook(Box::new(|panic: &PanicHookInfo<'_>| {
        // Its text says what and where, over two lines.
        end(&panic.to_string().replace('\n', " "));
    }));
}

/// Says what has failed until the computer restarts.
pub fn end(what: &str) -> ! {
    if FAILED.swap(true, Ordering::Relaxed) {
        // The first failure is the one to tell of.
        stand_still();
    }
    status::set(Status::Failed);
    let text = format!("{}: {what}", Status::Failed.words());
    // Not by the logger: its lock may be held by whoever failed.
    let _ = writeln!(std::io::stderr(), "ERROR: {text}");
    let audience = AUDIENCE.try_lock().ok().and_then(|audience| audience.clone());
    let (links, watchdog_s) = audience.unwrap_or((Links::default(), WATCHDOG_S));
    // Taken already, it runs, unless the camera was lost: then the end below comes first.
    if let Ok(mut watchdog) = Watchdog::open(watchdog_s) {
        watchdog.feed();
        std::mem::forget(watchdog);
    }
    let started = Instant::now();
    let mut announcer = Announcer::new(&links);
    while started.elapsed() < Duration::from_secs(watchdog_s.into()) + GRACE {
        // The screen reads it; now and then somebody else is just at it.
        logger::keep_complaint(&text);
        announcer.say(&text);
        std::thread::sleep(AGAIN);
    }
    super::restart::now()
}

/// For ever.
pub fn stand_still() -> ! {
    loop {
        std::thread::park();
    }
}
