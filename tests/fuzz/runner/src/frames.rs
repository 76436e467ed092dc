//! See the module `frames` of `plumbline-laws`.
#![no_main]

libfuzzer_sys::fuzz_target!(init: plumbline_laws::begin("frames"), |input: &[u8]| {
    (plumbline_laws::target("frames").check)(input);
});
