//! What people read: of a fault, which field it is and what it must be; and of an edge, which it is.

use super::*;

/// The fields are named as in the files from which a configuration is made.
#[test]
fn a_fault_names_its_field_and_what_is_allowed() {
    let table: [(ConfigError, &str, &str); 23] = [
        (ConfigError::Readout, "readout_ms", "-1,000 to 1,000"),
        (ConfigError::NoTarget, "targets", "at least one"),
        (ConfigError::Text { field: "device" }, "device", "cannot be seen"),
        (ConfigError::TargetName { index: 2 }, "targets[2].name", "must not be empty"),
        (ConfigError::SameName { first: 0, second: 2 }, "targets[0].name", "targets[2].name"),
        (ConfigError::SameRole { first: 0, second: 2 }, "targets[0].role", "targets[2].role"),
        (ConfigError::SameShape { first: 0, second: 2 }, "targets[0] and targets[2]", "same size"),
        (ConfigError::Scene, "cam_from_scene_theta", "within 2 pi, distances within 100 m"),
        (ConfigError::Udp, "links.udp", "neither address nor port may be 0"),
        (ConfigError::Serial, "links.serial", "1,200 to 12,000,000"),
        (LensError::FocalLength.into(), "lens: fx_px and fy_px", "10 to 100,000 px"),
        (CaptureError::PixelFormat.into(), "capture.pixel_format", "bayer8 and mjpeg need"),
        (CaptureError::Rate.into(), "capture.rate_hz", "1 to 1,000"),
        (CaptureError::Exposure.into(), "capture.exposure_us", "no longer than one frame"),
        (CaptureError::Gain.into(), "capture.gain", "0 or more"),
        (MachineError::Network.into(), "machine.network", "prefix within 1 to 30"),
        (MachineError::RealtimePriority.into(), "machine.realtime_priority", "1 to 99"),
        (MachineError::Watchdog.into(), "machine.watchdog_s", "1 to 600"),
        (TriggerError::Chip.into(), "trigger.chip", "must not be empty"),
        (TriggerError::NoLine.into(), "trigger.line", "output_line"),
        (TriggerError::Line.into(), "trigger.line", "0 to 1023"),
        (TriggerError::OutputLine.into(), "trigger.output_line", "0 to 1023, and not be line"),
        (TriggerError::Debounce.into(), "trigger.debounce_us", "0 to 1000000"),
    ];
    for (error, field, allowed) in table {
        let text = error.to_string();
        assert!(text.starts_with(field) && text.contains(allowed), "{text}");
    }
}

#[test]
fn a_fault_of_the_blob_tells_what_was_found_or_what_to_do() {
    let buffer = std::format!("a buffer of {BLOB_BYTES_MAX} bytes");
    let table: [(ConfigError, &[&str]); 6] = [
        (ConfigError::NotAConfig, &["not a Plumbline configuration"]),
        (ConfigError::Length { expected: 500, found: 499 }, &["has 499", "should have 500"]),
        (ConfigError::Checksum, &["does not agree", "provision the box again"]),
        (ConfigError::Version { found: 5 }, &["is 5", "reads 6", "provision the box again"]),
        (ConfigError::Body, &["checksum agrees", "body is inconsistent"]),
        (ConfigError::BufferTooSmall, &[&buffer]),
    ];
    for (error, parts) in table {
        let text = error.to_string();
        assert!(parts.iter().all(|part| text.contains(part)), "{text}");
    }
}

#[test]
fn an_edge_has_its_words_and_is_among_those_of_its_kind() {
    use Edge::{Falling, Rising};
    assert_eq!([Rising, Falling].map(Edge::words), ["rising edge", "falling edge"]);
    for (edges, contained) in
        [(Edges::Rising, [true, false]), (Edges::Falling, [false, true]), (Edges::Both, [true; 2])]
    {
        assert_eq!([Rising, Falling].map(|edge| edges.contain(edge)), contained, "{edges:?}");
    }
}
