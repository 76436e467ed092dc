//! See the module `camera` of `plumbline-laws`.
#![no_main]

libfuzzer_sys::fuzz_target!(init: plumbline_laws::begin("camera"), |input: &[u8]| {
    (plumbline_laws::target("camera").check)(input);
});
