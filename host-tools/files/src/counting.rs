//! Counts in words, for messages.

use std::fmt::Display;

/// "1 target", "2 targets"; for a noun whose plural ends in s.
#[must_use]
pub fn counted<N: Display + PartialEq + From<u8>>(count: N, thing: &str) -> String {
    let plural = if count == N::from(1) { "" } else { "s" };
    format!("{count} {thing}{plural}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thing_has_no_s() {
        let texts = [0_usize, 1, 2, 11].map(|count| counted(count, "target"));
        assert_eq!(texts, ["0 targets", "1 target", "2 targets", "11 targets"]);
        assert_eq!(counted(1_u64, "time"), "1 time");
    }
}
