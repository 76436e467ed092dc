//! See the module `config` of `plumbline-laws`.
#![no_main]

use plumbline_laws::CONFIG;

libfuzzer_sys::fuzz_target!(init: CONFIG.begin(), |input: &[u8]| (CONFIG.check)(input));
