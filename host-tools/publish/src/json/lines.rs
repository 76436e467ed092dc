//! The lines; [FORMATS.md](../../../FORMATS.md) describes them.

use plumbline::packet::MarkedInstant;
use plumbline::target::Role;
use plumbline_stream::recorder::role_word;
use serde::Serialize;

use crate::item::{Gap, Item, Marked, Sample, Stream};

/// The version of the format. Fields may be added without a new one.
pub const FORMAT: u32 = 1;

/// The units, by the end of a field's name.
const UNITS: [(&str, &str); 4] =
    [("_s", "seconds"), ("_mm", "millimetres"), ("_rad", "radians"), ("_px", "pixels")];

#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum Line<'a> {
    Stream(StreamLine<'a>),
    Frame(FrameLine<'a>),
    Gap(GapLine),
    Mark(MarkLine<'a>),
    Notice { text: &'a str },
    Dropped { lines: u64 },
    End,
}

#[derive(Serialize)]
struct StreamLine<'a> {
    format: u32,
    program: &'static str,
    units: std::collections::BTreeMap<&'static str, &'static str>,
    axes: &'static str,
    session: Option<u32>,
    time_marks: Option<&'static str>,
    error_s: Option<f64>,
    #[serde(rename = "box")]
    the_box: Option<BoxLine<'a>>,
    targets: Vec<TargetLine<'a>>,
}

#[derive(Serialize)]
struct BoxLine<'a> {
    device: &'a str,
    serial_number: &'a str,
    program: &'a str,
    configuration: String,
    frame_px: [u16; 2],
}

#[derive(Serialize)]
struct TargetLine<'a> {
    role: &'static str,
    name: &'a str,
    corners: u8,
}

#[derive(Serialize)]
struct FrameLine<'a> {
    session: u32,
    frame: u32,
    time_s: f64,
    unix_s: f64,
    error_s: f64,
    latency_s: f64,
    late: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    lower: Option<SeenLine<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    upper: Option<SeenLine<'a>>,
}

#[derive(Serialize)]
struct SeenLine<'a> {
    state: &'static str,
    #[serde(flatten)]
    pose: PoseOrNot<'a>,
}

#[derive(Serialize)]
#[serde(untagged)]
enum PoseOrNot<'a> {
    Pose(PoseLine<'a>),
    Not { no_pose: &'static str },
}

#[derive(Serialize)]
struct PoseLine<'a> {
    delay_s: f64,
    /// AP, ML, SI.
    trunk_mm: Option<[f32; 3]>,
    theta_rad: &'a [f32; 3],
    translation_mm: &'a [f32; 3],
    sd_mm: &'a [f32; 3],
    sd_rad: &'a [f32; 3],
    rms_px: f32,
    corners: u8,
}

#[derive(Serialize)]
struct GapLine {
    session: u32,
    first: u32,
    count: u32,
}

#[derive(Serialize)]
struct MarkLine<'a> {
    label: &'a str,
    source: &'a str,
    time_s: Option<f64>,
    unix_s: f64,
}

/// The line for an item, with its end.
#[must_use]
pub fn line(item: &Item, zero_unix_s: f64) -> String {
    let unix_s = |host_ns: f64| whole_us(zero_unix_s + 1e-9 * host_ns);
    written(&match item {
        Item::Stream(stream) => Line::Stream(stream_line(Some(stream))),
        Item::Frame(sample) => Line::Frame(FrameLine {
            session: sample.session,
            frame: sample.packet.sequence,
            time_s: sample.time_s,
            unix_s: unix_s(sample.host_ns),
            error_s: whole_us(sample.error_s),
            latency_s: whole_us(1e-6 * f64::from(sample.packet.latency_us)),
            late: sample.is_late,
            lower: seen(sample, Role::Lower),
            upper: seen(sample, Role::Upper),
        }),
        Item::Gap(Gap { session, first, count, .. }) => {
            Line::Gap(GapLine { session: *session, first: *first, count: *count })
        }
        Item::Mark(mark) => {
            let Marked { label, source, host_ns, time_s } = &**mark;
            let time_s = time_s.map(whole_us);
            Line::Mark(MarkLine { label, source, time_s, unix_s: unix_s(*host_ns) })
        }
        Item::Notice(text) => Line::Notice { text },
    })
}

/// The line for a client that connects before a box is heard.
pub(super) fn unknown_stream() -> String {
    written(&Line::Stream(stream_line(None)))
}

pub(super) fn notice(text: &str) -> String {
    written(&Line::Notice { text })
}

pub(super) fn dropped(lines: u64) -> String {
    written(&Line::Dropped { lines })
}

pub(super) fn end() -> String {
    written(&Line::End)
}

fn written(line: &Line<'_>) -> String {
    // Maps with text for keys, numbers and texts: nothing of it can fail.
    let mut text = serde_json::to_string(line).unwrap_or_default();
    text.push('\n');
    text
}

/// What a frame's time marks, in words.
#[must_use]
pub fn instant_words(instant: MarkedInstant) -> &'static str {
    match instant {
        MarkedInstant::ExposureMiddle => "middle of the exposure",
        MarkedInstant::ExposureStart => "start of the exposure",
        MarkedInstant::ExposureEnd => "end of the exposure",
        MarkedInstant::FrameArrival => "arrival of the frame at the box",
        MarkedInstant::Recording => "time in the recording that the box replays",
    }
}

