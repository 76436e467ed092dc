//! The box's clock and this computer's, related by questions and answers.
//!
//! - A later time of the box is no earlier here, whatever the answers say.
//! - The truth is no further away than is stated, for clocks that run as clocks do and ways that take
//!   what they like.
//! - Nor if one of the clocks has stood still for a while, or jumped, between two answers.

use plumbline_stream::clock::{Exchange, Relation, surest};
use proptest::prelude::*;

use crate::laws::Tries;

const SECOND_NS: u64 = 1_000_000_000;

/// Exchanges as a spoiled recording may have them: some of clocks, some of nothing.
fn spoiled() -> impl Strategy<Value = Vec<Exchange>> {
    let time = || prop_oneof![4 => 0..100 * SECOND_NS, 1 => 0..1_u64 << 50, 1 => any::<u64>()];
    let exchange = (time(), time(), time(), time()).prop_map(|(a, b, c, d)| Exchange {
        host_sent_ns: a,
        box_received_ns: b,
        box_sent_ns: c,
        host_received_ns: d,
    });
    proptest::collection::vec(exchange, 1..10)
}

fn never_backwards(tries: Tries) {
    tries.hold(
        "times of the box by answers of any content",
        "a later one was never earlier here, nor the other way round",
        &(spoiled(), proptest::collection::vec(-(1_i64 << 52)..1_i64 << 52, 2..10)),
        |(exchanges, mut steps_ns)| {
            let relation = Relation::of(&exchanges).expect("there is an exchange");
            let begun_ns = surest(&exchanges).expect("there is one").box_received_ns;
            steps_ns.sort_unstable();
            let here: Vec<f64> = steps_ns
                .iter()
                .map(|step_ns| relation.host_ns(begun_ns.wrapping_add_signed(*step_ns)))
                .collect();
            assert!(
                here.iter().all(|it| it.is_finite()) && here.is_sorted(),
                "{here:?}: {relation:?}"
            );
            let hosts_ns = steps_ns.iter().map(|it| it.unsigned_abs());
            let mut hosts_ns: Vec<u64> = hosts_ns.collect();
            hosts_ns.sort_unstable();
            let there = hosts_ns.iter().map(|it| relation.box_ns_since(*it, begun_ns));
            let there: Vec<f64> = there.collect();
            assert!(there.is_sorted(), "{there:?}: {relation:?}");
            assert!(hosts_ns.iter().all(|it| relation.uncertain_ns_at(*it) >= 0.0), "{relation:?}");
        },
    );
}

