//! The plug of a USB camera is pulled in the middle of a frame, and put back later. The camera is the
//! virtual one that the kernel's own USB and camera drivers find: QEMU has none.

use plumbline::packet::CameraState;
use plumbline_test_support::{evidence, repetitions, seed};

use super::{median, ms, whole};
use crate::formats;
use crate::machine::{Host, Seen, healths, is_measured, poses};

/// A camera that is plugged in again gives a pose within this time, the kernel's search for it
/// included.
const BACK_WITHIN_US: u64 = 1_000_000;

/// The times of what the guest says with these words.
fn moments_ns(seen: &Seen, words: &str) -> Vec<u64> {
    let begins = seen.console.match_indices(words);
    let after = begins.filter_map(|(at, _)| seen.console[at + words.len()..].split_once(" ns"));
    after.filter_map(|(number, _)| number.parse().ok()).collect()
}

const BACK: &str = "test: the camera is plugged in at ";

/// How long after this instant the first pose was there for which something holds.
fn first_pose_us(
    seen: &Seen,
    since_ns: u64,
    is_one: impl Fn(&plumbline::packet::PosePacket) -> bool,
) -> Option<u64> {
    let there = poses(&seen.udp).filter(|pose| pose.capture_time_ns > since_ns && is_one(pose));
    let there_us =
        there.map(|pose| (pose.capture_time_ns - since_ns) / 1_000 + u64::from(pose.latency_us));
    there_us.min()
}

#[test]
#[ignore = "takes a quarter of an hour: cargo xtask test endurance"]
fn a_camera_is_back_within_a_second_of_its_return() {
    let (seed, times) = (seed(), repetitions(100));
    let host = Host::new();
    let directory = tempfile::tempdir().unwrap();
    let options = format!("test.unplug={times} test.seed={seed}");
    let sent = formats::mosaic();
    let machine = sent.start(&host, directory.path(), &options);
    let (mut back_us, mut measured_us) = (Vec::new(), Vec::new());
    // The first one is the start.
    for time in 0..=times {
        let (first, measured) = machine.wait_for("poses after the camera's return", |seen| {
            let since_ns = *moments_ns(seen, BACK).get(time)?;
            let measured = first_pose_us(seen, since_ns, is_measured)?;
            Some((first_pose_us(seen, since_ns, |_| true)?, measured))
        });
        if time > 0 {
            println!("return {time}: a frame after {}, a pose after {}", ms(first), ms(measured));
            back_us.push(first);
            measured_us.push(measured);
        }
    }
    let health = machine.wait_for("a Health after the last return", |seen| {
        let last = whole(&seen.udp).last().map(|pose| pose.sequence)?;
        seen.health().filter(|it| it.frames > last && it.camera_losses as usize == times).cloned()
    });
    machine.look(|seen| {
        assert!(healths(&seen.udp).all(|health| health.heap_allocations == Some(0)), "{health:?}");
        assert_eq!(health.camera, CameraState::Running);
    });
    let in_time = back_us.iter().filter(|&&us| us <= BACK_WITHIN_US).count();
    let worst = |all: &[u64]| ms(all.iter().copied().max().unwrap_or(0));
    evidence(
        "a USB camera unplugged in the middle of a frame and plugged in again (booted box, the \
         kernel's USB and camera drivers, the emulator's clock)",
        &format!("{times} times"),
        &format!(
            "{in_time} of {times} back within 1 s: a frame after {} (median), {} (worst), poses of \
             both targets after {} (worst); {} losses counted in Health",
            ms(median(back_us.clone())),
            worst(&back_us),
            worst(&measured_us),
            health.camera_losses
        ),
    );
    assert_eq!(in_time, times, "{back_us:?}");
}
