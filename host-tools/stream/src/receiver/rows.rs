//! Frames on their way into the recording.

use std::collections::BTreeMap;
use std::io::Write;

use plumbline::target::Role;
use plumbline_files::BadInput;

use crate::recorder::{Names, Recorder, role_word};
use crate::sessions::Frame;

/// One target's share of the frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Share {
    /// Frames received.
    pub frames: u64,
    /// Frames with a pose.
    pub poses: u64,
}

/// Records frames, and counts each target's poses.
pub(super) struct Rows<W: Write> {
    recorder: Option<Recorder<W>>,
    shares: BTreeMap<String, Share>,
    /// The targets' names in each session, by its number.
    names: BTreeMap<u32, Names>,
}

impl<W: Write> Rows<W> {
    pub(super) fn new(recorder: Option<Recorder<W>>) -> Self {
        Self { recorder, shares: BTreeMap::new(), names: BTreeMap::new() }
    }

    pub(super) fn shares(&self) -> &BTreeMap<String, Share> {
        &self.shares
    }

    /// A target's name in the latest session.
    pub(super) fn name(&self, role: Role) -> &str {
        self.names.last_key_value().map_or(role_word(role), |(_, names)| names.name(role))
    }

    /// A session begins, with these names.
    pub(super) fn begin(&mut self, session: u32, names: Names) {
        self.names.insert(session, names);
    }

    /// Takes a frame of a session that has begun.
    pub(super) fn push(&mut self, frame: &Frame) -> Result<(), BadInput> {
        let Some(names) = self.names.get(&frame.session) else { return Ok(()) };
        for target in &frame.packet.targets {
            let share = self.shares.entry(names.name(target.role).to_owned()).or_default();
            share.frames += 1;
            share.poses += u64::from(target.pose.is_ok());
        }
        self.recorder.as_mut().map_or(Ok(()), |recorder| recorder.write(frame, names))
    }

    /// Nothing more is recorded. Each row is with the operating system already.
    pub(super) fn close(&mut self) {
        self.recorder = None;
    }
}
