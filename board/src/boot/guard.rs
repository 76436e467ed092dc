//! The watchdog during a start: from the moment when its driver is loaded until the session has it.
//!
//! ```text
//!          fed by a thread               handed over
//!   start ───────────────▶ the deadline ────────────▶ the session feeds it
//!                               │ over, or a failure
//!                               ▼
//!                 fed no more: the computer restarts
//! ```
//!
//! A start has so many steps that each might hang that they are watched as a whole: it has a time
//! for all of them. When that is over, the failure is reported like any other, and the watchdog
//! restarts the computer even if the report hangs as well.
//!
//! Before that the watchdog is the firmware's, on a Raspberry Pi. Which hang is ended by what:
//!
//! | what hangs | on a Raspberry Pi | on QEMU's `virt` |
//! |---|---|---|
//! | the boot loader in the Pi's EEPROM, or the firmware | nothing on the card; the loader's own setting `BOOT_WATCHDOG_TIMEOUT` can | there is none |
//! | the kernel, or this program before the watchdog's driver, the first module | the firmware's watchdog: 15 s after the kernel's start, by `kernel_watchdog_timeout` in `config.txt` | nothing: no watchdog runs |
//! | the loading of the other modules | the driver feeds it for 15 s, by `watchdog.open_timeout` from the firmware; it bites 15 s later | nothing |
//! | the start, up to the session | this guard | this guard |
//! | the session before its first frame | nothing: it may wait for a camera; in the trial of an update the watchdog, which each turn of the loop feeds | the same |
//! | the session | the watchdog, which frames feed | the same |

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::failure;
use crate::machine::watchdog::Watchdog;

/// The watchdog is fed this often, a fraction of the shortest timeout.
const FEED_EVERY: Duration = Duration::from_millis(250);

/// What happens when a start takes too long.
type TooLate = fn(&str) -> !;

/// What is fed.
pub trait Feed: Send + 'static {
    /// Restarts the time in which it must be fed again.
    fn feed(&mut self);
}

impl Feed for Watchdog {
    fn feed(&mut self) {
        self.feed();
    }
}

/// A watchdog that watches a start.
#[derive(Debug)]
pub struct Guard<W = Watchdog> {
    thread: JoinHandle<W>,
    is_over: Arc<AtomicBool>,
}

impl Guard {
    /// Starts the computer's watchdog with a timeout in seconds, and has it fed until `deadline`. A
    /// computer without a watchdog starts unguarded, which is logged.
    pub fn start(timeout_s: u16, deadline: Instant) -> Option<Self> {
        let guarded = Watchdog::open(timeout_s)
            .and_then(|watchdog| Ok(Self::of(watchdog, deadline, failure::end)?));
        guarded.inspect_err(|error| log::warn!("this start is not guarded: {error:#}")).ok()
    }
}

impl<W: Feed> Guard<W> {
    fn of(mut watchdog: W, deadline: Instant, too_late: TooLate) -> io::Result<Self> {
        let is_over = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&is_over);
        // From here on: the thread may take its time to run.
        watchdog.feed();
        let body = move || {
            let began = Instant::now();
            while !over.load(Ordering::Acquire) {
                if failure::failed() {
                    // It is being reported, in a time that the watchdog limits.
                    failure::stand_still();
                }
                if Instant::now() >= deadline {
                    let seconds = began.elapsed().as_secs_f64();
                    too_late(&format!("the start has not come to an end in {seconds:.1} s"));
                }
                watchdog.feed();
                thread::park_timeout(FEED_EVERY);
            }
            watchdog
        };
        let thread = thread::Builder::new().name("start's guard".into()).spawn(body)?;
        Ok(Self { thread, is_over })
    }

    /// Ends the guard; the watchdog runs, with its whole timeout to come. Does not return when the
    /// deadline is over.
    pub fn hand_over(self) -> W {
        self.is_over.store(true, Ordering::Release);
        self.thread.thread().unpark();
        // A panic in the thread has ended the program.
        let Ok(mut watchdog) = self.thread.join() else { failure::stand_still() };
        watchdog.feed();
        watchdog
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    /// When it was fed.
    #[derive(Debug, Default, Clone)]
    struct Fed(Arc<Mutex<Vec<Instant>>>);

    impl Feed for Fed {
        fn feed(&mut self) {
            self.0.lock().unwrap().push(Instant::now());
        }
    }

    impl Fed {
        fn times(&self) -> usize {
            self.0.lock().unwrap().len()
        }

        fn wait_for(&self, times: usize) {
            let give_up = Instant::now() + Duration::from_secs(60);
            while self.times() < times {
                assert!(Instant::now() < give_up, "fed {} times", self.times());
                thread::sleep(Duration::from_millis(10));
            }
        }
    }

    fn stand_still(_: &str) -> ! {
        failure::stand_still()
    }

    #[test]
    fn it_is_fed_until_it_is_handed_over_and_by_nobody_afterwards() {
        let fed = Fed::default();
        let far = Instant::now() + Duration::from_secs(3600);
        let guard = Guard::of(fed.clone(), far, stand_still).unwrap();
        fed.wait_for(4);
        let handed_over = guard.hand_over();
        let times = fed.times();
        thread::sleep(3 * FEED_EVERY);
        assert_eq!(handed_over.times(), times);
    }

    #[test]
    fn a_start_that_takes_too_long_is_a_failure_and_its_watchdog_is_fed_no_more() {
        static SAID: Mutex<String> = Mutex::new(String::new());
        fn too_late(what: &str) -> ! {
            what.clone_into(&mut SAID.lock().unwrap());
            failure::stand_still()
        }
        let fed = Fed::default();
        let deadline = Instant::now() + 2 * FEED_EVERY;
        let guard = Guard::of(fed.clone(), deadline, too_late).unwrap();
        let give_up = Instant::now() + Duration::from_secs(60);
        while SAID.lock().unwrap().is_empty() {
            assert!(Instant::now() < give_up, "nothing was said");
            thread::sleep(Duration::from_millis(10));
        }
        assert!(SAID.lock().unwrap().starts_with("the start has not come to an end in "));
        let times = fed.times();
        thread::sleep(3 * FEED_EVERY);
        assert_eq!(fed.times(), times);
        assert!(fed.0.lock().unwrap().iter().all(|&at| at < deadline + FEED_EVERY));
        // It is not handed over to anybody either.
        assert!(!guard.thread.is_finished());
    }
}
