//! See the module `tables` of `plumbline-laws`.
#![no_main]

use plumbline_laws::TABLES;

libfuzzer_sys::fuzz_target!(init: TABLES.begin(), |input: &[u8]| (TABLES.check)(input));
