//! The messages besides the pose: the box's identity, its condition, its log, and the few commands
//! that it accepts.

use heapless::{String, Vec};
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::document::Document;
use crate::limits::{DEVICE_TEXT_BYTES_MAX, NAME_BYTES_MAX, TARGETS_MAX};
use crate::model::config::Edge;
use crate::model::target::Role;

/// Links that one box can have at once: UDP, serial, file.
pub const LINKS_MAX: usize = 3;

/// Longest module path of a log record, in bytes.
pub const LOG_TARGET_BYTES_MAX: usize = 32;

/// Longest text of a log record, in bytes.
pub const LOG_TEXT_BYTES_MAX: usize = 128;

/// Longest text of a refusal, in bytes.
pub const REASON_BYTES_MAX: usize = 200;

/// Longest time in set-up mode that can be requested at once.
pub const AIM_S_MAX: u16 = 60;

/// Why the box started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ResetReason {
    /// The box cannot tell.
    Unknown,
    /// The power came on, or a host restarted the box.
    PowerOn,
    /// The watchdog restarted the box: no frame was processed for too long, or the kernel failed.
    Watchdog,
}

/// One configured target.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct TargetInfo {
    /// Its name in targets.toml.
    pub name: String<NAME_BYTES_MAX>,
    /// What it is for; pose packets refer to the target by its role.
    pub role: Role,
    /// How many corners it has.
    pub corners: u8,
}

/// The identity of the box. The protocol version is at the start of every packet.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Hello {
    /// The box's name, for people.
    pub device: String<DEVICE_TEXT_BYTES_MAX>,
    /// The box's serial number.
    pub serial_number: String<DEVICE_TEXT_BYTES_MAX>,
    /// Version of the box's program, and the commit that it was built from: a
    /// [`ProgramVersion`](super::ProgramVersion). Until there was one it was `plumbline 0.1.0`.
    pub firmware: String<DEVICE_TEXT_BYTES_MAX>,
    /// [`Config::crc`](crate::model::config::Config::crc) of the configuration in use.
    pub config_crc: u32,
    /// The [`Start`](super::Start) that this Hello is of: the same as in its packet.
    pub boot_id: u32,
    /// How often the program has started, where that is recorded.
    pub boot_count: Option<u32>,
    /// Why it started this time.
    pub reset_reason: ResetReason,
    /// Frame width.
    pub width_px: u16,
    /// Frame height.
    pub height_px: u16,
    /// The targets, in the order of the configuration.
    pub targets: Vec<TargetInfo, TARGETS_MAX>,
}

/// Kind of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum LinkKind {
    /// Datagrams.
    Udp,
    /// A serial line.
    Serial,
    /// A file.
    File,
}

/// What one link has carried since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct LinkHealth {
    /// Which link.
    pub kind: LinkKind,
    /// Packets handed to the link.
    pub packets_sent: u32,
    /// Packets that the link did not accept in time.
    pub packets_dropped: u32,
}

/// The source of the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum CameraState {
    /// No frame has come yet.
    Starting,
    /// Frames come.
    Running,
    /// It is present, but no frame has come for a second; it is being reopened.
    Stalled,
    /// It is absent or reports errors; opening it is retried again and again.
    Lost,
    /// The recording has ended.
    Ended,
}

/// A line of the trigger.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub enum TriggerState {
    /// The box has none.
    #[default]
    Off,
    /// It is in use.
    Ready,
    /// It is not there, or something else uses it; opening it is tried again and again.
    Missing,
}

/// How the trigger's lines are doing; counters run from the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub struct TriggerHealth {
    /// The line that is listened to.
    pub input: TriggerState,
    /// The line that is driven.
    pub output: TriggerState,
    /// Triggers that were sent.
    pub sent: u32,
    /// Edges that did not count, because they came too soon after another one.
    pub bounces: u32,
    /// Edges of either kind that came too fast, for the loop that reads them or for the kernel that
    /// looks at the line, and are lost.
    pub dropped: u32,
    /// Pulses of the output line.
    pub pulses: u32,
}

