//! The stack that `Pipeline::step` needs.
//!
//! The test starts itself again with various stacks, and bisects to the smallest with which the
//! child survives. The figure contains the little that a thread needs for itself.

use std::env;
use std::process::Stdio;
use std::thread;

use plumbline::pipeline::Pipeline;
use plumbline_test_support::command;
use recorded::{FRAME_NS, Recorded};
use static_cell::ConstStaticCell;

/// The bound of the frame path.
const STACK_BYTES_MAX: usize = 64 * 1024;

/// Resolution of the measurement: the result may be too high by this much.
const GRAIN_BYTES: usize = 4 * 1024;

/// The operating system gives no thread less than this.
const THREAD_STACK_BYTES_MIN: usize = 16 * 1024;

/// Set in the child: the stack of the thread that calls `step`.
const CHILD: &str = "PLUMBLINE_TEST_STACK_BYTES";

static PIPELINE: ConstStaticCell<Pipeline> = ConstStaticCell::new(Pipeline::new());

/// Search, tracking and loss of both targets on a thread with this stack.
fn track_with(stack_bytes: usize) {
    let recorded = Recorded::read(3);
    let dark = vec![3; recorded.frames[0].len()];
    let pipeline = PIPELINE.take();
    pipeline.configure(&recorded.config).unwrap();
    let found = thread::scope(|scope| {
        let body = || {
            let mut found = [0; 4];
            for (place, pixels) in recorded.frames.iter().chain([&dark]).enumerate() {
                let report = pipeline.step(&recorded.view(pixels), place as u64 * FRAME_NS);
                for target in &report.targets {
                    found[place] += usize::from(target.measurement.is_ok());
                }
            }
            found
        };
        let stepper = thread::Builder::new().stack_size(stack_bytes).spawn_scoped(scope, body);
        stepper.expect("a thread with a small stack").join().expect("step does not panic")
    });
    assert_eq!(found, [2, 2, 2, 0]);
}

#[test]
fn step_stays_within_its_stack() {
    if let Ok(bytes) = env::var(CHILD) {
        track_with(bytes.parse().expect("a number of bytes"));
        return;
    }
    let survives = |bytes: usize| {
        command(env::current_exe().expect("the test's own program"))
            .args(["--exact", "stack::step_stays_within_its_stack", "--nocapture"])
            .env(CHILD, bytes.to_string())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .expect("the test starts itself")
            .success()
    };
    assert!(survives(1024 * 1024), "the run fails for a reason other than its stack");
    // The smallest number of grains with which the child survives lies above one that is too small,
    // and is at most one that is enough.
    let (mut too_small, mut enough) =
        (THREAD_STACK_BYTES_MIN / GRAIN_BYTES, 1024 * 1024 / GRAIN_BYTES);
    while enough - too_small > 1 {
        let middle = (too_small + enough) / 2;
        if survives(middle * GRAIN_BYTES) {
            enough = middle;
        } else {
            too_small = middle;
        }
    }
    let bytes = enough * GRAIN_BYTES;
    println!("step needs at most {} KiB of stack, the thread's own share included", bytes / 1024);
    assert!(bytes <= STACK_BYTES_MAX, "step needs {bytes} bytes of stack");
}
