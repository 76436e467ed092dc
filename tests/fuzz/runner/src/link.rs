//! See the module `link` of `plumbline-laws`.
#![no_main]

use plumbline_laws::LINK;

libfuzzer_sys::fuzz_target!(init: LINK.begin(), |input: &[u8]| (LINK.check)(input));
