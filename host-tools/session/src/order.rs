//! The order in which a participant meets the conditions.
//!
//! In: the number of conditions and of repeats, and the participant's number in the study, from 1.
//! Out: one permutation of the conditions for each repeat, so that every condition has been met once
//! before any is met again.
//!
//! **`fixed`**: the protocol's order, each time.
//!
//! **`latin_square`**: the balanced square of Williams (1949, Aust J Sci Res A 2:149). Among as many
//! successive participants as the square has rows, each condition stands once at each place and
//! follows each other condition once; with an odd number of conditions no square does so, and the
//! square and its mirror image together do it twice. Repeat r of participant p takes row
//! p - 1 + r, counted from 0 and in a circle.
//!
//! **`random`**: drawn anew for each participant and repeat, and the same on every computer and with
//! every version of this program. The generator is ChaCha with 8 rounds (Bernstein 2008), with a
//! 64-bit counter and stream 0, whose output no version of a crate can change; its key is made of
//! four little-endian numbers of 8 bytes: the seed, the participant's number, the repeat counted from
//! 0, and 0. Starting with the conditions in the protocol's order, the one at place i, from the last
//! down to the second, changes places with the one at j, where j is drawn from 0 to i (Fisher and
//! Yates; Durstenfeld 1964, Commun ACM 7:420). The draw takes the next 32 bits x of the generator and,
//! with n = i + 1, rejects those from the largest multiple of n within 2³² on; j is x modulo n. Hence
//! all orders are equally likely, and the next order cannot be told from those before.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use serde::{Deserialize, Serialize};

/// How the conditions are ordered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "OrderToml", into = "OrderToml")]
pub enum Order {
    /// As the protocol lists them.
    Fixed,
    /// Drawn for each participant and repeat.
    Random {
        /// Another seed gives other orders.
        seed: u32,
    },
    /// Balanced over the participants, by their number.
    LatinSquare,
}

/// An order in a file: `{ by = "random", seed = 1 }`.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct OrderToml {
    by: By,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    seed: Option<u32>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum By {
    Fixed,
    Random,
    LatinSquare,
}

impl TryFrom<OrderToml> for Order {
    type Error = &'static str;

    fn try_from(OrderToml { by, seed }: OrderToml) -> Result<Self, Self::Error> {
        match (by, seed) {
            (By::Fixed, None) => Ok(Self::Fixed),
            (By::LatinSquare, None) => Ok(Self::LatinSquare),
            (By::Random, Some(seed)) => Ok(Self::Random { seed }),
            (By::Random, None) => Err("a random order needs a seed"),
            (By::Fixed | By::LatinSquare, Some(_)) => Err("only a random order has a seed"),
        }
    }
}

impl From<Order> for OrderToml {
    fn from(order: Order) -> Self {
        match order {
            Order::Fixed => Self { by: By::Fixed, seed: None },
            Order::Random { seed } => Self { by: By::Random, seed: Some(seed) },
            Order::LatinSquare => Self { by: By::LatinSquare, seed: None },
        }
    }
}

impl Order {
    /// The indices of the conditions in the order of one repeat, counted from 0, of the participant
    /// with this number, counted from 1.
    ///
    /// # Panics
    /// When there is no condition, or no participant has the number.
    #[must_use]
    pub fn of_repeat(self, conditions: usize, participant: u32, repeat: u32) -> Vec<usize> {
        assert!(conditions > 0 && participant > 0);
        match self {
            Self::Fixed => (0..conditions).collect(),
            Self::LatinSquare => {
                let rows = latin_square(conditions);
                let row = u64::from(participant - 1) + u64::from(repeat);
                rows[(row % rows.len() as u64) as usize].clone()
            }
            Self::Random { seed } => shuffled(conditions, seed, participant, repeat),
        }
    }
}

/// The rows of Williams's square: the first is 0, 1, n - 1, 2, n - 2 ..., and each further one adds
/// 1 to all of the one before, modulo n. The differences of neighbours in the first row are all
/// different, so that each ordered pair of neighbours occurs once; if n is odd they are so up to the
/// sign, and the rows backwards have the other sign.
fn latin_square(conditions: usize) -> Vec<Vec<usize>> {
    let first: Vec<usize> = (0..conditions)
        .map(|place| if place % 2 == 1 { place.div_ceil(2) } else { conditions - place / 2 })
        .map(|it| it % conditions)
        .collect();
    let row = |add: usize| first.iter().map(|it| (it + add) % conditions).collect::<Vec<_>>();
    let mut rows: Vec<Vec<usize>> = (0..conditions).map(row).collect();
    if conditions % 2 == 1 {
        let mirrored = rows.iter().map(|row| row.iter().rev().copied().collect());
        rows.extend(mirrored.collect::<Vec<_>>());
    }
    rows
}

