//! The frames that a camera keeps ready for the loop: the newest two.

use heapless::Deque;

/// The largest number of frames that wait.
pub const NEWEST: usize = 2;

/// The newest two items, oldest first.
#[derive(Debug)]
pub struct Newest<T>(Deque<T, NEWEST>);

impl<T> Newest<T> {
    /// None yet.
    pub const fn new() -> Self {
        Self(Deque::new())
    }

    /// Adds an item; the oldest comes out when there are two already.
    pub fn push(&mut self, item: T) -> Option<T> {
        let oldest = if self.0.is_full() { self.0.pop_front() } else { None };
        // There is room now.
        self.0.push_back(item).err().or(oldest)
    }

    /// Takes the oldest.
    pub fn pop(&mut self) -> Option<T> {
        self.0.pop_front()
    }

    /// Whether none is left.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_two_are_kept() {
        let mut newest = Newest::new();
        let dropped: Vec<Option<u32>> = (0..4).map(|item| newest.push(item)).collect();
        assert_eq!(dropped, [None, None, Some(0), Some(1)]);
        assert_eq!((newest.pop(), newest.is_empty()), (Some(2), false));
        assert_eq!((newest.pop(), newest.is_empty()), (Some(3), true));
        assert_eq!(newest.pop(), None);
    }
}
