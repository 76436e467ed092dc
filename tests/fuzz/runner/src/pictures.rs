//! See the module `pictures` of `plumbline-laws`.
#![no_main]

use plumbline_laws::PICTURES;

libfuzzer_sys::fuzz_target!(init: PICTURES.begin(), |input: &[u8]| (PICTURES.check)(input));
