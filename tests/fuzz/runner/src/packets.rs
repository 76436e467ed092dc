//! See the module `packets` of `plumbline-laws`.
#![no_main]

libfuzzer_sys::fuzz_target!(init: plumbline_laws::begin("packets"), |input: &[u8]| {
    (plumbline_laws::target("packets").check)(input);
});
