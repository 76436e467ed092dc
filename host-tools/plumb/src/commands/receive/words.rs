//! The summary at the end of a reception.

use std::io::Write;

use comfy_table::{Table, presets};
use plumbline::packet::{CameraState, Hello};
use plumbline_bedside::recording::Here;
use plumbline_files::counting::counted;
use plumbline_stream::receiver::Receiver;

/// The table at the end.
pub(super) fn summary<W: Write>(receiver: &Receiver<W>, here: &Here) -> String {
    let counts = receiver.counts();
    let (bad, left_out) = (receiver.bad(), receiver.left_out());
    let mut table = Table::new();
    table.load_style(presets::UTF8_BORDERS_ONLY);
    for (what, value) in boxes(receiver) {
        table.add_row([what.to_owned(), value]);
    }
    let percent = |part: u64, whole: u64| 100.0 * part as f64 / (whole.max(1)) as f64;
    let lost = percent(counts.lost, counts.received + counts.lost);
    table.add_row(["frames received".to_owned(), counts.received.to_string()]);
    table.add_row(["lost".to_owned(), format!("{} ({lost:.2} %)", counts.lost)]);
    let mut rows = vec![
        ("repeated", counts.repeated),
        ("late", counts.late),
        ("corrupt", bad.corrupt),
        ("of another version", bad.other_version),
        ("of another schema", bad.other_schema),
        ("starts of the box", u64::from(receiver.sessions())),
    ];
    // These are rare enough to be named only when they are there.
    for row in [
        ("not authentic", bad.not_authentic),
        ("dropped by this computer, asked for again", here.dropped.unwrap_or(0)),
        ("malformed", bad.malformed),
        ("implausible", counts.implausible + bad.numbers),
        ("of another box", left_out.other_box),
        ("of a second box of this name", left_out.conflicting),
        ("of a start without a name", left_out.unknown_start),
        ("cut at the start", bad.fragments),
        ("serial line lost", receiver.line_losses()),
    ] {
        if row.1 > 0 {
            rows.push(row);
        }
    }
    if let Some(health) = receiver.health() {
        rows.push(("frames the box dropped", u64::from(health.frames_dropped)));
        rows.push(("frames the camera missed", u64::from(health.frames_missed)));
        rows.push(("corners the box dropped", u64::from(health.corners_dropped)));
    }
    for (what, count) in rows {
        table.add_row([what.to_owned(), count.to_string()]);
    }
    if let Some(camera) = camera_at_the_end(receiver) {
        table.add_row(["the box's camera".to_owned(), camera]);
    }
    for (what, is_so, word) in [
        ("the box's power supply", receiver.power().undervoltage, "too weak"),
        ("the box's processor", receiver.power().throttled, "slowed down"),
    ] {
        if is_so == Some(true) {
            table.add_row([what, word]);
        }
    }
    for (name, share) in receiver.shares() {
        let percent = percent(share.poses, share.frames);
        table.add_row([
            format!("{name} with pose"),
            format!("{} of {} ({percent:.2} %)", share.poses, share.frames),
        ]);
    }
    table.to_string()
}

/// Who was heard. Where it was not one box in one configuration all the time,
/// also how many frames came from each.
fn boxes<W: Write>(receiver: &Receiver<W>) -> Vec<(&'static str, String)> {
    let identity = |hello: &Hello| {
        let name = format!("{} ({})", hello.device, hello.serial_number);
        [name, hello.firmware.to_string(), format!("{:08x}", hello.config_crc)]
    };
    let mut boxes: Vec<(Option<[String; 3]>, u64)> = Vec::new();
    for run in receiver.runs() {
        let who = run.hello.as_ref().map(identity);
        match boxes.iter_mut().find(|(known, _)| *known == who) {
            Some((_, frames)) => *frames += run.frames,
            // Nothing is to be said of a start that was only heard of.
            None if who.is_none() && run.frames == 0 => {}
            None => boxes.push((who, run.frames)),
        }
    }
    if let [(who, _)] = &boxes[..] {
        let Some([name, program, configuration]) = who.clone() else { return Vec::new() };
        return vec![("box", name), ("its program", program), ("its configuration", configuration)];
    }
    let described = boxes.into_iter().map(|(who, frames)| match who {
        Some([name, program, configuration]) => {
            let frames = counted(frames, "frame");
            format!("{name}, program {program}, configuration {configuration}: {frames}")
        }
        None => format!("one that did not give its name: {}", counted(frames, "frame")),
    });
    described.map(|text| ("box", text)).collect()
}

/// What became of the camera in the last run.
fn camera_at_the_end<W: Write>(receiver: &Receiver<W>) -> Option<String> {
    let (camera, health) = (receiver.camera()?, receiver.health()?);
    let losses = counted(health.camera_losses, "time");
    Some(match camera.state {
        CameraState::Lost | CameraState::Stalled if health.frames == 0 => {
            "never gave a frame".into()
        }
        CameraState::Lost | CameraState::Stalled => {
            format!("lost {losses}, absent at the end")
        }
        _ => format!("lost {losses}"),
    })
}

#[cfg(test)]
mod tests;
