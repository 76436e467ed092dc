//! Pose packets on their way into the recording.
//!
//! A packet names its targets by their roles; their names are in the box's Hello, which may
//! come later. Until then packets are held back.

use std::collections::{BTreeMap, VecDeque};
use std::io::Write;
use std::time::{Duration, Instant};

use plumbline::packet::PosePacket;
use plumbline::target::Role;
use plumbline_files::BadInput;

use crate::recorder::{Names, Recorder};

/// Packets are held back no longer than this: however the program ends, no more than the last
/// second is lost.
const NAMES_WAIT: Duration = Duration::from_millis(900);

/// One target's share of the frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Share {
    /// Frames received.
    pub frames: u64,
    /// Frames with a pose.
    pub poses: u64,
}

/// A packet that waits for the targets' names.
struct Held {
    packet: PosePacket,
    begins: Option<Begin>,
}

/// The beginning of a session.
#[derive(Debug, Clone, Copy)]
pub(super) struct Begin {
    pub(super) session: u32,
    pub(super) arrival: Instant,
}

/// Records packets once the names of their targets are known, and counts each target's poses.
pub(super) struct Rows<W: Write> {
    recorder: Option<Recorder<W>>,
    shares: BTreeMap<String, Share>,
    /// The names used in this session, once they are settled.
    names: Option<Names>,
    /// The names of the latest Hello.
    names_heard: Names,
    held: VecDeque<Held>,
    /// When the first of the held packets came.
    held_since: Option<Instant>,
}

impl<W: Write> Rows<W> {
    pub(super) fn new(recorder: Option<Recorder<W>>) -> Self {
        Self {
            recorder,
            shares: BTreeMap::new(),
            names: None,
            names_heard: Names::default(),
            held: VecDeque::new(),
            held_since: None,
        }
    }

    pub(super) fn shares(&self) -> &BTreeMap<String, Share> {
        &self.shares
    }

    pub(super) fn name(&self, role: Role) -> &str {
        self.names.as_ref().unwrap_or(&self.names_heard).name(role)
    }

    /// True once the names of this session are settled.
    pub(super) fn has_names(&self) -> bool {
        self.names.is_some()
    }

    /// When the first of the packets came that wait for names, if any do.
    pub(super) fn held_since(&self) -> Option<Instant> {
        self.held_since
    }

    /// True when packets have waited for names long enough.
    pub(super) fn is_overdue(&self, now: Instant) -> bool {
        self.held_since.is_some_and(|since| now.saturating_duration_since(since) >= NAMES_WAIT)
    }

    /// Takes note of the names in a Hello; they are used from the next [`settle`](Self::settle)
    /// that finds none in use.
    pub(super) fn hear(&mut self, names: Names) {
        self.names_heard = names;
    }

    /// Takes a packet, the first of a session if it `begins` one.
    pub(super) fn push(
        &mut self,
        packet: PosePacket,
        begins: Option<Begin>,
        now: Instant,
    ) -> Result<(), BadInput> {
        self.held.push_back(Held { packet, begins });
        if self.has_names() {
            return self.settle();
        }
        self.held_since.get_or_insert(now);
        Ok(())
    }

    /// The packets from here on are another run's, with names of its own.
    pub(super) fn start_run(&mut self) -> Result<(), BadInput> {
        self.finish()?;
        self.names = None;
        Ok(())
    }

    /// Writes what is still held.
    pub(super) fn finish(&mut self) -> Result<(), BadInput> {
        if self.held.is_empty() { Ok(()) } else { self.settle() }
    }

    /// Uses the names known now for the rest of the session, and writes what has waited for
    /// them.
    pub(super) fn settle(&mut self) -> Result<(), BadInput> {
        let names = self.names.get_or_insert_with(|| self.names_heard.clone());
        self.held_since = None;
        while let Some(Held { packet, begins }) = self.held.pop_front() {
            count(&mut self.shares, &packet, names);
            if let Some(recorder) = &mut self.recorder {
                if let Some(Begin { session, arrival }) = begins {
                    recorder.start_session(session, packet.capture_time_ns, arrival);
                }
                recorder.write(&packet, names)?;
            }
        }
        Ok(())
    }
}

fn count(shares: &mut BTreeMap<String, Share>, packet: &PosePacket, names: &Names) {
    for target in &packet.targets {
        let share = shares.entry(names.name(target.role).to_owned()).or_default();
        share.frames += 1;
        share.poses += u64::from(target.pose.is_ok());
    }
}
