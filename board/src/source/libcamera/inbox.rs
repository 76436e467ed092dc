//! Passes completed requests from libcamera's thread to the loop.
//!
//! [`Inbox`] is a ring buffer under a lock, filled by the completion callback and
//! emptied by the loop. Neither side holds the lock for longer than
//! one push or pop, and neither uses the heap.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use heapless::Deque;

/// The number of requests: one being tracked, two waiting, the others with the
/// camera. At most 7, because then the `libcamera` crate's table of queued
/// requests never grows again: a hash table of up to 8 slots is probed at once
/// and leaves no tombstones.
pub const REQUESTS_MAX: usize = 6;

/// The items that have not been taken yet, oldest first.
pub struct Inbox<T> {
    state: Mutex<State<T>>,
    news: Condvar,
}

struct State<T> {
    waiting: Deque<T, REQUESTS_MAX>,
    disconnected: bool,
}

impl<T> Inbox<T> {
    pub fn new() -> Self {
        let state = State { waiting: Deque::new(), disconnected: false };
        Self { state: Mutex::new(state), news: Condvar::new() }
    }

    /// Adds an item. Returns it when the inbox is full, which it never is as long as
    /// no more than [`REQUESTS_MAX`] items exist.
    pub fn push(&self, item: T) -> Result<(), T> {
        let pushed = self.lock().waiting.push_back(item);
        self.news.notify_one();
        pushed
    }

    /// Notes that the camera is gone.
    pub fn disconnect(&self) {
        self.lock().disconnected = true;
        self.news.notify_one();
    }

    pub fn is_disconnected(&self) -> bool {
        self.lock().disconnected
    }

    pub fn pop(&self) -> Option<T> {
        self.lock().waiting.pop_front()
    }

    /// Waits for an item or a disconnection; false if there is neither by `until`.
    pub fn wait(&self, until: Instant) -> bool {
        let patience = until.saturating_duration_since(Instant::now());
        let nothing = |state: &mut State<T>| state.waiting.is_empty() && !state.disconnected;
        let (_state, timeout) = self
            .news
            .wait_timeout_while(self.lock(), patience, nothing)
            .unwrap_or_else(PoisonError::into_inner);
        !timeout.timed_out()
    }

    /// Nothing under the lock can panic halfway, so a poisoned lock is still valid.
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use super::*;

    #[test]
    fn items_come_out_in_order_and_a_full_inbox_hands_back() {
        let inbox = Inbox::new();
        for item in 0..REQUESTS_MAX {
            assert_eq!(inbox.push(item), Ok(()));
        }
        assert_eq!(inbox.push(99), Err(99));
        let all: Vec<usize> = std::iter::from_fn(|| inbox.pop()).collect();
        assert_eq!(all, [0, 1, 2, 3, 4, 5]);
    }

    #[test]
    fn waiting_ends_with_an_item_a_disconnection_or_the_time() {
        let inbox = Arc::new(Inbox::new());
        assert!(!inbox.wait(Instant::now()));
        assert!(!inbox.wait(Instant::now() + Duration::from_millis(5)));

        let far = Instant::now() + Duration::from_secs(600);
        let theirs = Arc::clone(&inbox);
        let thread = std::thread::spawn(move || theirs.push(1));
        assert!(inbox.wait(far));
        assert_eq!(inbox.pop(), Some(1));
        thread.join().unwrap().unwrap();

        let theirs = Arc::clone(&inbox);
        let thread = std::thread::spawn(move || theirs.disconnect());
        assert!(inbox.wait(far));
        assert!(inbox.is_disconnected());
        thread.join().unwrap();
    }
}
