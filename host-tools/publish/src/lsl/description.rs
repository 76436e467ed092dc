//! What a stream says of itself, by the conventions of XDF, the file format of LSL's recorder
//! (<https://github.com/sccn/xdf/wiki/Meta-Data>), and the values of its channels.

use plumbline::packet::{AnatomicalPoint, MeasuredPose};
use plumbline::report::TargetState;
use plumbline::target::Role;
use plumbline_stream::recorder::role_word;

use crate::item::{Gap, Sample, Stream};
use crate::json::lines::instant_words;

/// An element of XML.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Element {
    pub name: &'static str,
    pub content: Content,
}

/// What is in an element.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Content {
    Text(String),
    Elements(Vec<Element>),
}

fn text(name: &'static str, value: impl ToString) -> Element {
    Element { name, content: Content::Text(value.to_string()) }
}

fn group(name: &'static str, elements: Vec<Element>) -> Element {
    Element { name, content: Content::Elements(elements) }
}

/// The targets that have channels, in their order.
const TARGETS: [Role; 2] = [Role::Lower, Role::Upper];

/// The channels of one target: the end of the label, XDF's type, unit.
const OF_TARGET: [(&str, &str, &str); 19] = [
    ("ap", "PositionY", "millimeters"),
    ("ml", "PositionX", "millimeters"),
    ("si", "PositionZ", "millimeters"),
    ("cam_x", "PositionX", "millimeters"),
    ("cam_y", "PositionY", "millimeters"),
    ("cam_z", "PositionZ", "millimeters"),
    ("theta1", "OrientationZ", "radians"),
    ("theta2", "OrientationY", "radians"),
    ("theta3", "OrientationX", "radians"),
    ("sd_cam_x", "Confidence", "millimeters"),
    ("sd_cam_y", "Confidence", "millimeters"),
    ("sd_cam_z", "Confidence", "millimeters"),
    ("sd_turn_x", "Confidence", "radians"),
    ("sd_turn_y", "Confidence", "radians"),
    ("sd_turn_z", "Confidence", "radians"),
    ("rms", "Confidence", "pixels"),
    ("corners", "Confidence", "count"),
    ("state", "Confidence", "0 acquiring, 1 coasting, 2 tracking"),
    ("delay", "Time", "seconds"),
];

/// The channels of the frame, after the targets'.
const OF_FRAME: [(&str, &str, &str); 4] = [
    ("frame", "Count", "count"),
    ("session", "Count", "count"),
    ("latency", "Time", "seconds"),
    ("time_error", "Time", "seconds"),
];

/// The number of channels.
pub(super) const CHANNELS: usize = TARGETS.len() * OF_TARGET.len() + OF_FRAME.len();

/// The `desc` of a stream of frames.
pub(super) fn of_frames(stream: &Stream) -> Vec<Element> {
    let hello = &stream.hello;
    let channel = |object: &'static str, (label, kind, unit): (&str, &str, &str)| {
        let label = if object == "frame" { label.to_owned() } else { format!("{object}_{label}") };
        let parts = vec![
            text("label", label),
            text("object", object),
            text("type", kind),
            text("unit", unit),
        ];
        group("channel", parts)
    };
    let of_targets =
        TARGETS.iter().flat_map(|role| OF_TARGET.map(|it| channel(role_word(*role), it)));
    let channels = of_targets.chain(OF_FRAME.map(|it| channel("frame", it))).collect();
    let objects = hello.targets.iter().map(|target| {
        let parts = vec![
            text("name", role_word(target.role)),
            text("label", &target.name),
            text("class", "Printed checkerboard"),
            text("corners", target.corners),
        ];
        group("object", parts)
    });
    vec![
        group("channels", channels),
        group("setup", vec![group("objects", objects.collect())]),
        group(
            "acquisition",
            vec![
                text("manufacturer", "Plumbline"),
                text("model", &hello.firmware),
                text("device", &hello.device),
                text("serial_number", &hello.serial_number),
                text("configuration", format_args!("{:08x}", hello.config_crc)),
                text("host_software", concat!("plumb ", env!("CARGO_PKG_VERSION"))),
                group(
                    "camera",
                    vec![text("width_px", hello.width_px), text("height_px", hello.height_px)],
                ),
            ],
        ),
        group(
            "synchronization",
            vec![
                text(
                    "time_source",
                    format_args!("capture time of each frame: {}", instant_words(stream.instant)),
                ),
                text("time_error_s", format_args!("{:.6}", stream.error_s)),
                text("can_drop_samples", "false"),
            ],
        ),
        text(
            "conventions",
            "ap forward, ml to the person's right, si up; cam: x right, y down, z forward; \
             R = Rz(theta1) Ry(theta2) Rx(theta3); a channel without a value is NaN; a target was \
             exposed its delay after the time of its sample",
        ),
    ]
}

/// The `desc` of a stream of marks.
pub(super) fn of_marks() -> Vec<Element> {
    let parts = vec![text("label", "mark"), text("type", "Marker")];
    vec![group("channels", vec![group("channel", parts)])]
}

