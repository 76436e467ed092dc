//! The counters of a session, and the Health packet made from them.

use std::time::{Duration, Instant};

use plumbline::packet::{CameraState, Health, LinkHealth, TriggerHealth};

use super::durations::Durations;
use crate::allocation::allocations;
use crate::link::Links;
use crate::logger;
use crate::machine::power::PowerMonitor;
use crate::machine::temperature::Sensor;
use crate::source::Condition;

/// A source's condition before it is first read.
const STARTING: Condition = Condition {
    camera: CameraState::Starting,
    frames_dropped: 0,
    frames_missed: 0,
    camera_losses: 0,
};

/// The counters of one session. All memory is allocated at its start.
pub struct Counters {
    started: Instant,
    sensor: Sensor,
    power: PowerMonitor,
    /// The source's condition when it was last read.
    pub source: Condition,
    pub frames: u64,
    pub late: u64,
    pub corners_dropped: u32,
    pub step: Durations,
    pub latency: Durations,
    latency_max_since_health: Duration,
    /// The allocator's count after the first frame, and after the last.
    allocations: Option<(u64, u64)>,
    /// The camera's losses at the first frame: reopening the camera allocates, and the
    /// count restarts after it.
    losses_at_first_frame: u32,
}

impl Counters {
    /// Starts counting for the calling thread, which must be the one that measures.
    pub fn new(started: Instant) -> Self {
        Self {
            started,
            sensor: Sensor::open(),
            power: PowerMonitor::open(),
            source: STARTING,
            frames: 0,
            late: 0,
            corners_dropped: 0,
            step: Durations::new(),
            latency: Durations::new(),
            latency_max_since_health: Duration::ZERO,
            allocations: None,
            losses_at_first_frame: 0,
        }
    }

    /// Counts a frame whose packet has been passed to the links.
    pub fn frame(&mut self, latency: Duration, late: bool, losses: u32) {
        self.frames += 1;
        self.late += u64::from(late);
        self.latency.record(latency);
        self.latency_max_since_health = self.latency_max_since_health.max(latency);
        let count = allocations();
        let after_first = match self.allocations {
            Some((after_first, _)) if losses == self.losses_at_first_frame => after_first,
            _ => count,
        };
        self.losses_at_first_frame = losses;
        self.allocations = Some((after_first, count));
    }

    /// Restarts the count of allocations, after an operation that allocates on purpose.
    pub fn forget_allocations(&mut self) {
        self.allocations = None;
    }

    /// Heap allocations since the first frame after the camera was last opened.
    pub fn allocations(&self) -> u64 {
        self.allocations.map_or(0, |(after_first, after_last)| after_last - after_first)
    }

    /// The Health packet; restarts the largest latency.
    pub fn health(&mut self, links: &Links, aiming_s: u16, trigger: TriggerHealth) -> Health {
        let power = self.power.read();
        let latency_max = std::mem::take(&mut self.latency_max_since_health);
        let links = links.counts().into_iter().map(|(kind, counts)| LinkHealth {
            kind,
            packets_sent: saturated(counts.sent),
            packets_dropped: saturated(counts.dropped),
        });
        Health {
            uptime_ms: self.started.elapsed().as_millis() as u64,
            frames: saturated(self.frames),
            frames_dropped: saturated(self.source.frames_dropped),
            frames_missed: saturated(self.source.frames_missed),
            camera_losses: self.source.camera_losses,
            corners_dropped: self.corners_dropped,
            heap_allocations: Some(saturated(self.allocations())),
            temperature_decicelsius: self.sensor.decicelsius(),
            undervoltage: power.undervoltage,
            throttled: power.throttled,
            camera: self.source.camera,
            aiming_s,
            latency_us_max: u32::try_from(latency_max.as_micros()).unwrap_or(u32::MAX),
            logs_dropped: logger::dropped(),
            trigger,
            links: links.collect(),
        }
    }
}

fn saturated(count: u64) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}
