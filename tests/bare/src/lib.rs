//! The core in a final artefact without an allocator.
//!
//! Linked as a shared library, this crate holds the whole pipeline and a panic
//! handler, no standard library and no allocator. That it links at all shows
//! that nothing in it uses `alloc`; `cargo xtask test` also reads which symbols
//! it asks of others.
#![no_std]

use nalgebra::Vector2;
use plumbline::lens::{Distortion, Lens};

/// Stops. A panic of the core has nobody to be reported to here.
#[cfg(panic = "abort")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}

/// Runs a point through the lens and back.
// The name is the artefact's entry: without an exported function the linker would drop everything.
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
pub extern "C" fn plumbline_bare_step(focal_px: f64) -> f64 {
    let lens = Lens {
        width_px: 1456,
        height_px: 1088,
        fx_px: focal_px,
        fy_px: focal_px,
        cx_px: 727.5,
        cy_px: 543.5,
        skew_px: 0.0,
        distortion: Distortion::Radial2([-0.1, 0.01]),
    };
    lens.ray_from_raw(&Vector2::new(focal_px, focal_px)).map_or(0.0, |ray| ray.x)
}
