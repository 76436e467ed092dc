//! The poses of a trial's targets, as the box sent them. [`Trial`](crate::Trial) has the points of
//! the body that are made from them.

use std::path::Path;

use plumbline::config::Config;
use plumbline::packet::{Deframer, PosePacket};
use plumbline_files::BadInput;
use plumbline_stream::sessions::{Frame, Judged, Sessions};

use crate::correction::{Correction, corrected};
use crate::journal::{Content, Reader};
use crate::names;
use crate::reading::{self, FRAMES_MAX};

/// The poses of a recording.
#[derive(Debug, Clone)]
pub struct Poses {
    /// What the box was told, with what was replaced afterwards: its lens and its targets.
    pub config: Config,
    /// The time of each frame since the trial's first in seconds, and what the box sent of it; in
    /// the order of the times. Each pose is later than its frame by its `delay_ns`.
    pub frames: Vec<(f64, PosePacket)>,
}

/// Reads the poses in a trial's folder; packets that came twice count once.
///
/// # Errors
/// When there is no trial in it, it cannot be read, or the box's configuration is not in it.
pub fn read(folder: &Path) -> Result<Poses, BadInput> {
    let mut warnings = Vec::new();
    let Some(recorded) = reading::read_config(folder, &mut warnings)? else {
        return Err(BadInput::whole(
            folder.join(names::CONFIG).display(),
            "the box's configuration, which describes its camera and its targets, is not known",
            "copy the box's config.plb, as `plumb provision` wrote it, into the trial's folder",
        ));
    };
    let correction = Correction::read(folder, Some(&recorded))?;
    let mut reader = Reader::open(&folder.join(names::JOURNAL))?;
    let mut sessions = Sessions::default();
    let mut deframer = Deframer::new();
    let mut frames = Vec::new();
    while let Some(entry) = reader.next_entry()? {
        let Content::Raw(raw) = entry.content else { continue };
        if let Ok(packet) = raw.decode(&mut deframer) {
            sessions.take(corrected(correction.as_ref(), packet), entry.host_ns);
            take_frames(&mut sessions, &mut frames);
        }
        if frames.len() > FRAMES_MAX {
            return Err(reading::too_long(folder));
        }
    }
    sessions.finish();
    take_frames(&mut sessions, &mut frames);
    frames.sort_by(|a, b| a.0.total_cmp(&b.0));
    let config = correction.map_or(recorded, |it| it.config().clone());
    Ok(Poses { config, frames })
}

fn take_frames(sessions: &mut Sessions, frames: &mut Vec<(f64, PosePacket)>) {
    while let Some(judged) = sessions.next_judged() {
        if let Judged::Frame(Frame { clock, packet, .. }) = judged {
            frames.push((clock.time_s(packet.capture_time_ns), packet));
        }
    }
}