/// The values of a frame.
pub(super) fn values(sample: &Sample) -> [f64; CHANNELS] {
    let mut values = [f64::NAN; CHANNELS];
    let (of_targets, of_frame) = values.split_at_mut(TARGETS.len() * OF_TARGET.len());
    for (values, role) in of_targets.chunks_exact_mut(OF_TARGET.len()).zip(TARGETS) {
        let Some(target) = sample.target(role) else { continue };
        values[17] = match target.state {
            TargetState::Acquiring => 0.0,
            TargetState::Coasting => 1.0,
            TargetState::Tracking => 2.0,
        };
        let Ok(pose) = &target.pose else { continue };
        if let Some(AnatomicalPoint { ap_mm, ml_mm, si_mm }) = sample.trunk(role) {
            put(&mut values[0..3], &[ap_mm, ml_mm, si_mm]);
        }
        let MeasuredPose { theta_rad, translation_mm, sd_mm, sd_rad, .. } = pose;
        put(&mut values[3..6], translation_mm);
        put(&mut values[6..9], theta_rad);
        put(&mut values[9..12], sd_mm);
        put(&mut values[12..15], sd_rad);
        put(&mut values[15..16], &[pose.rms_px]);
        values[16] = pose.corners.into();
        values[18] = 1e-9 * f64::from(pose.delay_ns);
    }
    let latency_s = 1e-6 * f64::from(sample.packet.latency_us);
    let number = f64::from(sample.packet.sequence);
    of_frame.copy_from_slice(&[number, sample.session.into(), latency_s, sample.error_s]);
    values
}

fn put(to: &mut [f64], from: &[f32]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = (*from).into());
}

/// The values of a frame that has not come; without a number, of an unknown number of frames.
pub(super) fn nothing(session: u32, number: Option<u32>) -> [f64; CHANNELS] {
    let mut values = [f64::NAN; CHANNELS];
    values[CHANNELS - OF_FRAME.len()] = number.map_or(f64::NAN, f64::from);
    values[CHANNELS - OF_FRAME.len() + 1] = session.into();
    values
}

/// The number of a missing frame, counted from 0.
pub(super) fn missing(gap: &Gap, index: u32) -> [f64; CHANNELS] {
    nothing(gap.session, Some(gap.first.wrapping_add(index)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::json::lines::tests::{covered, sample, stream};

    fn find<'a>(elements: &'a [Element], name: &str) -> &'a Content {
        &elements.iter().find(|it| it.name == name).expect(name).content
    }

    /// The labels and the values of a frame.
    fn labelled(sample: &Sample) -> Vec<(String, f64)> {
        let desc = of_frames(&stream());
        let Content::Elements(channels) = find(&desc, "channels") else { panic!("no channels") };
        let labels = channels.iter().map(|channel| {
            let Content::Elements(parts) = &channel.content else { panic!("an empty channel") };
            let Content::Text(label) = find(parts, "label") else { panic!("no label") };
            label.clone()
        });
        labels.zip(values(sample)).collect()
    }

    #[test]
    fn each_channel_has_its_value() {
        let sample = sample(120);
        let found = labelled(&sample);
        assert_eq!(found.len(), CHANNELS);
        let of = |label: &str| found.iter().find(|(it, _)| it == label).expect(label).1;
        for (label, wanted) in [
            ("lower_ap", 4.25),
            ("lower_ml", -1.5),
            ("upper_si", 1403.0),
            ("upper_cam_z", 1000.0),
            ("lower_state", 2.0),
            ("lower_corners", 30.0),
            ("upper_delay", 0.0),
            ("frame", 120.0),
            ("session", 1.0),
            ("latency", 0.0012),
            ("time_error", 0.00021),
        ] {
            assert!((of(label) - wanted).abs() < 1e-9, "{label}: {}", of(label));
        }
        for (label, wanted) in [
            ("upper_theta3", -0.1_f32),
            ("lower_sd_cam_z", 0.02),
            ("lower_sd_turn_x", 0.0001),
            ("lower_rms", 0.03),
        ] {
            assert!((of(label) - f64::from(wanted)).abs() < 1e-12, "{label}: {}", of(label));
        }
        assert!(found.iter().all(|(_, value)| value.is_finite()));
    }

    #[test]
    fn what_is_not_there_is_nan() {
        for (label, value) in labelled(&covered(7)) {
            let is_absent = label.starts_with("upper_") && label != "upper_state";
            assert_eq!(value.is_nan(), is_absent, "{label}");
        }
        let gap = Gap { session: 3, first: 10, count: 4, before_ns: 0.0, after_ns: 50.0 };
        let values = missing(&gap, 2);
        assert_eq!(values[CHANNELS - 4..CHANNELS - 2], [12.0, 3.0]);
        assert_eq!(values.iter().filter(|it| it.is_finite()).count(), 2);
        assert!((gap.host_ns(2) - 30.0).abs() < 1e-9);
    }
}
