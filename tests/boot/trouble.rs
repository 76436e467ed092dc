//! What happens to a box: the power goes, the camera's plug is pulled, the
//! program hangs.

use std::thread::sleep;
use std::time::Duration;

use plumbline::packet::{CameraState, Hello, Message, ResetReason};
use plumbline_test_support::evidence;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::machine::{Host, Machine, Parts, Seen, healths, image, is_measured, poses, read};
use crate::scene;

fn first_pose(seen: &Seen) -> Option<()> {
    poses(&seen.udp).any(is_measured).then_some(())
}

#[test]
fn after_a_power_cut_at_any_moment_the_next_boot_tracks() {
    let seed = rand::random();
    println!("power cuts: seed {seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let directory = tempfile::tempdir().unwrap();
    let host = Host::new();
    let disk = scene::boot_disk(directory.path(), &scene::blob(&scene::config(host.address())));
    let before = read(&disk);
    for cut in 1..=5 {
        // From the kernel's first steps until well into the tracking, on a quiet machine.
        let moment = Duration::from_millis(random.random_range(0..15_000));
        let machine = crate::boot_with_camera(&host, &disk, "");
        sleep(moment);
        let tracked = machine.look(|seen| first_pose(seen).is_some());
        drop(machine);
        println!("cut {cut} after {moment:?}, tracking: {tracked}");
        // A start sees nothing else of the one before: after each of these cuts the next boot is the
        // same.
        assert!(read(&disk) == before, "the settings partition was written to");
    }
    let machine = crate::boot_with_camera(&host, &disk, "");
    machine.wait_for("a pose after the power cuts", first_pose);
}

/// The last number of seconds in the first line of the console with this text.
fn seconds_in_line(console: &str, text: &str) -> Option<f64> {
    let line = console.lines().find(|line| line.contains(text))?;
    line.split_whitespace().rev().find_map(|word| word.parse().ok())
}

#[test]
fn a_camera_whose_plug_is_pulled_is_reported_within_a_second_and_tracked_again() {
    let host = Host::new();
    let directory = tempfile::tempdir().unwrap();
    let disk = scene::boot_disk(directory.path(), &scene::blob(&scene::config(host.address())));
    let options = "test.disconnect_after=5 test.disconnect_for=4";
    let machine = crate::boot_with_camera(&host, &disk, options);
    machine.wait_for("a Health that says the camera is lost", |seen| {
        healths(&seen.udp).any(|health| health.camera == CameraState::Lost).then_some(())
    });
    machine.wait_for("poses after the camera's return", |seen| {
        let lost = seen.udp.iter().position(
            |message| matches!(message, Message::Health(health) if health.camera == CameraState::Lost),
        )?;
        let back = poses(&seen.udp[lost..]).filter(|pose| is_measured(pose)).count();
        let health = seen.health()?;
        (back >= 20 && health.camera == CameraState::Running).then_some(())
    });
    machine.look(|seen| {
        let healths: Vec<_> = healths(&seen.udp).collect();
        let last = healths.last().expect("there are some");
        assert_eq!(last.camera_losses, 1);
        assert_eq!(last.heap_allocations, Some(0));
        // Both on the clock that starts with the kernel. The session's own starts when the
        // self-test has passed, or a little later: that makes the sum below the larger.
        let pulled_s = seconds_in_line(&seen.console, "plug is pulled").expect("on the console");
        let session_s = seconds_in_line(&seen.console, "self-test passed");
        let lost = healths.iter().find(|health| health.camera == CameraState::Lost);
        let said_s =
            session_s.expect("on the console") + lost.expect("waited for").uptime_ms as f64 * 1e-3;
        println!("plug pulled at {pulled_s:.2} s, said at {said_s:.2} s");
        assert!((pulled_s - 0.1..pulled_s + 1.0).contains(&said_s));
    });
}

#[test]
fn a_loop_that_hangs_is_restarted_by_the_watchdog_which_the_next_hello_says() {
    let host = Host::new();
    let directory = tempfile::tempdir().unwrap();
    let disk = scene::boot_disk(directory.path(), &scene::blob(&scene::config(host.address())));
    let options = "plumbline.hang_after=60";
    let machine = crate::boot_with_camera(&host, &disk, options);
    let hellos = |seen: &Seen| -> Vec<Hello> {
        let hello = |message: &Message| match message {
            Message::Hello(hello) => Some(hello.clone()),
            _ => None,
        };
        seen.udp.iter().filter_map(hello).collect()
    };
    let first = machine.wait_for("the first Hello", |seen| hellos(seen).first().cloned());
    assert_eq!(first.reset_reason, ResetReason::PowerOn);
    let second = machine.wait_for("the Hello of a second start", |seen| {
        hellos(seen).into_iter().find(|hello| hello.boot_id != first.boot_id)
    });
    assert_eq!(second.reset_reason, ResetReason::Watchdog);
    // It was that loop: no frame after the sixtieth was ever processed, in either boot.
    let last = machine.look(|seen| poses(&seen.udp).map(|pose| pose.sequence).max());
    assert!(last.is_some_and(|last| (30..60).contains(&last)), "{last:?}");
}

#[test]
fn a_start_that_hangs_is_reported_and_restarted_by_the_watchdog() {
    let directory = tempfile::tempdir().unwrap();
    let parts = Parts {
        kernel: image("vmlinuz"),
        initramfs: vec![image("initramfs")],
        command_line: "plumbline.hang_at_start=2",
        boot_disk: &scene::empty_disk(directory.path()),
        boot_disk_options: "",
        frames_disk: None,
        device_tree: None,
    };
    let machine = Machine::start(&parts, &Host::new());
    let starts = |seen: &Seen| seen.console.matches("boot: started").count();
    machine.wait_for("a second start", |seen| (starts(seen) == 2).then_some(()));
    machine.look(|seen| {
        assert!(
            seen.console.contains("the start has not come to an end in 2."),
            "{}",
            seen.console
        );
        // The program would have restarted the computer itself, but later.
        assert!(!seen.console.contains("restarting"), "{}", seen.console);
    });
    evidence(
        "a box whose start hangs before the camera",
        "1 start",
        "reported, and reset by the watchdog",
    );
}
