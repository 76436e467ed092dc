//! What a packet says of a frame and of its poses.

use super::super::*;
use super::*;

#[test]
fn a_target_was_exposed_later_than_its_frame_began() {
    assert_eq!(POSE.own_time_ns(1_000_000_000), 1_007_654_321);
    assert_eq!(POSE.own_time_ns(u64::MAX), u64::MAX);
}

#[test]
fn a_packet_was_handed_over_its_latency_after_its_capture_time() {
    for (capture_time_ns, latency_us, handed_over_ns) in [
        (1_000_000_000, 0, 1_000_000_000),
        (1_000_000_000, 1_500, 1_001_500_000),
        (0, u32::MAX, 4_294_967_295_000),
        // It wraps.
        (u64::MAX, 1, 999),
    ] {
        let packet = PosePacket { capture_time_ns, latency_us, ..pose(1) };
        assert_eq!(packet.handed_over_ns(), handed_over_ns);
    }
}

#[test]
fn a_pose_is_found_by_the_role_of_its_target() {
    let mut packet = pose(3);
    packet.targets[0].pose = Err(NoPose::Searching);
    let scene = packet.targets.pop().unwrap();
    let lower = MeasuredPose { corners: 7, ..POSE };
    packet.targets[1].pose = Ok(lower);
    assert_eq!(packet.pose(Role::Lower), Some(&lower));
    assert_eq!(packet.pose(Role::Upper), None);
    assert_eq!(packet.pose(Role::Scene), None);
    packet.targets.push(scene).unwrap();
    assert_eq!(packet.pose(Role::Scene), Some(&POSE));
}

#[test]
fn standard_deviations_are_rounded_and_saturate() {
    let sent_mm = [0.01234, 6.5535, 7.0];
    let mut packet = pose(1);
    packet.targets[0].pose = Ok(MeasuredPose { sd_mm: sent_mm, rms_px: f32::NAN, ..POSE });
    let Ok(Packet { message: Message::Pose(back), .. }) =
        decode_datagram(&datagram(&Message::Pose(packet)))
    else {
        panic!("a pose packet was sent");
    };
    let back = back.targets[0].pose.unwrap();
    assert_eq!(back.sd_mm, [0.0123, 6.5535, 6.5535]);
    assert_eq!(back.rms_px, 6.5535);
    let largest = [SD_STEP_MM, RMS_STEP_PX].map(|step| (65_535.0 * step) as f32);
    assert_eq!(largest, [back.sd_mm[2], back.rms_px]);
}

#[test]
fn a_covariance_comes_back_to_its_steps() {
    let mut covariance = nalgebra::Matrix6::zeros();
    let sd = [1.2e-4, 0.9e-4, 3.4e-5, 0.004, 0.005, 0.031];
    for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
        let correlation = if i == j { 1.0 } else { 0.9 / (1.0 + (i + j) as f64) };
        covariance[(i, j)] = correlation * sd[i] * sd[j];
    }
    let measurement = crate::fit::measure::Measurement {
        cam_from_target: crate::model::pose::Pose::identity(),
        delay_ns: 0,
        covariance,
        rms_px: 0.05,
        corners: 30,
        corners_total: 30,
    };
    let mut packet = pose(1);
    packet.targets[0].pose = Ok((&measurement).into());
    let Ok(Packet { message: Message::Pose(back), .. }) =
        decode_datagram(&datagram(&Message::Pose(packet)))
    else {
        panic!("a pose packet was sent");
    };
    let back = back.targets[0].pose.unwrap().covariance();
    for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
        // Half a step of a correlation, 0.004, and half a step of each deviation: 1.4 %
        // of the smallest turn, 1.3 % of the smallest distance.
        let error = (back[(i, j)] - covariance[(i, j)]).abs() / (sd[i] * sd[j]);
        assert!(error < 0.04, "{error} at {i}, {j}");
    }
    assert_eq!(back, back.transpose());
}
