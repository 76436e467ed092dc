//! The CSV of a reception: `poses.csv` as every part of Plumbline writes it,
//! and one more column, `session`.
//!
//! `frame` is the box's sequence number and `time_s` the target's own time since the
//! first frame's capture time; without a pose it is the frame's. When the box starts
//! anew both begin at another point: then `session` is one higher (or more, if a start
//! in between brought no frame), and `time_s` goes on from where the host's clock says
//! that the new session began: see [`SessionClock`](crate::sessions::SessionClock).

use std::io::Write;

use plumbline::packet::{AnatomicalPoint, Hello, TargetPacket};
use plumbline::target::Role;
use plumbline_files::BadInput;
use plumbline_files::poses::{self, COLUMNS, PoseRow};
use serde::Serialize;

use crate::sessions::Frame;

/// The word for a role, where a target's name is not known.
#[must_use]
pub fn role_word(role: Role) -> &'static str {
    match role {
        Role::Upper => "upper",
        Role::Lower => "lower",
        Role::Scene => "scene",
    }
}

/// The names of the targets, as far as the box has told them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Names(Vec<(Role, String)>);

impl Names {
    /// The names in a Hello.
    #[must_use]
    pub fn of(hello: &Hello) -> Self {
        Self(hello.targets.iter().map(|target| (target.role, target.name.to_string())).collect())
    }

    /// The target's name, or the word for its role.
    #[must_use]
    pub fn name(&self, role: Role) -> &str {
        let named = self.0.iter().find(|(named, _)| *named == role);
        named.map_or_else(|| role_word(role), |(_, name)| name)
    }
}

/// Writes the rows of each packet and passes them on at once.
pub struct Recorder<W: Write> {
    rows: csv::Writer<W>,
    place: String,
    has_header: bool,
}

impl<W: Write> Recorder<W> {
    /// A recorder into a sink that `place` names in errors; the header is
    /// written before the first row.
    pub fn new(sink: W, place: impl Into<String>) -> Self {
        Self {
            rows: csv::WriterBuilder::new().has_headers(false).from_writer(sink),
            place: place.into(),
            has_header: false,
        }
    }

    /// Writes one row per target.
    ///
    /// # Errors
    /// When the sink refuses; what was written before stays.
    pub fn write(&mut self, frame: &Frame, names: &Names) -> Result<(), BadInput> {
        if !std::mem::replace(&mut self.has_header, true) {
            let columns: Vec<&str> = COLUMNS.into_iter().chain(["session"]).collect();
            self.put(&columns)?;
        }
        let Frame { session, clock, packet, .. } = frame;
        for target in &packet.targets {
            let frame_ns = packet.capture_time_ns;
            let own_ns = target.pose.as_ref().map_or(frame_ns, |pose| pose.own_time_ns(frame_ns));
            let time_s = clock.time_s(own_ns);
            let mut row = row(packet.sequence, time_s, target, names);
            let trunk = match target.role {
                Role::Upper => packet.upper_trunk,
                Role::Lower => packet.lower_trunk,
                Role::Scene => None,
            };
            if let Some(AnatomicalPoint { ap_mm, ml_mm, si_mm }) = trunk {
                row.ap_mm = Some(shortest(ap_mm));
                row.ml_mm = Some(shortest(ml_mm));
                row.si_mm = Some(shortest(si_mm));
            }
            self.put(&(row, session))?;
        }
        self.flush()
    }

    fn put(&mut self, record: &impl Serialize) -> Result<(), BadInput> {
        self.rows.serialize(record).map_err(|error| match error.into_kind() {
            csv::ErrorKind::Io(error) => BadInput::io(&self.place, &error),
            other => {
                BadInput::whole(&self.place, format!("{other:?}"), "this row cannot be written")
            }
        })
    }

    /// To the operating system, so that no end of this program loses it.
    fn flush(&mut self) -> Result<(), BadInput> {
        self.rows.flush().map_err(|error| BadInput::io(&self.place, &error))
    }
}

/// What the state column says of a target.
#[must_use]
pub fn state_words(target: &TargetPacket) -> String {
    poses::state_words(target.state, target.pose.as_ref().err().copied())
}

fn row(sequence: u32, time_s: f64, target: &TargetPacket, names: &Names) -> PoseRow {
    let name = names.name(target.role);
    let mut row = PoseRow::without_pose(u64::from(sequence), time_s, name, &state_words(target));
    if let Ok(pose) = &target.pose {
        let [theta1, theta2, theta3] = pose.theta_rad.map(|value| Some(shortest(value)));
        let [x, y, z] = pose.translation_mm.map(|value| Some(shortest(value)));
        let [sd_x, sd_y, sd_z] = pose.sd_mm.map(|value| Some(shortest(value)));
        (row.theta1_rad, row.theta2_rad, row.theta3_rad) = (theta1, theta2, theta3);
        (row.x_mm, row.y_mm, row.z_mm) = (x, y, z);
        (row.sd_x_mm, row.sd_y_mm, row.sd_z_mm) = (sd_x, sd_y, sd_z);
        row.rms_px = Some(shortest(pose.rms_px));
        row.points = Some(u32::from(pose.corners));
    }
    row
}

/// The f64 with the fewest digits that is this f32: the file then shows the
/// digits that were sent, 0.0312 and not 0.031199999153614044.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}
