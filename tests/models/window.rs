//! Which counters have come, in every sequence of events up to a length, against a list of all counters
//! that ever came.

use plumbline::seal::Window;
use plumbline_test_support::evidence;

/// What may happen, by the counter that is expected next or missing first, or by itself.
#[derive(Debug, Clone, Copy)]
enum Event {
    /// This far from the next one, a counter comes.
    Comes(i64),
    /// This far from the lowest that is missing.
    ComesBesideMissing(i64),
    /// This one.
    ComesAt(u64),
    /// All before have been sent, this far from the next one.
    Expected(u64),
    /// What is missing before is given up, this far from the lowest.
    GivenUpBesideMissing(u64),
    /// All that is missing is given up.
    GivenUp,
}

/// The ends of a window of 64 counters, and what lies beside them.
const EVENTS: [Event; 22] = [
    Event::Comes(0),
    Event::Comes(1),
    Event::Comes(-1),
    Event::Comes(-2),
    Event::Comes(-63),
    Event::Comes(-64),
    Event::Comes(-65),
    Event::Comes(62),
    Event::Comes(63),
    Event::Comes(64),
    Event::Comes(65),
    Event::Comes(128),
    Event::ComesBesideMissing(0),
    Event::ComesBesideMissing(-1),
    Event::ComesBesideMissing(1),
    Event::ComesAt(0),
    Event::ComesAt(u64::MAX),
    Event::Expected(1),
    Event::Expected(64),
    Event::Expected(65),
    Event::GivenUpBesideMissing(2),
    Event::GivenUp,
];

/// Everything that came, and below what nothing is taken any more.
#[derive(Debug, Clone)]
struct Plain {
    came: Vec<u64>,
    /// One above the highest that is known of.
    next: u64,
    /// Those before are decided.
    floor: u64,
    /// Those before are not counted as lost.
    counted_from: u64,
    span: u64,
}

impl Plain {
    fn is_new(&self, counter: u64) -> bool {
        counter >= self.floor && counter < u64::MAX && !self.came.contains(&counter)
    }

    fn take(&mut self, counter: u64) -> bool {
        let is_new = self.is_new(counter);
        if is_new {
            self.came.push(counter);
            self.expect(counter + 1);
        }
        is_new
    }

    fn expect(&mut self, next: u64) {
        self.next = self.next.max(next);
        self.floor = self.floor.max(self.next.saturating_sub(self.span));
    }

    fn give_up_before(&mut self, counter: u64) {
        self.floor = self.floor.max(counter.min(self.next));
    }

    /// How many of the counters from `first` to before `next` have not come.
    fn absent(&self, first: u64, next: u64) -> u64 {
        let came = self.came.iter().filter(|it| (first..next).contains(*it)).count() as u64;
        next.saturating_sub(first) - came
    }

    fn first_missing(&self) -> Option<u64> {
        (self.floor..self.next).find(|it| !self.came.contains(it))
    }
}

fn check<const WORDS: usize>(window: &Window<WORDS>, plain: &Plain, done: &[Event]) {
    let Plain { next, floor, counted_from, .. } = *plain;
    assert_eq!(window.next(), next, "{done:?}");
    assert_eq!(window.given_up(), plain.absent(counted_from, floor), "{done:?}");
    assert_eq!(window.owed(), plain.absent(floor.max(counted_from), next), "{done:?}");
    assert_eq!(window.missing().count() as u64, plain.absent(floor, next), "{done:?}");
    assert_eq!(window.missing().next(), plain.first_missing(), "{done:?}");
    for probe in [0, floor.wrapping_sub(1), floor, next - next.min(1), next, next + 1, u64::MAX] {
        assert_eq!(window.is_new(probe), plain.is_new(probe), "{probe}: {done:?}");
    }
}

/// Tries every sequence that begins like this, with at most so many events; how many there are.
fn every_sequence<const WORDS: usize>(
    window: &Window<WORDS>,
    plain: &Plain,
    done: &mut Vec<Event>,
    length: usize,
) -> u64 {
    check(window, plain, done);
    if done.len() == length {
        return 1;
    }
    let mut count = 1;
    for event in EVENTS {
        let (mut window, mut plain) = (window.clone(), plain.clone());
        done.push(event);
        let next = plain.next;
        let missing = plain.first_missing().unwrap_or(next);
        let comes = match event {
            Event::Comes(step) => Some(next.saturating_add_signed(step)),
            Event::ComesBesideMissing(step) => Some(missing.saturating_add_signed(step)),
            Event::ComesAt(counter) => Some(counter),
            Event::Expected(step) => {
                window.expect(next + step);
                plain.expect(next + step);
                None
            }
            Event::GivenUpBesideMissing(step) => {
                window.give_up_before(missing + step);
                plain.give_up_before(missing + step);
                None
            }
            Event::GivenUp => {
                window.give_up_before(u64::MAX);
                plain.give_up_before(u64::MAX);
                None
            }
        };
        if let Some(counter) = comes {
            assert_eq!(window.take(counter), plain.take(counter), "{counter}: {done:?}");
            assert!(!window.is_new(counter) && !window.take(counter), "{counter} twice: {done:?}");
        }
        count += every_sequence(&window, &plain, done, length);
        done.pop();
    }
    count
}

/// From its beginning, from the middle of a stream, and with a past that may still come.
fn windows(length: usize) {
    let mut count = 0;
    for (first, next) in [(0, 0), (1_000, 1_000), (10, 50), (0, 1_000)] {
        let window = Window::<1>::with_past(first, next);
        let span = Window::<1>::SPAN;
        let floor = first.max(next.saturating_sub(span));
        let plain = Plain { came: Vec::new(), next, floor, counted_from: next, span };
        count += every_sequence(&window, &plain, &mut Vec::new(), length);
    }
    evidence(
        &format!(
            "the window that refuses repeated packets, in every sequence of up to {length} of {} events, \
             from four beginnings",
            EVENTS.len()
        ),
        &format!("{count} sequences"),
        "what is new, missing, owed and given up: as by a list of all counters that came",
    );
}

#[test]
fn a_window_is_a_list_of_all_that_came_in_every_short_sequence() {
    windows(3);
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_window_is_a_list_of_all_that_came_in_every_sequence() {
    windows(5);
}
