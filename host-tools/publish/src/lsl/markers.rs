//! Marks from another program: the markers of a stream of the Lab Streaming Layer.
//!
//! Each gets the time that its sender gave it, moved to this computer's clock by LSL's own time
//! correction: not the time of its arrival.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use plumbline_files::BadInput;

use super::LslClock;
use super::library::{Found, Inlet, Lost, Lsl};

/// The end is noticed within this time.
const PULL_WITHIN_S: f64 = 0.1;
const RESOLVE_WITHIN_S: f64 = 0.5;

/// A stream that was found answers within this time.
const OPEN_WITHIN_S: f64 = 5.0;

/// A marker may be older than this by no account: it waited for a network that was lost.
const AGE_MAX: Duration = Duration::from_secs(600);

/// A clock that is corrected is ahead by less than this.
const AHEAD_MAX: Duration = Duration::from_secs(1);

/// Takes the markers of a stream until this is dropped.
pub struct Markers {
    stop: Arc<AtomicBool>,
    refused: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

impl Markers {
    /// Takes the markers of the stream with this name, whenever there is one. `take` gets the time
    /// and the label, and says whether more are wanted.
    ///
    /// # Errors
    /// When a stream cannot have this name, or there is no thread.
    pub fn of(
        library: Lsl,
        name: &str,
        mut take: impl FnMut(Instant, &str) -> bool + Send + 'static,
    ) -> Result<Self, BadInput> {
        let place = format!("--mark-lsl {name}");
        if name.is_empty() || name.contains(['\'', '"']) {
            let remedy = "give the stream's name, without quotation marks in it";
            return Err(BadInput::whole(place, "is no name that can be looked for", remedy));
        }
        let (stop, refused) = (Arc::<AtomicBool>::default(), Arc::<AtomicU64>::default());
        let (stopped, refusals, name) = (Arc::clone(&stop), Arc::clone(&refused), name.to_owned());
        let follow = move || {
            let is_over = || stopped.load(Ordering::Relaxed);
            while !is_over() {
                let Some(found) = library.resolve_markers(&name, RESOLVE_WITHIN_S) else {
                    continue;
                };
                // One that is lost is looked for again.
                if let Ok(()) = follow(library, &found, &is_over, &refusals, &mut take) {
                    return;
                }
            }
        };
        let thread = thread::Builder::new().name("LSL markers".to_owned()).spawn(follow);
        let thread = Some(thread.map_err(|error| BadInput::io(place, &error))?);
        Ok(Self { stop, refused, thread })
    }

    /// Markers that were no marks, because their time was too far from their arrival.
    #[must_use]
    pub fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }
}

impl Drop for Markers {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that has panicked has said so.
            let _ = thread.join();
        }
    }
}

fn follow(
    library: Lsl,
    found: &Found,
    is_over: &impl Fn() -> bool,
    refused: &AtomicU64,
    take: &mut impl FnMut(Instant, &str) -> bool,
) -> Result<(), Lost> {
    let inlet = Inlet::open(found, OPEN_WITHIN_S)?;
    // The first takes a moment; from then on the library keeps it.
    inlet.time_correction(OPEN_WITHIN_S)?;
    let mut clock = LslClock::new(library);
    while !is_over() {
        let Some((label, sent_s)) = inlet.pull(PULL_WITHIN_S)? else { continue };
        clock.keep();
        let at = clock.instant(sent_s + inlet.time_correction(OPEN_WITHIN_S)?);
        let now = Instant::now();
        match at.filter(|at| is_plausible(*at, now)) {
            Some(at) if take(at, &label) => {}
            Some(_) => return Ok(()),
            None => {
                refused.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
    Ok(())
}

fn is_plausible(at: Instant, now: Instant) -> bool {
    now.saturating_duration_since(at) <= AGE_MAX && at.saturating_duration_since(now) <= AHEAD_MAX
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_far_from_the_arrival_is_no_marks() {
        let now = Instant::now() + Duration::from_secs(1000);
        assert!(is_plausible(now, now));
        assert!(is_plausible(now - AGE_MAX, now) && is_plausible(now + AHEAD_MAX, now));
        let more = Duration::from_millis(1);
        assert!(!is_plausible(now - AGE_MAX - more, now));
        assert!(!is_plausible(now + AHEAD_MAX + more, now));
    }
}
