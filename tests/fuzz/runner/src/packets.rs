//! See the module `packets` of `plumbline-laws`.
#![no_main]

use plumbline_laws::PACKETS;

libfuzzer_sys::fuzz_target!(init: PACKETS.begin(), |input: &[u8]| (PACKETS.check)(input));
