//! The poses of the booted box are the truth's, as good as those of the same
//! frames tracked here.

use plumbline::packet::{Message, PacketError, PosePacket, ResetReason};

use crate::machine::{Host, healths, in_order, is_measured, logs, poses};
use crate::scene::{self, FRAMES, Position, RATE_HZ, SCENE, distance_mm};

/// Packets to compare: the frames go by more than four times.
const POSES: usize = 200;

/// Same frame, same core, but another frame before it: the windows around the corners lie
/// where the prediction puts them, up to a pixel elsewhere, so that a little other noise
/// comes in. That is some hundredths of a millimetre, well below the noise of a frame.
const DIFFERENCE_MM_MAX: f64 = 0.1;

/// So much may the spread differ for the same reason, relative to itself.
const SPREAD_DIFFERENCE_MAX: f64 = 0.1;

/// What the process that brings up the network says.
const FROM_DHCP: &str = "10.0.2.15/24 by 10.0.2.2, from a DHCP server";

fn position(pose: &PosePacket, target: usize) -> Position {
    let measured = pose.targets[target].pose.expect("only measured poses are looked at");
    measured.translation_mm.map(f64::from)
}

/// The frame whose pose, measured here, is the nearest; and how near.
fn nearest_frame(pose: &PosePacket, target: usize) -> (usize, f64) {
    let found = position(pose, target);
    let distances = SCENE.offline_mm[target].iter().map(|offline| distance_mm(offline, &found));
    distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).expect("there are frames")
}

/// 1.96 standard deviations of the depth's error.
fn depth_spread_mm(errors_mm: &[f64]) -> f64 {
    let count = errors_mm.len() as f64;
    let mean = errors_mm.iter().sum::<f64>() / count;
    1.96 * (errors_mm.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / count).sqrt()
}

#[test]
fn a_camera_is_tracked_over_both_links_as_well_as_here() {
    let host = Host::new();
    let directory = tempfile::tempdir().unwrap();
    let config = scene::config(host.address());
    let disk = scene::boot_disk(directory.path(), &scene::blob(&config));
    let machine = crate::boot_with_camera(&host, &disk, "");
    machine.wait_for("a run of poses", |seen| {
        let enough = |messages: &[Message]| {
            poses(messages).skip_while(|pose| !is_measured(pose)).count() >= POSES
        };
        (enough(&seen.udp) && enough(&seen.serial)).then_some(())
    });
    let (udp, serial, hello, packets) = machine.look(|seen| {
        let packets = [seen.udp_packets.clone(), seen.serial_packets.clone()];
        (in_order(&seen.udp), in_order(&seen.serial), seen.hello().cloned(), packets)
    });
    drop(machine);

    // Nothing is in clear but who the box is, and nothing is lost, damaged or strange.
    for (way, packets) in ["UDP", "serial"].into_iter().zip(packets) {
        // Until the box has made its line raw, the line says back what it hears. That is a fragment,
        // which only the first frame can be.
        let faults = packets.damaged.iter().filter(|&&it| it != PacketError::Fragment);
        assert_eq!((faults.collect::<Vec<_>>(), packets.not_authentic), (vec![], 0), "{way}");
        assert!(!packets.show(&config.device) && !packets.show(FROM_DHCP), "{way} is in clear");
        let announcements: Vec<_> = packets.announcements().collect();
        assert!(!announcements.is_empty());
        assert!(announcements.iter().all(|it| it.key_id == Some(scene::key().id())));
    }

    // The clock of the capture times starts with the kernel. A host gets also what was measured
    // before the box could be heard.
    let first = poses(&udp).find(|pose| is_measured(pose)).expect("some are");
    let first_s = first.capture_time_ns as f64 * 1e-9 + f64::from(first.latency_us) * 1e-6;
    println!("booted_first_pose_s\t{first_s:.2}");
    assert!(first_s < 10.0, "first pose packet after {first_s} s");

    let hello = hello.expect("a Hello");
    assert_eq!((hello.device.as_str(), hello.config_crc), ("boot test", config.crc()));
    assert_eq!(hello.reset_reason, ResetReason::PowerOn);
    assert_eq!((hello.width_px, hello.height_px), (1280, 720));

    let health = healths(&udp).last().expect("a Health");
    println!("{health:?}");
    assert_eq!(health.heap_allocations, Some(0));
    assert_eq!((health.corners_dropped, health.camera_losses, health.logs_dropped), (0, 0, 0));
    assert!(health.links.len() == 2 && health.links.iter().all(|link| link.packets_sent > 100));

    // What the processes beside the box's own have to say arrives as well.
    assert!(logs(&udp).contains(FROM_DHCP), "{}", logs(&udp));

    // Once it tracks, it goes on. The cable was plugged in while the box already looked.
    let measured: Vec<&PosePacket> = poses(&udp)
        .skip_while(|pose| !is_measured(pose))
        .filter(|pose| is_measured(pose))
        .collect();
    let lost = poses(&udp).skip_while(|pose| !is_measured(pose)).count() - measured.len();
    assert_eq!(lost, 0, "frames without a pose");
    assert_frames_are_those_played(&measured);
    assert_as_good_as_here(&measured);
    assert_latencies(&measured);

    // The same packets on the serial line.
    let mut compared = 0;
    for over_serial in poses(&serial) {
        if let Some(over_udp) = poses(&udp).find(|pose| pose.sequence == over_serial.sequence) {
            assert_eq!(over_udp, over_serial);
            compared += 1;
        }
    }
    // The last few may still be on the slower way.
    assert!(compared + 10 >= POSES, "{compared} packets came both ways");
}

