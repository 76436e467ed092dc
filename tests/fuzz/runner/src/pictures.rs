//! See the module `pictures` of `plumbline-laws`.
#![no_main]

libfuzzer_sys::fuzz_target!(init: plumbline_laws::begin("pictures"), |input: &[u8]| {
    (plumbline_laws::target("pictures").check)(input);
});