/// An edge at the box's trigger line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Trigger {
    /// Counts the triggers since the box's start, from 0.
    pub sequence: u32,
    /// When it was, on the capture clock.
    pub time_ns: u64,
    /// It was at most this much earlier or later.
    pub uncertain_ns: u32,
    /// Which way the line went.
    pub edge: Edge,
}

/// How the box is doing; counters run from the start.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Health {
    /// Time since the start.
    pub uptime_ms: u64,
    /// Frames that were processed.
    pub frames: u32,
    /// Frames that came and were skipped, because newer ones were already there.
    pub frames_dropped: u32,
    /// Frames that never came, or came damaged: gaps in the camera's numbers.
    pub frames_missed: u32,
    /// How often frames stopped coming, so that the camera had to be reopened.
    pub camera_losses: u32,
    /// Corners that searches have lost because a buffer was full.
    pub corners_dropped: u32,
    /// Heap allocations since the first frame after the camera was last opened, a picture was last
    /// taken, a configuration was last stored or an update was last asked about, without those that decode a camera's compressed
    /// frames; `None` when they are not counted.
    pub heap_allocations: Option<u32>,
    /// The processor's temperature in 0.1 degrees Celsius, where it can be read.
    pub temperature_decicelsius: Option<i16>,
    /// Whether the supply's voltage is too low, or was for a moment: within 3 s of that moment,
    /// however short, at least one `Health` says so, and after 5 s none does any more. `None` where
    /// the computer does not tell.
    pub undervoltage: Option<bool>,
    /// Whether heat or a weak supply slows the processor down: as the computer's firmware tells it,
    /// where it does, in the same way as `undervoltage`; otherwise whether the processor's clock
    /// since the last `Health` was, on average, more than a tenth below its full rate. `None` where
    /// neither can be known.
    pub throttled: Option<bool>,
    /// The source of the frames.
    pub camera: CameraState,
    /// Seconds until set-up mode ends, in which pictures may leave the box; 0 outside it.
    pub aiming_s: u16,
    /// Largest latency since the last `Health`.
    pub latency_us_max: u32,
    /// Log records for which there was no room.
    pub logs_dropped: u32,
    /// The wires to other devices.
    pub trigger: TriggerHealth,
    /// The links in use.
    pub links: Vec<LinkHealth, LINKS_MAX>,
}

/// Severity of a log record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, Schema)]
pub enum LogLevel {
    /// Something failed.
    Error,
    /// Something is not as it should be.
    Warn,
    /// What a technician wants to know.
    Info,
    /// What an engineer wants to know.
    Debug,
    /// Everything.
    Trace,
}

/// One log record.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Log {
    /// Since the start.
    pub uptime_ms: u64,
    /// Severity.
    pub level: LogLevel,
    /// The module that wrote the record.
    pub target: String<LOG_TARGET_BYTES_MAX>,
    /// The message.
    pub text: String<LOG_TEXT_BYTES_MAX>,
    /// Bytes of target and text that did not fit.
    pub cut: u16,
}

/// What the host asks for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub enum Action {
    /// Answer with the times: measures the round trip and relates the clocks.
    Ping {
        /// The host's clock when it sent this; comes back unchanged.
        host_sent_ns: u64,
    },
    /// Send a [`Hello`].
    SendHello,
    /// Send a [`Health`].
    SendHealth,
    /// Answer with the checksum and the length of the configuration in use.
    QueryConfig,
    /// Send a [`View`](super::View) of the next frame.
    SendView,
    /// Send some bytes of a document, as [`Part`](super::Part)s.
    SendParts {
        /// Which document.
        document: Document,
        /// Where in it the bytes begin.
        offset: u32,
        /// The number of bytes.
        bytes: u32,
    },
    /// Store the configuration that has come in parts: it is in use from the next start on.
    StoreConfig {
        /// Its length.
        bytes: u32,
        /// Its [`Config::crc`](crate::model::config::Config::crc).
        crc: u32,
    },
    /// Set-up mode for this many seconds from now, at most [`AIM_S_MAX`]; 0 ends it. Pictures leave
    /// the box only in this mode, and only over the link on which it was requested.
    Aim {
        /// How long.
        seconds: u16,
    },
    /// In set-up mode: make a [`Picture`](super::Picture) of the next frame, and announce it.
    TakePicture {
        /// Pixels of the frame per pixel of the picture, in either direction.
        reduction: u8,
    },
    /// In set-up mode, until it ends: use these settings of the camera.
    Expose {
        /// Exposure time; `None` as configured.
        exposure_us: Option<u32>,
        /// Gain, in the camera's unit; `None` as configured.
        gain: Option<f32>,
    },
    /// Restart.
    Reboot,
    /// Send packets of the stream once more, exactly as they were sealed: of the 64 counters from
    /// `first` on, those whose bit of `mask` is set, the lowest bit first.
    Resend {
        /// The counter of the lowest bit.
        first: u64,
        /// Which of the counters.
        mask: u64,
    },
    /// This listener records a trial from now on, or no longer: nothing that changes the box is then
    /// done for anybody, unless it is forced.
    Record {
        /// Whether it does.
        on: bool,
    },
    /// Send this listener every such pose only, and none at all for 0. What it does not get it must
    /// not ask for again.
    SendPoses {
        /// 1 for all of them.
        every: u16,
    },
    /// This listener leaves: its place is free, and it records no longer. There is no answer.
    Leave,
}

