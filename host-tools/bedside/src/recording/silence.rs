//! Why no pose comes, in words, as far as can be told from here.

use std::fmt::Write as _;
use std::io::Write;
use std::time::Instant;

use plumbline::packet::CameraState;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_stream::receiver::Receiver;

/// Why there is no pose now, as far as can be told from here.
#[must_use]
pub fn silence<W: Write>(receiver: &Receiver<W>, now: Instant) -> String {
    let camera = camera_now(receiver, now).map(|camera| format!(", {camera}"));
    let camera = camera.unwrap_or_default();
    if let Some(silence) = receiver.unheard(now) {
        return format!("the box is no longer heard, for {} s", silence.as_secs());
    }
    if let Some(silence) = receiver.silence(now) {
        return format!("no pose for {} s{camera}", silence.as_secs());
    }
    if receiver.is_heard() {
        return format!("the box is heard, no pose yet{camera}");
    }
    let bad = receiver.bad();
    let unusable = bad.not_authentic
        + bad.corrupt
        + bad.other_version
        + bad.other_schema
        + bad.malformed
        + bad.numbers;
    match unusable {
        0 => "no pose yet".to_owned(),
        _ => format!("no pose yet, {}", counted(unusable, "unusable packet")),
    }
}

/// What this computer knows of the link at the end.
#[derive(Debug, Default)]
pub struct Here {
    /// Datagrams that its system has dropped, as far as it tells.
    pub dropped: Option<u64>,
    /// Why there is no session with a box, and what to do, if that is known.
    pub obstacle: Option<(String, String)>,
}

/// The state of the box's camera, and since when.
fn camera_now<W: Write>(receiver: &Receiver<W>, now: Instant) -> Option<String> {
    let (camera, health) = (receiver.camera()?, receiver.health()?);
    let state = match camera.state {
        _ if camera.ended => return Some("the box's program has ended".into()),
        CameraState::Starting => return Some("camera starting".into()),
        CameraState::Running | CameraState::Ended => return Some("camera running".into()),
        CameraState::Stalled => "stalled",
        CameraState::Lost => "lost",
    };
    if health.frames == 0 {
        let uptime_s = health.uptime_ms / 1000;
        return Some(format!("camera {state}: no frame since the box's start {uptime_s} s ago"));
    }
    let more = if camera.from_before { "more than " } else { "" };
    let lost_s = now.saturating_duration_since(camera.since).as_secs();
    Some(format!("camera {state} for {more}{lost_s} s"))
}

/// Checks that the box was heard until the end, and sent poses.
///
/// # Errors
/// When it was not, or did not.
pub fn check_heard<W: Write>(
    receiver: &Receiver<W>,
    here: &Here,
    place: String,
    now: Instant,
) -> Result<(), BadInput> {
    if let Some(silence) = receiver.unheard(now) {
        return Err(BadInput::whole(
            place,
            format!("nothing was heard from the box in the last {} s", silence.as_secs()),
            "check the box's power and its link",
        ));
    }
    if receiver.counts().received == 0 {
        return Err(no_pose(receiver, here, place, now));
    }
    Ok(())
}

/// Why no pose was received, as far as can be told from here.
fn no_pose<W: Write>(receiver: &Receiver<W>, here: &Here, place: String, now: Instant) -> BadInput {
    if !receiver.is_heard() {
        if let Some((why, remedy)) = &here.obstacle {
            return BadInput::whole(place, why, remedy);
        }
        return BadInput::whole(
            place,
            "no pose packet came",
            "check that the box is on, and that it sends to this computer's address and port \
             (or on this line, at this rate)",
        );
    }
    let mut found = "no pose packet came, although the box is heard".to_owned();
    // Writing to a String does not fail.
    if let Some(camera) = camera_now(receiver, now) {
        let _ = write!(found, ": {camera}");
    }
    let faults = receiver.faults();
    if !faults.is_empty() {
        let _ = write!(found, "; it says: {faults}");
    }
    let remedy = match receiver.camera() {
        Some(camera) if camera.is_absent() => {
            "check the camera's plug, and its settings in the box file"
        }
        _ if !faults.is_empty() => "correct what the box names",
        _ => "wait until its camera delivers frames",
    };
    BadInput::whole(place, found, remedy)
}
