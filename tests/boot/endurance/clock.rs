//! Somebody sets the computer's clock, again and again, to any time from 1971 to 2105.

use plumbline_test_support::{evidence, repetitions, seed};

use super::whole;
use crate::machine::{Host, poses};
use crate::scene::{self, RATE_HZ};

/// The times of two frames may be this far apart: the played camera is not always in time.
const GAP_NS_MAX: u64 = 250_000_000;

/// However seldom the clock is set.
const FRAMES_MIN: usize = 200;

/// Frames at the beginning, in which the targets are searched for and the box is still starting.
const STARTING: usize = 100;

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_clock_that_jumps_changes_nothing() {
    let (seed, times) = (seed(), repetitions(500));
    let host = Host::new();
    let directory = tempfile::tempdir().unwrap();
    let disk = scene::boot_disk(directory.path(), &scene::blob(&scene::config(host.address())));
    let options = format!("test.set_clock test.seed={seed}");
    let machine = crate::boot_with_camera(&host, &disk, &options);
    machine.wait_for("poses", |seen| (poses(&seen.udp).count() > FRAMES_MIN).then_some(()));
    // It says so after each ten.
    for time in (10..=times.max(10)).step_by(10) {
        let words = format!("the clock was set {time} times");
        machine.wait_for(&words, |seen| seen.console.contains(&words).then_some(()));
    }
    machine.look(|seen| {
        let all = whole(&seen.udp);
        let last = seen.health().expect("there are some");
        assert_eq!((last.camera_losses, last.heap_allocations), (0, Some(0)), "{last:?}");
        let gaps = all.windows(2).map(|it| it[1].capture_time_ns - it[0].capture_time_ns);
        let gap_ns = gaps.max().expect("there are poses");
        assert!(gap_ns < GAP_NS_MAX, "{gap_ns} ns");
        let worst_us = all.iter().skip(STARTING).map(|it| it.latency_us).max().expect("as above");
        assert!(f64::from(worst_us) < 1e6 / RATE_HZ, "{worst_us} us");
        evidence(
            "the computer's clock set at random, from 1971 to 2105 (booted box)",
            &format!("{} times, in {} frames", times.max(10), all.len()),
            &format!(
                "no frame lost, capture times rise by at most {:.0} ms, latency at most {:.2} ms",
                gap_ns as f64 * 1e-6,
                f64::from(worst_us) * 1e-3
            ),
        );
    });
}