impl Action {
    /// Whether it changes what a box measures, or how: refused while somebody records a trial.
    #[must_use]
    pub fn changes_box(&self) -> bool {
        match self {
            Self::StoreConfig { .. }
            | Self::Aim { .. }
            | Self::TakePicture { .. }
            | Self::Expose { .. }
            | Self::Reboot => true,
            Self::Ping { .. }
            | Self::SendHello
            | Self::SendHealth
            | Self::QueryConfig
            | Self::SendView
            | Self::SendParts { .. }
            | Self::Resend { .. }
            | Self::Record { .. }
            | Self::SendPoses { .. }
            | Self::Leave => false,
        }
    }
}

/// A request, with a number that the host chooses and the reply repeats.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct Command {
    /// Chosen by the host.
    pub id: u16,
    /// What is requested.
    pub action: Action,
    /// Whether it is to be done even while somebody records a trial.
    pub is_forced: bool,
}

/// Why a command was not carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Refusal {
    /// This box, or this link, does not accept it.
    NotSupported,
    /// Not now; try again.
    Busy,
    /// Somebody records a trial, which it would disturb.
    Recording,
    /// Only in set-up mode.
    NotAiming,
    /// Bytes are missing.
    Incomplete {
        /// Where in the document the first missing byte is.
        from: u32,
    },
    /// What was sent cannot be used; the reason names the field.
    Unusable,
    /// It could not be stored; what was stored before is unchanged.
    NotStored,
}

/// What came of a command.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ReplyOutcome {
    /// To [`Action::Ping`].
    Pong {
        /// As sent by the host.
        host_sent_ns: u64,
        /// The capture clock when the command arrived.
        box_received_ns: u64,
        /// The capture clock when this reply was handed to the link.
        box_sent_ns: u64,
        /// The counter of the next packet of the stream: all before it have been sent.
        stream_next: u64,
    },
    /// To [`Action::QueryConfig`].
    Config {
        /// [`Config::crc`](crate::model::config::Config::crc).
        crc: u32,
        /// Length of its blob.
        bytes: u32,
        /// The checksum of the configuration that will be in use from the next start on: the same,
        /// until another is stored.
        next_crc: u32,
    },
    /// To [`Action::StoreConfig`]: it is on the disk, and survives a loss of power.
    Stored {
        /// [`Config::crc`](crate::model::config::Config::crc), as read back.
        crc: u32,
    },
    /// To [`Action::Resend`], if some of it is no longer there.
    Gone {
        /// The lowest counter that still is.
        first: u64,
    },
    /// It will be done.
    Accepted,
    /// It will not be done.
    Refused {
        /// Why.
        refusal: Refusal,
        /// The same in words, for people; may be empty.
        reason: String<REASON_BYTES_MAX>,
    },
}

/// The answer to the [`Command`] of the same number.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Reply {
    /// The command's number.
    pub id: u16,
    /// What came of it.
    pub outcome: ReplyOutcome,
}