/// Each pose is that of one of the frames, the same for both targets, and they come in
/// the order of playing.
fn assert_frames_are_those_played(measured: &[&PosePacket]) {
    let mut before: Option<(usize, u64)> = None;
    let mut largest_mm = [0.0_f64; 2];
    for pose in measured {
        let found = [0, 1].map(|target| nearest_frame(pose, target));
        for (target, (_, difference_mm)) in found.iter().enumerate() {
            largest_mm[target] = largest_mm[target].max(*difference_mm);
        }
        let [(frame, _), (other, _)] = found;
        assert_eq!(frame, other, "frame {} shows two instants", pose.sequence);
        if let Some((frame_before, time_before_ns)) = before {
            let passed_s = (pose.capture_time_ns - time_before_ns) as f64 * 1e-9;
            // Played and captured are two clocks of one rate: a frame is at times seen
            // twice, or passed over.
            let steps_max = (passed_s * RATE_HZ).round() as usize + 1;
            assert!(frame.abs_diff(frame_before) <= steps_max, "{frame_before} -> {frame}");
        }
        before = Some((frame, pose.capture_time_ns));
    }
    println!("against the same frames tracked here: at most {largest_mm:.5?} mm");
    assert!(largest_mm.iter().all(|&mm| mm < DIFFERENCE_MM_MAX), "{largest_mm:?} mm");
}

/// The depth's spread against the truth is that of the same frames here.
fn assert_as_good_as_here(measured: &[&PosePacket]) {
    for target in 0..2 {
        let (mut booted_mm, mut here_mm) = (Vec::new(), Vec::new());
        for pose in measured {
            let (frame, _) = nearest_frame(pose, target);
            let truth_mm = SCENE.truth_mm[target][frame][2];
            booted_mm.push(position(pose, target)[2] - truth_mm);
            here_mm.push(SCENE.offline_mm[target][frame][2] - truth_mm);
        }
        let (booted_mm, here_mm) = (depth_spread_mm(&booted_mm), depth_spread_mm(&here_mm));
        println!("depth of target {target}: +-{booted_mm:.4} mm booted, +-{here_mm:.4} mm here");
        assert!((booted_mm / here_mm - 1.0).abs() < SPREAD_DIFFERENCE_MAX);
        // The bound of the standard scene, although this one is coarser (f 1150, not 1740 px).
        assert!(booted_mm < 0.25, "+-{booted_mm} mm");
        let frames: std::collections::BTreeSet<usize> =
            measured.iter().map(|pose| nearest_frame(pose, target).0).collect();
        assert!(frames.len() > FRAMES * 9 / 10, "only {} frames were seen", frames.len());
    }
}

/// From the capture to the packet takes some time, and less than until the next frame.
fn assert_latencies(measured: &[&PosePacket]) {
    let mut latencies_us: Vec<u32> = measured.iter().map(|pose| pose.latency_us).collect();
    latencies_us.sort_unstable();
    let median_us = latencies_us[latencies_us.len() / 2];
    let span = measured.last().zip(measured.first()).expect("there are poses");
    let span_s = (span.0.capture_time_ns - span.1.capture_time_ns) as f64 * 1e-9;
    let rate_hz = (measured.len() - 1) as f64 / span_s;
    let worst_us = latencies_us[latencies_us.len() - 1];
    // As `cargo xtask bench` reads it.
    println!("booted_latency_median_us\t{median_us}\nbooted_latency_worst_us\t{worst_us}");
    println!("booted_rate_hz\t{rate_hz:.1}");
    assert!(median_us > 100, "faster than the instructions that it takes");
    assert!(f64::from(median_us) < 1e6 / RATE_HZ, "a frame is late before it is measured");
}
