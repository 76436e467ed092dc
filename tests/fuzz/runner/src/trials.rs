//! See the module `trials` of `plumbline-laws`.
#![no_main]

libfuzzer_sys::fuzz_target!(init: plumbline_laws::begin("trials"), |input: &[u8]| {
    (plumbline_laws::target("trials").check)(input);
});
