//! What a box has told since it was last started.

use std::collections::VecDeque;
use std::time::Instant;

use plumbline::packet::{CameraState, Health, Log, LogLevel, PosePacket};

use crate::complaints;

/// The number of the box's log records that are remembered.
const RECORDS_MAX: usize = 16;

/// The box's camera, as its Health packets tell.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    /// Its state, or the last one before the box's program ended.
    pub state: CameraState,
    /// When that state was first heard of.
    pub since: Instant,
    /// The camera was in this state when the box was first heard, and perhaps long before.
    pub from_before: bool,
    /// The box's program has ended.
    pub ended: bool,
}

impl Camera {
    /// True when no camera gives frames.
    #[must_use]
    pub fn is_absent(&self) -> bool {
        matches!(self.state, CameraState::Lost | CameraState::Stalled)
    }
}

/// A log record of the box.
#[derive(Debug)]
struct Record {
    level: LogLevel,
    text: String,
}

/// What is known of the box in this run; a start of the box empties it.
#[derive(Debug, Default)]
pub(super) struct Known {
    health: Option<Health>,
    camera: Option<Camera>,
    /// The log since the camera's state last changed.
    log: VecDeque<Record>,
    latest: Option<PosePacket>,
}

impl Known {
    pub(super) fn health(&self) -> Option<&Health> {
        self.health.as_ref()
    }

    pub(super) fn camera(&self) -> Option<Camera> {
        self.camera
    }

    pub(super) fn latest(&self) -> Option<&PosePacket> {
        self.latest.as_ref()
    }

    /// The errors in the log since the camera's state last changed.
    pub(super) fn faults(&self) -> String {
        let faults = self.log.iter().filter(|record| record.level == LogLevel::Error);
        faults.map(|record| record.text.as_str()).collect::<Vec<_>>().join(" ")
    }

    pub(super) fn take_pose(&mut self, packet: PosePacket) {
        self.latest = Some(packet);
    }

    /// Takes note of a Health; what the user should hear of it.
    pub(super) fn take_health(&mut self, health: Health, now: Instant) -> Option<&'static str> {
        self.take_camera(health.camera, now);
        let is_on = |health: &Health| health.aiming_s > 0;
        let was_on = self.health.as_ref().is_some_and(is_on);
        let news = match (was_on, is_on(&health)) {
            (false, true) => Some("the box is in set-up mode: pictures may leave it"),
            (true, false) => Some("the box has left set-up mode"),
            _ => None,
        };
        self.health = Some(health);
        news
    }

    fn take_camera(&mut self, state: CameraState, now: Instant) {
        match &mut self.camera {
            Some(camera) if state == CameraState::Ended => camera.ended = true,
            Some(camera) if camera.state == state => {}
            known => {
                let from_before = known.is_none();
                let ended = state == CameraState::Ended;
                *known = Some(Camera { state, since: now, from_before, ended });
                self.log.clear();
            }
        }
    }

    /// Takes note of a log record; what the user should read, unless it is a repetition.
    pub(super) fn take_log(&mut self, log: &Log) -> Option<String> {
        let text = complaints::text_of(log);
        // A box that does not track repeats why, for hosts that begin to listen.
        let tracks = self.camera.is_some_and(|camera| camera.state == CameraState::Running);
        if !tracks && self.log.iter().any(|record| record.text == text) {
            return None;
        }
        let level = format!("{:?}", log.level).to_uppercase();
        let news = format!("box {level} {}: {text}", log.target);
        if self.log.len() == RECORDS_MAX {
            self.log.pop_front();
        }
        self.log.push_back(Record { level: log.level, text });
        Some(news)
    }
}