fn stream_line(stream: Option<&Stream>) -> StreamLine<'_> {
    let hello = stream.map(|it| &it.hello);
    StreamLine {
        format: FORMAT,
        program: concat!("plumb ", env!("CARGO_PKG_VERSION")),
        units: UNITS.into_iter().collect(),
        axes: "trunk_mm: AP forward, ML to the person's right, SI up; translation_mm: camera, x right, y down, z forward; R = Rz(theta 1) Ry(theta 2) Rx(theta 3)",
        session: stream.map(|it| it.session),
        time_marks: stream.map(|it| instant_words(it.instant)),
        error_s: stream.map(|it| whole_us(it.error_s)),
        the_box: hello.map(|hello| BoxLine {
            device: &hello.device,
            serial_number: &hello.serial_number,
            program: &hello.firmware,
            configuration: format!("{:08x}", hello.config_crc),
            frame_px: [hello.width_px, hello.height_px],
        }),
        targets: hello.map_or(Vec::new(), |hello| {
            let target = hello.targets.iter().map(|target| TargetLine {
                role: role_word(target.role),
                name: &target.name,
                corners: target.corners,
            });
            target.collect()
        }),
    }
}

fn seen(sample: &Sample, role: Role) -> Option<SeenLine<'_>> {
    let target = sample.target(role)?;
    let pose = match &target.pose {
        Err(why) => PoseOrNot::Not { no_pose: why.words() },
        Ok(pose) => PoseOrNot::Pose(PoseLine {
            delay_s: 1e-9 * f64::from(pose.delay_ns),
            trunk_mm: sample.trunk(role).map(|it| [it.ap_mm, it.ml_mm, it.si_mm]),
            theta_rad: &pose.theta_rad,
            translation_mm: &pose.translation_mm,
            sd_mm: &pose.sd_mm,
            sd_rad: &pose.sd_rad,
            rms_px: pose.rms_px,
            corners: pose.corners,
        }),
    };
    Some(SeenLine { state: target.state.word(), pose })
}

/// No clock here is more precise.
fn whole_us(time_s: f64) -> f64 {
    (1e6 * time_s).round() / 1e6
}

#[cfg(test)]
pub(crate) mod tests {
    use std::sync::Arc;

    use plumbline::packet::{AnatomicalPoint, Hello};
    use plumbline::report::{NoPose, TargetState};
    use plumbline_stream::fixture::{config, hello, pose_packet};

    use super::*;

    pub(crate) fn stream() -> Stream {
        Stream {
            session: 1,
            hello: Hello { config_crc: 0x1a2b_3c4d, ..hello(&config()) },
            instant: MarkedInstant::ExposureMiddle,
            error_s: 0.00021,
            zero_unix_s: 1_800_000_000.0,
        }
    }

    pub(crate) fn sample(number: u32) -> Sample {
        let point = |ap_mm, ml_mm, si_mm| Some(AnatomicalPoint { ap_mm, ml_mm, si_mm });
        let mut packet = pose_packet(number);
        packet.lower_trunk = point(4.25, -1.5, 1012.0);
        packet.upper_trunk = point(7.5, -2.25, 1403.0);
        let time_s = f64::from(number) / 60.0;
        Sample {
            session: 1,
            time_s,
            host_ns: 1e9 * (2.0 + time_s),
            error_s: 0.00021,
            is_late: false,
            packet,
        }
    }

    /// A frame in which the upper target is not seen.
    pub(crate) fn covered(number: u32) -> Sample {
        let mut sample = sample(number);
        sample.packet.targets[1].state = TargetState::Coasting;
        sample.packet.targets[1].pose = Err(NoPose::TooFewCorners);
        sample.packet.upper_trunk = None;
        sample
    }

    /// Each example of the page is what is written, line by line.
    #[test]
    fn the_examples_of_the_page_are_true() {
        let page = include_str!("../../FORMATS.md");
        let gap = Gap { session: 1, first: 121, count: 2, before_ns: 0.0, after_ns: 1.0 };
        let mark = Marked {
            label: "stands".to_owned(),
            source: "key".to_owned(),
            host_ns: 4.1e9,
            time_s: Some(2.1),
        };
        let late = Sample { is_late: true, ..covered(121) };
        let items = [
            Item::Stream(Arc::new(stream())),
            Item::Frame(Arc::new(sample(120))),
            Item::Gap(gap),
            Item::Mark(Arc::new(mark)),
            Item::Frame(Arc::new(late)),
            Item::Notice("the box has restarted: session 2 begins".into()),
        ];
        let lines = items.iter().map(|item| line(item, stream().zero_unix_s));
        let wanted: String = lines.chain([dropped(17), end()]).collect();
        let (_, shown) = page.split_once("```json\n").expect("the example");
        let (shown, _) = shown.split_once("```").expect("its end");
        assert_eq!(shown, wanted.replace(env!("CARGO_PKG_VERSION"), "0.1.0"));
    }

    #[test]
    fn before_a_box_is_heard_it_is_null() {
        let line: serde_json::Value = serde_json::from_str(&unknown_stream()).unwrap();
        assert_eq!((&line["kind"], &line["format"]), (&"stream".into(), &FORMAT.into()));
        assert!(line["box"].is_null() && line["targets"].as_array().unwrap().is_empty());
    }
}
