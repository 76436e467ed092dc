//! See the module `link` of `plumbline-laws`.
#![no_main]

libfuzzer_sys::fuzz_target!(init: plumbline_laws::begin("link"), |input: &[u8]| {
    (plumbline_laws::target("link").check)(input);
});
