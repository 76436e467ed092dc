//! See the module `config` of `plumbline-laws`.
#![no_main]

libfuzzer_sys::fuzz_target!(init: plumbline_laws::begin("config"), |input: &[u8]| {
    (plumbline_laws::target("config").check)(input);
});
