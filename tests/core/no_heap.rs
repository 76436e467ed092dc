//! `Pipeline::step` allocates nothing, whatever happens to the targets.
//!
//! What the thread of the test allocates is counted; the test runner's own thread, which says
//! that a test takes long, is not.

use plumbline::pipeline::Pipeline;
use plumbline::report::TargetState;
use plumbline_board::allocation::{CountingAllocator, apart};
use recorded::{FRAME_NS, Recorded, place};
use static_cell::ConstStaticCell;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

static PIPELINE: ConstStaticCell<Pipeline> = ConstStaticCell::new(Pipeline::new());

const FRAMES: usize = 1_000;

/// Rendered frames, played forwards and backwards so that the motion has no jump.
const DISTINCT: usize = 12;

/// What is done to a frame before the pipeline sees it.
#[derive(Clone, Copy, PartialEq)]
enum Spoilt {
    No,
    /// Both targets are gone, as when the light goes out.
    Dark,
    /// One target is painted over.
    Without(usize),
    /// The left half of one target is painted over.
    Half(usize),
}

/// Each kind of loss, short (a target coasts through) and long (it is searched for).
fn spoilt(frame: usize) -> Spoilt {
    match frame {
        100..104 | 200..260 => Spoilt::Dark,
        300..303 | 400..450 => Spoilt::Without(0),
        500..503 | 600..650 => Spoilt::Without(1),
        700..720 => Spoilt::Half(0),
        _ => Spoilt::No,
    }
}

#[test]
fn step_allocates_nothing_in_a_thousand_frames_of_losing_and_finding() {
    let ((), counted) = apart(|| drop(std::hint::black_box(vec![0_u8; 100])));
    assert_eq!((counted.count, counted.bytes), (1, 100), "the counter does not count");

    let recorded = Recorded::read(DISTINCT);
    let pipeline = PIPELINE.take();
    pipeline.configure(&recorded.config).unwrap();
    let mut pixels = recorded.frames[0].clone();

    let mut allocated = 0;
    let (mut both, mut none, mut coasting, mut partly, mut found_again) = (0, 0, 0, 0, 0);
    let mut had = [false; 2];
    for frame in 0..FRAMES {
        let place = place(frame, DISTINCT);
        pixels.copy_from_slice(&recorded.frames[place]);
        match spoilt(frame) {
            Spoilt::No => {}
            Spoilt::Dark => pixels.fill(3),
            Spoilt::Without(target) => recorded.cover(place, target, false, &mut pixels),
            Spoilt::Half(target) => recorded.cover(place, target, true, &mut pixels),
        }
        let view = recorded.view(&pixels);
        let (report, counted) = apart(|| pipeline.step(&view, frame as u64 * FRAME_NS));
        allocated += counted.count;

        let measured = [0, 1].map(|target| report.targets[target].measurement.is_ok());
        both += usize::from(measured == [true; 2]);
        none += usize::from(measured == [false; 2]);
        coasting +=
            report.targets.iter().filter(|target| target.state == TargetState::Coasting).count();
        partly += report
            .targets
            .iter()
            .filter_map(|target| target.measurement.as_ref().ok())
            .filter(|found| found.corners < found.corners_total)
            .count();
        found_again += (0..2).filter(|&target| measured[target] && !had[target]).count();
        had = measured;
        if spoilt(frame) == Spoilt::Dark {
            assert_eq!(measured, [false; 2], "frame {frame} is dark");
        }
    }
    println!("both {both}, none {none}, coasting {coasting}, partly {partly}, found {found_again}");
    assert_eq!(allocated, 0);
    // The frames must really have been what this test is about: of 1,000, 810 are untouched.
    assert!(both >= 700, "both targets measured in {both} frames");
    assert!(none >= 64, "no target in {none} frames");
    assert!(coasting >= 10, "{coasting} times coasting");
    assert!(partly >= 10, "{partly} times partly hidden");
    // Both at the start, both after each of two dark spells, each after its own two losses.
    assert!(found_again >= 10, "{found_again} times found");
}