#[test]
fn time_never_runs_backwards() {
    never_backwards(Tries::few(2_000));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn time_never_runs_backwards_many_times() {
    never_backwards(Tries::many(1_000_000));
}

/// One question: the pause before it, the ways there and back, and what the box takes to answer, ns.
type Question = [u64; 4];

/// Two clocks, and what is asked.
#[derive(Debug, Clone)]
struct History {
    begun_ns: u64,
    ahead_ns: i64,
    /// By how much the box's clock is faster, in parts in a thousand million.
    faster_ppb: i64,
    questions: Vec<Question>,
    /// Before which question the box's clock jumps, and by how much.
    jump: Option<(usize, i64)>,
}

impl History {
    /// The box's clock at a time of this computer's.
    fn box_ns(&self, host_ns: u64, jumps_at_ns: Option<u64>) -> u64 {
        let since_ns = i128::from(host_ns) - i128::from(self.begun_ns);
        let gained_ns = since_ns * i128::from(self.faster_ppb) / 1_000_000_000;
        let jump_ns = match (self.jump, jumps_at_ns) {
            (Some((_, jump_ns)), Some(at_ns)) if host_ns >= at_ns => jump_ns,
            _ => 0,
        };
        let ahead_ns = i128::from(self.ahead_ns) + gained_ns + i128::from(jump_ns);
        u64::try_from(i128::from(host_ns) + ahead_ns).expect("a clock that has begun")
    }

    /// The exchanges, and when the clock jumps.
    fn exchanges(&self) -> (Vec<Exchange>, Option<u64>) {
        let (mut now_ns, mut jumps_at_ns) = (self.begun_ns, None);
        let mut exchanges = Vec::new();
        for (index, [pause_ns, there_ns, back_ns, held_ns]) in self.questions.iter().enumerate() {
            // In the pause, so that no question is under way.
            if self.jump.is_some_and(|(before, _)| before == index) {
                jumps_at_ns = Some(now_ns + pause_ns / 2);
            }
            let sent_ns = now_ns + pause_ns;
            let taken_ns = sent_ns + there_ns;
            let answered_ns = taken_ns + held_ns;
            now_ns = answered_ns + back_ns;
            exchanges.push(Exchange {
                host_sent_ns: sent_ns,
                box_received_ns: self.box_ns(taken_ns, jumps_at_ns),
                box_sent_ns: self.box_ns(answered_ns, jumps_at_ns),
                host_received_ns: now_ns,
            });
        }
        (exchanges, jumps_at_ns)
    }

    /// That the truth lies within what is stated, at times of all of it and, without a jump, after.
    fn assert_covered(&self, exchanges: &[Exchange], jumps_at_ns: Option<u64>) {
        let relation = Relation::of(exchanges).expect("there is an exchange");
        let last_ns = exchanges.last().expect("there is one").host_received_ns;
        let own = exchanges.iter().flat_map(|it| [it.host_sent_ns, it.host_received_ns]);
        let beside = jumps_at_ns.into_iter().flat_map(|it| [it - 1, it]);
        let after = jumps_at_ns.is_none().then_some(last_ns + 100 * SECOND_NS);
        for host_ns in own.chain(beside).chain(after) {
            let found_ns = relation.host_ns(self.box_ns(host_ns, jumps_at_ns));
            let error_ns = (found_ns - host_ns as f64).abs();
            let stated_ns = relation.uncertain_ns_at(host_ns);
            // The clocks differ by less than a thousandth also while a question is on its way or with
            // the box; and each clock counts whole nanoseconds, as a large f64 does.
            let held_ns = self.questions.iter().map(|it| it[3]).max().unwrap_or(0) as f64;
            let most_ns = 1.001 * stated_ns + 1e-3 * held_ns + 3.0;
            assert!(
                error_ns <= most_ns,
                "{error_ns} ns where {stated_ns} are stated: {relation:?}"
            );
        }
    }
}

/// Histories with ways of up to this, pauses of at least this, and clocks that differ by up to this.
fn histories(
    way_ns: u64,
    pause_ns: u64,
    questions: std::ops::Range<usize>,
    faster_ppb: i64,
) -> impl Strategy<Value = History> {
    let way = || prop_oneof![4 => 100_000..(way_ns / 10).max(100_001), 1 => 0..way_ns];
    let pause = pause_ns..pause_ns + 2 * SECOND_NS;
    let question = (pause, way(), way(), 0..1_000_000_u64).prop_map(|(a, b, c, d)| [a, b, c, d]);
    let begun_ns = 0..1_u64 << 50;
    let ahead_ns = 0..1_i64 << 50;
    (begun_ns, ahead_ns, -faster_ppb..=faster_ppb, proptest::collection::vec(question, questions))
        .prop_map(|(begun_ns, ahead_ns, faster_ppb, questions)| History {
            begun_ns,
            ahead_ns,
            faster_ppb,
            questions,
            jump: None,
        })
}

fn the_truth_is_covered(tries: Tries) {
    let inputs = prop_oneof![
        // Quartz clocks, at 100 ppm from each other, over any network; and one of two that is being
        // corrected, which enough good answers show.
        2 => histories(SECOND_NS, 0, 1..60, 100_000),
        1 => histories(2_000_000, SECOND_NS, 60..80, 500_000),
    ];
    tries.hold(
        "two clocks, related by answers that took any ways",
        "each time was as true as stated, before, between and after the answers",
        &inputs,
        |history| {
            let (exchanges, jumps_at_ns) = history.exchanges();
            history.assert_covered(&exchanges, jumps_at_ns);
        },
    );
}

#[test]
fn what_is_stated_covers_the_truth() {
    the_truth_is_covered(Tries::few(1_000));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn what_is_stated_covers_the_truth_many_times() {
    the_truth_is_covered(Tries::many(500_000));
}

fn a_jump_is_covered(tries: Tries) {
    // No less than what answers that take 0.1 s each can tell from their own delays.
    let jump_ns = prop_oneof![300_000_000..1_000_000_000_i64, 300_000_000..7_200_000_000_000_i64];
    // Back as well, as if this computer's had jumped.
    let jump_ns = (jump_ns, any::<bool>()).prop_map(|(it, is_back)| if is_back { -it } else { it });
    let histories = histories(50_000_000, 1_000_000, 2..60, 100_000);
    let inputs = (histories, any::<prop::sample::Index>(), jump_ns);
    tries.hold(
        "two clocks, of which one stands still or jumps by up to two hours between two answers",
        "time never ran backwards, and was as true as stated, on both sides of the jump",
        &inputs,
        |(mut history, before, jump_ns)| {
            history.jump = Some((1 + before.index(history.questions.len() - 1), jump_ns));
            history.ahead_ns += 7_200_000_000_000;
            let (exchanges, jumps_at_ns) = history.exchanges();
            history.assert_covered(&exchanges, jumps_at_ns);
        },
    );
}

#[test]
fn what_is_stated_covers_a_jump() {
    a_jump_is_covered(Tries::few(1_000));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn what_is_stated_covers_a_jump_many_times() {
    a_jump_is_covered(Tries::many(500_000));
}
