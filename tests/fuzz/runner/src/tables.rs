//! See the module `tables` of `plumbline-laws`.
#![no_main]

libfuzzer_sys::fuzz_target!(init: plumbline_laws::begin("tables"), |input: &[u8]| {
    (plumbline_laws::target("tables").check)(input);
});
