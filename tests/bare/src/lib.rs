//! The core in a final artefact without an allocator.
//!
//! Linked as a shared library, this crate holds the whole core and a panic handler, no standard
//! library and no allocator. That it links at all shows that nothing in it uses `alloc`;
//! `cargo xtask test` also checks which symbols it imports.
#![no_std]

use core::hint::black_box;

use plumbline::config::Config;
use plumbline::image::GreyImage;
use plumbline::packet::{
    Deframer, FRAME_BYTES_MAX, MarkedInstant, Message, PosePacket, encode_frame,
};
use plumbline::pipeline::Pipeline;
use plumbline::seal::{
    BoxEnd, Heard, Key, OneWay, Peer, SEALED_BYTES_MAX, StreamRing, StreamSealer,
};
use static_cell::ConstStaticCell;

const WIDTH: usize = 1456;
const HEIGHT: usize = 1088;

static PIPELINE: ConstStaticCell<Pipeline> = ConstStaticCell::new(Pipeline::new());
static GREY: ConstStaticCell<[u8; WIDTH * HEIGHT]> = ConstStaticCell::new([0; WIDTH * HEIGHT]);
static RING: ConstStaticCell<StreamRing> = ConstStaticCell::new(StreamRing::new());
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
/// reads and writes packets, and seals and opens them. It is never called, only linked.
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
        let report = pipeline.step(&frame, time_ns);
        let pose = PosePacket::from_report(&report, MarkedInstant::FrameArrival, 0);
        measured += sealed(bytes, &Message::Pose(pose), time_ns).unwrap_or(0);
        measured += measured_in(&report);
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

/// What a box does with the link: takes packets, and seals its own, with and without a way back.
fn sealed(bytes: &[u8], message: &Message, time_ns: u64) -> Option<usize> {
    let ring = RING.try_take()?;
    let secret: &[u8; 32] = bytes.first_chunk()?;
    let key = Key::new(*secret).ok()?;
    let mut buffer = [0; SEALED_BYTES_MAX];
    let announcement = OneWay::read(&key, bytes)?;
    let mut length = announcement.packet(&key, &mut buffer).len();
    length += StreamSealer::one_way(&key, &announcement).seal(message, &mut buffer).ok()?.len();
    let mut end = BoxEnd::new(Some(key), announcement.start, secret);
    if let Heard::Message { listener, message, .. } =
        end.receive(Peer::Serial, bytes, time_ns, || *secret, &mut buffer)
    {
        length += end.seal_to(listener, &message, &mut buffer)?.ok()?.1.len();
        end.resend(listener, 0, time_ns, time_ns);
        length += end.next_resend(listener, ring, &mut buffer)?.1.len();
    }
    let (counter, packet) = end.seal_to_all(message, &mut buffer).ok()?;
    ring.push(counter, packet);
    end.pass(time_ns);
    Some(length + end.announcement(&mut buffer).len())
}

fn measured_in(report: &plumbline::report::Report) -> usize {
    report.targets.iter().filter(|target| target.measurement.is_ok()).count()
}
