//! A trial as rows: one for each frame that the camera took, also for those that never came.

use plumbline_files::BadInput;
use plumbline_trial::Trial;
use plumbline_trial::frame::Frame;

/// Ten hours at 200 Hz.
const ROWS_MAX: usize = 7_200_000;

/// A larger step of the frames' numbers is one back, of a packet that was overtaken.
const STEP_MAX: u32 = u32::MAX / 2;

/// One row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row<'a> {
    /// The box's run, from 1.
    pub session: u32,
    /// The number that the box gave the frame.
    pub sequence: u32,
    /// Time since the trial's first frame; that of a frame that never came lies evenly between those
    /// of its neighbours.
    pub time_s: f64,
    /// The frame; `None` if it never came.
    pub frame: Option<&'a Frame>,
}

/// The rows of a trial.
///
/// # Errors
/// When a gap is so long that its rows would fill the memory.
pub fn of(trial: &Trial) -> Result<Vec<Row<'_>>, BadInput> {
    let mut rows: Vec<Row<'_>> = Vec::with_capacity(trial.frames.len());
    for frame in &trial.frames {
        let before = rows.last().copied().filter(|before| before.session == frame.session);
        if let Some(before) = before {
            let step = frame.sequence.wrapping_sub(before.sequence);
            let missing = if step > STEP_MAX { 0 } else { step.saturating_sub(1) };
            if rows.len() + missing as usize > ROWS_MAX {
                return Err(BadInput::whole(
                    trial.folder.display(),
                    format!("more than {ROWS_MAX} frames, most of them in gaps"),
                    "open a trial without such a pause",
                ));
            }
            let period_s = (frame.time_s - before.time_s) / f64::from(missing + 1);
            rows.extend((1..=missing).map(|at| Row {
                session: frame.session,
                sequence: before.sequence.wrapping_add(at),
                time_s: before.time_s + f64::from(at) * period_s,
                frame: None,
            }));
        }
        let Frame { session, sequence, time_s, .. } = *frame;
        rows.push(Row { session, sequence, time_s, frame: Some(frame) });
    }
    Ok(rows)
}
