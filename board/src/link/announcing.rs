//! When the box announces itself: at once, and then again and again.

/// Over UDP while nobody at the configured destination is heard, so that a host finds the box at
/// once.
const SOUGHT_NS: u64 = 250_000_000;

/// Over UDP otherwise, for other programs at the same address.
const HEARD_NS: u64 = 500_000_000;

/// On a serial line.
const SERIAL_NS: u64 = 1_000_000_000;

/// When the next announcements are due.
#[derive(Debug, Default)]
pub(super) struct Announcing {
    udp_ns: Option<u64>,
    serial_ns: Option<u64>,
}

impl Announcing {
    /// Whether to announce the box over UDP now; `is_heard` tells whether somebody listens at the
    /// destination.
    pub(super) fn is_due_on_udp(&mut self, is_heard: bool, now_ns: u64) -> bool {
        is_due(&mut self.udp_ns, if is_heard { HEARD_NS } else { SOUGHT_NS }, now_ns)
    }

    /// Whether to announce the box on the serial line now.
    pub(super) fn is_due_on_serial(&mut self, now_ns: u64) -> bool {
        is_due(&mut self.serial_ns, SERIAL_NS, now_ns)
    }

    /// Both are due at once.
    pub(super) fn hurry(&mut self) {
        *self = Self::default();
    }
}

fn is_due(last_ns: &mut Option<u64>, every_ns: u64, now_ns: u64) -> bool {
    let is_due = last_ns.is_none_or(|last_ns| now_ns.saturating_sub(last_ns) >= every_ns);
    if is_due {
        *last_ns = Some(now_ns);
    }
    is_due
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_comes_at_once_and_the_others_at_their_pace() {
        let count = |due: &mut dyn FnMut(u64) -> bool| {
            (0..10_000).filter(|ms| due(1_000_000 * (ms + 77))).count()
        };
        let mut announcing = Announcing::default();
        assert_eq!(count(&mut |now_ns| announcing.is_due_on_udp(false, now_ns)), 40);
        announcing.hurry();
        assert_eq!(count(&mut |now_ns| announcing.is_due_on_udp(true, now_ns)), 20);
        assert_eq!(count(&mut |now_ns| announcing.is_due_on_serial(now_ns)), 10);
    }
}
