//! See the module `frames` of `plumbline-laws`.
#![no_main]

use plumbline_laws::FRAMES;

libfuzzer_sys::fuzz_target!(init: FRAMES.begin(), |input: &[u8]| (FRAMES.check)(input));
