//! What tests that prove something by trying it many times have in common: how often, from which
//! seed, and the line that says what was found.

use std::collections::hash_map::RandomState;
use std::env;
use std::hash::{BuildHasher as _, Hasher as _};

/// Names the seed of what is chosen at random.
pub const SEED: &str = "PLUMBLINE_SEED";

/// Names the share of the repetitions that is done, above 0 and at most 1: for a first try.
pub const SHARE: &str = "PLUMBLINE_SHARE";

/// The seed of a test's random choices: the one that [`SEED`] names, or else another one each time.
/// It is printed, so that a run can be repeated.
///
/// # Panics
/// When [`SEED`] is not a number.
pub fn seed() -> u64 {
    let given = env::var(SEED).ok();
    let given =
        given.map(|text| text.parse().unwrap_or_else(|_| panic!("{SEED}={text}: a number")));
    // The standard library draws the keys of its hash maps at random.
    let seed = given.unwrap_or_else(|| RandomState::new().build_hasher().finish());
    println!("\nseed {seed}: {SEED}={seed} repeats what is random in this test");
    seed
}

/// The number of repetitions to do of this many: as many, or the share that [`SHARE`] names.
///
/// # Panics
/// When [`SHARE`] is not a share.
pub fn repetitions(all: usize) -> usize {
    let Ok(text) = env::var(SHARE) else { return all };
    let share: f64 = text.parse().unwrap_or(0.0);
    assert!(share > 0.0 && share <= 1.0, "{SHARE}={text}: above 0 and at most 1");
    ((all as f64 * share) as usize).max(1)
}

/// Says that something was tried, how often (a count with its unit), and what was found, in the
/// form in which a page of evidence collects it.
pub fn evidence(tried: &str, how_often: &str, found: &str) {
    println!("\nevidence | {tried} | {how_often} | {found}");
}
