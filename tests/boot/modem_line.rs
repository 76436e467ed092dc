//! The modem lines of a real serial device of the booted machine, against the times at which they were
//! pulled. `tests/guest` pulls them and says what the watch tells.

use std::fmt::Display;
use std::str::FromStr;

/// As `tests/guest` has them: times at which the line is asserted, and then while nobody looks.
const PULLS: usize = 12;
const UNSEEN: usize = 4;

/// Of those, the first is told of and so is one for all that come while nobody looks.
const TOLD_OF_UNSEEN: usize = 2;

/// The interval at which the modem wants to be asked, which the kernel tells: it may be this late.
const MODEM_NS: u64 = 32_000_000;

/// A program that waits is woken within this time.
const WOKEN_NS: u64 = 1_000_000;

/// The numbers behind `test: WORD PART` on the console, for each line of these.
fn said<T: FromStr<Err: Display>>(console: &str, word: &str, part: &str) -> Vec<Vec<T>> {
    let head = format!("test: {word} {part}");
    let rest = console.lines().filter_map(|line| line.trim().strip_prefix(&head));
    let number = |text: &str| match text.parse() {
        Ok(number) => number,
        Err(error) => panic!("{head}: {text:?}: {error}"),
    };
    rest.map(|numbers| numbers.split_whitespace().map(number).collect()).collect()
}

fn has(console: &str, line: &str) -> bool {
    console.lines().any(|it| it.trim() == line)
}

/// What the guest says of its modem lines is right.
pub fn assert_watched(console: &str) {
    assert!(
        has(console, "test: all lines"),
        "the guest did not come to the end of its modem lines: {:?}",
        console.lines().filter(|line| line.contains("test:")).take(20).collect::<Vec<_>>()
    );
    let refused = "test: refused cts it is a modem on USB, which has no line cts";
    assert!(has(console, refused), "cts of a modem on USB");
    for (part, is_asked) in [("dcd", false), ("dsr", false), ("asked", true)] {
        assert_part(console, part, is_asked);
        assert!(has(console, &format!("test: ended {part}")), "{part} goes on");
    }
    for part in ["waits", "asks"] {
        let gone_ns = said::<u64>(console, "gone", part);
        println!("modem line {part}: gone after {:.1} ms", gone_ns[0][0] as f64 * 1e-6);
        assert!(
            has(console, &format!("test: ended {part}")),
            "{part} waits for a device that is gone"
        );
    }
}

/// Each assertion is told of once, at its time; those that nobody looked at are counted.
fn assert_part(console: &str, part: &str, is_asked: bool) {
    let pulled = said::<u64>(console, "pulled", part);
    let told = said::<u64>(console, "asserted", part);
    let unseen = if is_asked { 0 } else { UNSEEN };
    // The last one ends the watch.
    assert_eq!(pulled.len(), PULLS + unseen + 1, "{part}");
    let told_of_unseen = if is_asked { 0 } else { TOLD_OF_UNSEEN };
    assert_eq!(told.len(), PULLS + told_of_unseen + 1, "{part}: {told:?} of {pulled:?}");
    let missed = said::<usize>(console, "missed", part);
    assert_eq!(missed, [[unseen - told_of_unseen]], "{part}");

    let (mut late_ns, mut uncertain_ns) = (Vec::new(), Vec::new());
    // Those by themselves.
    for (pulled, told) in pulled.iter().zip(&told).take(PULLS) {
        let (&[before_ns, after_ns, stood_ns], &[at_ns, within_ns]) = (&pulled[..], &told[..])
        else {
            panic!("{part}: {pulled:?}, {told:?}");
        };
        // What is stated holds for a computer that has time for it.
        let (from_ns, to_ns) = (at_ns.saturating_sub(within_ns + stood_ns), at_ns + within_ns);
        assert!(before_ns <= to_ns && from_ns <= after_ns, "{part}: {told:?} of {pulled:?}");
        late_ns.push(at_ns.abs_diff(before_ns));
        uncertain_ns.push(within_ns);
    }
    late_ns.sort_unstable();
    let [least_ns, most_ns] =
        [uncertain_ns.iter().min(), uncertain_ns.iter().max()].map(|it| *it.expect("several"));
    println!(
        "modem_line_{part}_error_us\tmedian {:.0}, worst {:.0} of {PULLS}; stated {:.0} to {:.0}",
        late_ns[PULLS / 2] as f64 * 1e-3,
        late_ns[PULLS - 1] as f64 * 1e-3,
        least_ns as f64 * 1e-3,
        most_ns as f64 * 1e-3
    );
    if is_asked {
        // Half of the time between two questions, whatever that was.
        assert!(least_ns > MODEM_NS, "{uncertain_ns:?}");
    } else {
        assert_eq!((least_ns, most_ns), (MODEM_NS + WOKEN_NS, MODEM_NS + WOKEN_NS), "{part}");
    }
}
