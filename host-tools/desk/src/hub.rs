//! What every part of the desk shares: its clock, and word that something has changed.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::{broadcast, watch};

use crate::wire::{FromDesk, Tone};

/// The tones that a page may have missed before it is told that it has.
const TONES_MAX: usize = 16;

/// The desk's clock, and its news.
#[derive(Debug)]
pub struct Hub {
    begun: Instant,
    version: watch::Sender<u64>,
    tones: broadcast::Sender<FromDesk>,
    studies: AtomicU64,
    /// The pages that are open.
    pub pages: AtomicUsize,
    /// Set when the desk is to end.
    pub stop: AtomicBool,
}

impl Hub {
    /// A clock that begins now.
    #[must_use]
    pub fn new() -> Self {
        Self {
            begun: Instant::now(),
            version: watch::Sender::new(0),
            tones: broadcast::Sender::new(TONES_MAX),
            studies: AtomicU64::new(1),
            pages: AtomicUsize::new(0),
            stop: AtomicBool::new(false),
        }
    }

    /// The desk's clock at a moment, milliseconds.
    #[must_use]
    pub fn ms(&self, at: Instant) -> f64 {
        match at.checked_duration_since(self.begun) {
            Some(since) => 1e3 * since.as_secs_f64(),
            None => -1e3 * self.begun.duration_since(at).as_secs_f64(),
        }
    }

    /// The desk's clock now.
    #[must_use]
    pub fn now_ms(&self) -> f64 {
        self.ms(Instant::now())
    }

    /// The moment of a time of the desk's clock, if there is one.
    #[must_use]
    pub fn instant(&self, ms: f64) -> Option<Instant> {
        self.begun.checked_add(Duration::try_from_secs_f64(1e-3 * ms).ok()?)
    }

    /// Something in the state has changed.
    pub fn changed(&self) {
        self.version.send_modify(|version| *version += 1);
    }

    /// The number of changes until now.
    #[must_use]
    pub fn version(&self) -> u64 {
        *self.version.borrow()
    }

    /// Hears of every change.
    #[must_use]
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.version.subscribe()
    }

    /// A study has changed on the disk.
    pub fn study_changed(&self) {
        self.studies.fetch_add(1, Ordering::Relaxed);
        self.changed();
    }

    /// The number of changes of studies until now.
    #[must_use]
    pub fn studies_version(&self) -> u64 {
        self.studies.load(Ordering::Relaxed)
    }

    /// A tone is to be heard at every page.
    pub fn tone(&self, box_id: &str, tone: Tone, at: Instant) {
        // Without a page there is nobody to hear it.
        let _ =
            self.tones.send(FromDesk::Tone { box_id: box_id.to_owned(), tone, at_ms: self.ms(at) });
    }

    /// Hears every tone.
    #[must_use]
    pub fn tones(&self) -> broadcast::Receiver<FromDesk> {
        self.tones.subscribe()
    }

    /// Whether the desk is to end.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Default for Hub {
    fn default() -> Self {
        Self::new()
    }
}
