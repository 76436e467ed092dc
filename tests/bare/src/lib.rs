//! The core in a final artefact without an allocator.
//!
//! Linked as a shared library, this crate holds the whole core and a panic handler, no standard
//! library and no allocator. That it links at all shows that nothing in it uses `alloc`;
//! `cargo xtask test` also checks which symbols it imports.
#![no_std]

use core::hint::black_box;

use plumbline::config::Config;
use plumbline::image::GreyImage;
use plumbline::packet::{Deframer, FRAME_BYTES_MAX, encode_frame};
use plumbline::pipeline::Pipeline;
use static_cell::ConstStaticCell;

const WIDTH: usize = 1456;
const HEIGHT: usize = 1088;

static PIPELINE: ConstStaticCell<Pipeline> = ConstStaticCell::new(Pipeline::new());
static GREY: ConstStaticCell<[u8; WIDTH * HEIGHT]> = ConstStaticCell::new([0; WIDTH * HEIGHT]);
static DEEP: ConstStaticCell<[u16; WIDTH * HEIGHT]> = ConstStaticCell::new([0; WIDTH * HEIGHT]);

/// Stops. There is nobody here to whom a panic of the core could be reported.
#[cfg(panic = "abort")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}

/// Everything that a box does with the core: reads a configuration, measures frames of both depths,
/// and reads and writes packets. It is never called, only linked.
// The name is the artefact's entry: without an exported function the linker would drop everything.
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
pub extern "C" fn plumbline_bare_step(time_ns: u64) -> usize {
    // Behind `black_box` the compiler cannot know that all input is zero, and must keep all code.
    let bytes: &[u8] = black_box(&[]);
    let (Some(pipeline), Some(grey), Some(deep)) =
        (PIPELINE.try_take(), black_box(GREY.try_take()), black_box(DEEP.try_take()))
    else {
        return 0;
    };
    let Ok(config) = Config::decode(bytes) else { return 0 };
    if pipeline.configure(&config).is_err() {
        return 0;
    }
    let mut measured = 0;
    if let Ok(frame) = GreyImage::new(&grey[..], WIDTH, HEIGHT, WIDTH) {
        measured += measured_in(&pipeline.step(&frame, time_ns));
    }
    if let Ok(frame) = GreyImage::with_white_level(&deep[..], WIDTH, HEIGHT, WIDTH, 1023) {
        measured += measured_in(&pipeline.step(&frame, time_ns));
    }
    let mut answered = 0;
    Deframer::<FRAME_BYTES_MAX>::new().push(bytes, |packet| {
        let mut buffer = [0; FRAME_BYTES_MAX];
        answered += packet
            .ok()
            .and_then(|it| Some(encode_frame(it.start, &it.message, &mut buffer).ok()?.len()))
            .unwrap_or(0);
    });
    black_box(measured + answered)
}

fn measured_in(report: &plumbline::report::Report) -> usize {
    report.targets.iter().filter(|target| target.measurement.is_ok()).count()
}
