//! See the module `requests` of `plumbline-laws`.
#![no_main]

use plumbline_laws::REQUESTS;

libfuzzer_sys::fuzz_target!(init: REQUESTS.begin(), |input: &[u8]| (REQUESTS.check)(input));
