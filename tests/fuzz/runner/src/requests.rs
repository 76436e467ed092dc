//! See the module `requests` of `plumbline-laws`.
#![no_main]

libfuzzer_sys::fuzz_target!(init: plumbline_laws::begin("requests"), |input: &[u8]| {
    (plumbline_laws::target("requests").check)(input);
});
