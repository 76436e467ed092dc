//! Marks of other programs, for whichever boxes are recorded.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use plumbline_trial::mark::{Mark, MarkSender, Marks};

use crate::hub::Hub;

/// Marks wait no longer than this; each has the time at which it was made.
const EVERY: std::time::Duration = std::time::Duration::from_millis(20);

/// The recordings that go on, by the ids of their boxes.
#[derive(Debug, Default)]
pub struct MarkBoard {
    takers: Mutex<HashMap<String, MarkSender>>,
}

impl MarkBoard {
    /// A recording takes marks from now on.
    pub fn take(&self, box_id: &str, sender: MarkSender) {
        self.lock().insert(box_id.to_owned(), sender);
    }

    /// It is over.
    pub fn forget(&self, box_id: &str) {
        self.lock().remove(box_id);
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<String, MarkSender>> {
        self.takers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Hands a mark to every recording.
    fn mark(&self, at: std::time::Instant, mark: &Mark) {
        self.lock().retain(|_, sender| sender.send(at, mark.clone()));
    }

    /// Hands on what comes, until the desk ends. Marks while nothing is recorded belong to no trial.
    pub fn follow(&self, marks: &Marks, hub: &Hub) {
        while !hub.is_over() {
            while let Some((at, mark)) = marks.next() {
                self.mark(at, &mark);
            }
            std::thread::sleep(EVERY);
        }
    }
}
