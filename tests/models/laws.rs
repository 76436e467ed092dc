//! How a law is tried.

use std::fmt::Debug;

use plumbline_test_support::{evidence, repetitions, seed};
use proptest::strategy::Strategy;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

/// How often, and from which seed.
#[derive(Debug, Clone, Copy)]
pub struct Tries {
    inputs: usize,
    seed: u64,
}

impl Tries {
    /// Some inputs, the same each time.
    pub fn few(inputs: usize) -> Self {
        Self { inputs, seed: 1 }
    }

    /// Many inputs, others each time.
    pub fn many(inputs: usize) -> Self {
        Self { inputs: repetitions(inputs), seed: seed() }
    }

    /// Tries a law, which panics where it does not hold. `tried` and `found` are for the evidence.
    pub fn hold<S: Strategy>(self, tried: &str, found: &str, inputs: &S, law: impl Fn(S::Value))
    where
        S::Value: Debug,
    {
        let config = Config {
            cases: u32::try_from(self.inputs).expect("a number of cases"),
            failure_persistence: None,
            max_shrink_iters: 2_000,
            ..Config::default()
        };
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&self.seed.to_le_bytes());
        let random = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
        let mut runner = TestRunner::new_with_rng(config, random);
        if let Err(error) = runner.run(inputs, |input| {
            law(input);
            Ok(())
        }) {
            panic!("{tried}: {error}");
        }
        evidence(tried, &format!("{} random inputs", self.inputs), found);
    }
}
