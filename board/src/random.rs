//! Random bytes from the operating system.

use plumbline::packet::Start;

/// Bytes that nobody else can know. Right after the kernel's start it waits, for a moment, until
/// there are any.
///
/// # Panics
/// When the kernel has no random generator: without one no packet can be sealed.
#[must_use]
pub(crate) fn bytes<const N: usize>() -> [u8; N] {
    let mut bytes = [0; N];
    getrandom::fill(&mut bytes).expect("the kernel's random generator");
    bytes
}

/// The number of a start, by which hosts tell this box's packets from those of another start, and of
/// another box.
#[must_use]
pub fn start() -> Start {
    Start::new(u32::from_ne_bytes(bytes())).unwrap_or(Start::MIN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_drawn_differs_each_time() {
        assert_ne!(bytes::<32>(), bytes::<32>());
        assert_ne!(start(), start());
    }
}
