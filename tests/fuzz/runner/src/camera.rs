//! See the module `camera` of `plumbline-laws`.
#![no_main]

use plumbline_laws::CAMERA;

libfuzzer_sys::fuzz_target!(init: CAMERA.begin(), |input: &[u8]| (CAMERA.check)(input));
