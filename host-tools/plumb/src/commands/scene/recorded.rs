//! The scene board's poses in recorded frames.

use std::path::PathBuf;

use plumbline::target::Role;
use plumbline_bedside::scene::Seen;
use plumbline_bedside::setup::Descriptions;
use plumbline_calibration::background::REDUCTION;
use plumbline_files::BadInput;
use plumbline_files::frames::FrameSource;
use plumbline_tracking::{Tracker, reduced};

use crate::ui::waiting;

/// Tracks the scene board, and nothing else, through the frames.
pub(super) fn track(descriptions: &Descriptions, inputs: &[PathBuf]) -> anyhow::Result<Seen> {
    let places = descriptions.places();
    let (camera, mut targets, _) = descriptions.read(&mut waiting::shown())?;
    targets.targets.retain(|target| target.geometry.role() == Role::Scene);
    if targets.targets.is_empty() {
        return Err(BadInput::new(
            &places.targets,
            "role",
            "no target has the role \"scene\"",
            "add the board: name, role = \"scene\", columns, rows, pitch_mm",
        )
        .into());
    }
    let mut source = FrameSource::open(inputs, None)?;
    let (_, mut tracker) = Tracker::of_source(&source, false, (&camera, &targets, None), &places)?;
    let mut seen = Seen {
        place: inputs[0].display().to_string(),
        lens: camera.lens,
        frames: 0,
        poses: Vec::new(),
        background: None,
        remedy: "check its columns, rows and light; `plumb track --draw` shows the frames".into(),
    };
    while let Some(frame) = source.next_frame()? {
        seen.frames += 1;
        seen.background.get_or_insert_with(|| reduced(&frame, REDUCTION));
        let report = tracker.step(&frame);
        seen.poses.extend(report.targets[0].measurement.iter().map(|found| found.cam_from_target));
    }
    Ok(seen)
}
