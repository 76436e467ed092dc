//! What happens and a person should read.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use plumbline_files::text::printable;

/// The notices that wait to be read.
const WAITING_MAX: usize = 200;

/// Notices, from every thread.
#[derive(Debug, Default)]
pub struct Notices {
    waiting: Mutex<(VecDeque<String>, u64)>,
}

impl Notices {
    /// Something that happened.
    pub fn say(&self, words: impl AsRef<str>) {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let (notices, dropped) = &mut *waiting;
        if notices.len() == WAITING_MAX {
            notices.pop_front();
            *dropped += 1;
        }
        notices.push_back(printable(words.as_ref()).into_owned());
    }

    /// What has happened since the last call.
    #[must_use]
    pub fn take(&self) -> Vec<String> {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let (notices, dropped) = &mut *waiting;
        let left_out = std::mem::take(dropped);
        let left_out =
            (left_out > 0).then(|| format!("{left_out} notices before these were dropped"));
        left_out.into_iter().chain(notices.drain(..)).collect()
    }
}
