//! See the module `trials` of `plumbline-laws`.
#![no_main]

use plumbline_laws::TRIALS;

libfuzzer_sys::fuzz_target!(init: TRIALS.begin(), |input: &[u8]| (TRIALS.check)(input));