fn shuffled(conditions: usize, seed: u32, participant: u32, repeat: u32) -> Vec<usize> {
    let mut key = [0; 32];
    for (bytes, number) in key.chunks_exact_mut(8).zip([seed, participant, repeat]) {
        bytes.copy_from_slice(&u64::from(number).to_le_bytes());
    }
    let mut random = ChaCha8Rng::from_seed(key);
    let mut order: Vec<usize> = (0..conditions).collect();
    for at in (1..conditions).rev() {
        order.swap(at, below(at as u32 + 1, &mut random) as usize);
    }
    order
}

/// A number below `bound`, each equally likely.
fn below(bound: u32, random: &mut ChaCha8Rng) -> u32 {
    let span = 1_u64 << 32;
    let usable = span - span % u64::from(bound);
    loop {
        let drawn = random.next_u32();
        if u64::from(drawn) < usable {
            return drawn % bound;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    fn is_permutation(order: &[usize]) -> bool {
        let mut sorted = order.to_vec();
        sorted.sort_unstable();
        sorted.iter().copied().eq(0..order.len())
    }

    #[test]
    fn each_condition_is_once_at_each_place_and_follows_each_other_equally_often() {
        for conditions in 1..=12 {
            // Over as many participants as there are rows, whoever is the first, in each repeat.
            let (rows, times) =
                if conditions % 2 == 0 { (conditions, 1) } else { (2 * conditions, 2) };
            for (from, repeat) in [(1, 0), (5, 0), (1, 1), (1_000_003, 2)] {
                let (mut places, mut pairs) = (BTreeMap::new(), BTreeMap::new());
                for participant in from..from + rows as u32 {
                    let row = Order::LatinSquare.of_repeat(conditions, participant, repeat);
                    assert!(is_permutation(&row), "{row:?}");
                    for (place, condition) in row.iter().enumerate() {
                        *places.entry((place, *condition)).or_insert(0) += 1;
                    }
                    for pair in row.windows(2) {
                        *pairs.entry((pair[0], pair[1])).or_insert(0) += 1;
                    }
                }
                assert_eq!(places.len(), conditions * conditions);
                assert_eq!(pairs.len(), conditions * (conditions - 1));
                assert!(places.values().chain(pairs.values()).all(|it| *it == times));
            }
        }
    }

    #[test]
    fn the_square_of_four_is_the_one_that_is_printed_everywhere() {
        let rows: Vec<_> = (1..=5).map(|it| Order::LatinSquare.of_repeat(4, it, 0)).collect();
        assert_eq!(rows[..4], [[0, 1, 3, 2], [1, 2, 0, 3], [2, 3, 1, 0], [3, 0, 2, 1]]);
        assert_eq!(rows[4], rows[0]);
        // A repeat goes on with the next row.
        assert_eq!(Order::LatinSquare.of_repeat(4, 1, 1), rows[1]);
        assert_eq!(Order::LatinSquare.of_repeat(4, u32::MAX, u32::MAX).len(), 4);
    }

    /// The bytes that the doc promises, from another implementation of the same steps.
    #[test]
    fn a_seed_gives_the_same_orders_with_every_version() {
        let order =
            |seed, participant, repeat| Order::Random { seed }.of_repeat(6, participant, repeat);
        assert_eq!(order(1, 1, 0), PINNED[0]);
        assert_eq!(order(1, 1, 1), PINNED[1]);
        assert_eq!(order(1, 2, 0), PINNED[2]);
        assert_eq!(order(u32::MAX, u32::MAX, 9), PINNED[3]);
    }

    const PINNED: [[usize; 6]; 4] =
        [[3, 4, 2, 0, 1, 5], [1, 0, 3, 4, 5, 2], [3, 5, 4, 1, 0, 2], [1, 0, 4, 3, 2, 5]];

    #[test]
    fn every_order_is_drawn_equally_often() {
        for (conditions, orders) in [(1, 1), (2, 2), (3, 6), (4, 24)] {
            let mut seen = BTreeMap::new();
            let draws = 200 * orders;
            for participant in 1..=draws {
                let order = Order::Random { seed: 7 }.of_repeat(conditions, participant, 0);
                assert!(is_permutation(&order));
                *seen.entry(order).or_insert(0_u32) += 1;
            }
            assert_eq!(seen.len(), orders as usize);
            // Pearson's chi-squared; the bound is more than five SD above its mean for each.
            let chi2: f64 = seen.values().map(|it| (f64::from(*it) - 200.0).powi(2) / 200.0).sum();
            let freedom = f64::from(orders - 1);
            assert!(chi2 <= freedom + 5.0 * (2.0 * freedom).sqrt(), "{conditions}: {chi2}");
        }
    }

    #[test]
    fn participants_and_repeats_and_seeds_have_orders_of_their_own() {
        let orders: Vec<_> = (1..=4)
            .flat_map(|participant| (0..4).map(move |repeat| (participant, repeat)))
            .flat_map(|(participant, repeat)| {
                [1, 2].map(|seed| Order::Random { seed }.of_repeat(12, participant, repeat))
            })
            .collect();
        for (at, order) in orders.iter().enumerate() {
            assert!(!orders[..at].contains(order), "{order:?}");
        }
    }
}
