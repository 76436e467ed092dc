//! A box, as a page shows it.

use plumbline_bedside::doctor::{Check, Verdict};
use serde::{Deserialize, Serialize};

use super::{HealthState, Problem, SessionState};
use crate::words::on_page;

/// A box whose key is known here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BoxState {
    /// By which it is named in routes: the identity of its key, 16 hexadecimal digits, or
    /// `serial-` and a number for a serial line.
    pub id: String,
    /// What people call it.
    pub name: String,
    /// Its serial number, where it is known.
    pub serial_number: Option<String>,
    /// Whether it was made on this desk and was never heard: the files for its card can be fetched.
    pub has_card: bool,
    /// How it is reached now.
    pub link: LinkState,
    /// Who it is and what it runs with, once it has told. It stays when the box is lost.
    pub hello: Option<HelloState>,
    /// How it is, as of its latest word.
    pub health: Option<HealthState>,
    /// What is done with it.
    pub doing: Doing,
    /// What takes long at this moment.
    pub job: Option<Job>,
    /// How the latest action failed that took long; until another one begins.
    pub failed: Option<Problem>,
    /// The actions that are possible now.
    pub can: Vec<Can>,
    /// What happened, the latest last; at most 20.
    pub notices: Vec<Notice>,
    /// What the doctor found last. `null` until the box is examined.
    pub examination: Option<Examination>,
    /// While it is aimed.
    pub aim: Option<Aim>,
    /// The photographs of the board, from the first on; until another set is begun.
    pub photographs: Option<Photographs>,
    /// The camera that these photographs give.
    pub calibration: Option<CalibrationState>,
    /// The scene that was measured last.
    pub scene: Option<SceneState>,
    /// The session that goes on with this box.
    pub session: Option<SessionState>,
    /// What is measured now; `null` while it is aimed and while it is lost.
    pub live: Option<Live>,
    /// From where movement is drawn: the mean of a second. It is taken anew when the box starts, at t = 0
    /// of a recording, and when somebody asks for it.
    pub reference: Reference,
}

/// How a box is reached.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "snake_case")]
pub enum LinkState {
    /// It is not heard, and looked for.
    Searching {
        /// Since when.
        since_at_ms: f64,
        /// Why, as far as is known, and what to do.
        problem: Problem,
    },
    /// It is heard.
    Heard {
        /// How: `UDP 192.168.1.30:4210`, or the serial device.
        by: String,
    },
    /// It was heard, and is silent.
    Silent {
        /// Since when.
        since_at_ms: f64,
        /// What to do.
        problem: Problem,
    },
}

/// Who a box is and what it runs with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HelloState {
    /// Its own name.
    pub device: String,
    /// Its serial number.
    pub serial_number: String,
    /// Version of its program.
    pub firmware: String,
    /// The checksum of the configuration that it runs with, 8 hexadecimal digits: with another one, it has
    /// other settings.
    pub configuration: String,
    /// Width and height of a frame.
    pub size_px: [u16; 2],
    /// The rate it was asked for, where it has a camera and has told.
    pub asked_hz: Option<f64>,
    /// The targets it looks for.
    pub targets: Vec<TargetState>,
    /// Whether its camera is calibrated; `null` until its configuration is known.
    pub is_calibrated: Option<bool>,
    /// Whether it has a scene, without which nothing is measured along the body's axes.
    pub has_scene: Option<bool>,
    /// What is to be done next with this box, as one sentence.
    pub next: String,
    /// The part of the page where that is done.
    pub next_step: NextStep,
}

/// The step that a box needs next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NextStep {
    /// Its camera is to be aimed and calibrated.
    Calibrate,
    /// Its scene is to be measured.
    Scene,
    /// It can measure.
    Session,
}

/// A target that a box looks for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TargetState {
    /// Its name.
    pub name: String,
    /// `upper`, `lower` or `scene`.
    pub role: String,
    /// How many inner corners it has.
    pub corners: u8,
}

/// What is done with a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Doing {
    /// It is not there.
    Nothing,
    /// It is watched: frames come.
    Watching,
    /// The doctor examines it.
    Examining,
    /// It is in set-up mode.
    Aiming,
    /// The exposure is being sought, in set-up mode.
    Exposing,
    /// It is given another configuration, and restarts.
    Delivering,
    /// The scene is measured.
    MeasuringScene,
    /// A trial is recorded.
    Recording,
}

/// An action on a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Can {
    /// `examine`.
    Examine,
    /// `reference`.
    Reference,
    /// `aim/begin`.
    AimBegin,
    /// `aim/expose`.
    AimExpose,
    /// `aim/cancel`.
    AimCancel,
    /// `aim/end`.
    AimEnd,
    /// `photographs/begin`.
    PhotographsBegin,
    /// `photographs/take`.
    PhotographsTake,
    /// `photographs/auto`.
    PhotographsAuto,
    /// `photographs/pause`.
    PhotographsPause,
    /// `photographs/remove`.
    PhotographsRemove,
    /// `calibration/fit`: there are at least three photographs with the board.
    CalibrationFit,
    /// `calibration/deliver`.
    CalibrationDeliver,
    /// `scene/measure`.
    SceneMeasure,
    /// `scene/store`.
    SceneStore,
    /// `settings/send`.
    SettingsSend,
    /// `session/begin` and `session/resume`.
    SessionBegin,
    /// `session/event` with one of [`SessionState::can`].
    SessionEvent,
    /// `session/mark`.
    SessionMark,
    /// `session/close`.
    SessionClose,
}

/// What takes long.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// What is waited for, in words.
    pub words: String,
    /// Since when.
    pub since_at_ms: f64,
    /// How much of it is done, 0 to 1, where that is known.
    pub share: Option<f64>,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Notice {
    /// When.
    pub at_ms: f64,
    /// Whether it may not be as one wants it.
    pub is_warning: bool,
    /// What.
    pub words: String,
}

/// What the doctor found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Examination {
    /// When.
    pub at_ms: f64,
    /// The worst verdict.
    pub worst: CheckGrade,
    /// Every check, the worst first.
    pub checks: Vec<CheckState>,
}

/// A check.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CheckState {
    /// What was looked at.
    pub subject: String,
    /// The verdict.
    pub verdict: CheckGrade,
    /// What was seen.
    pub seen: String,
    /// What to do; empty where there is nothing to do.
    pub remedy: String,
}

impl CheckState {
    /// As the doctor says it.
    #[must_use]
    pub fn of(check: &Check) -> Self {
        Self {
            subject: check.subject.clone(),
            verdict: match check.verdict {
                Verdict::Skipped => CheckGrade::Skipped,
                Verdict::Good => CheckGrade::Good,
                Verdict::Warn => CheckGrade::Warn,
                Verdict::Fail => CheckGrade::Fail,
            },
            seen: on_page(&check.seen),
            remedy: on_page(&check.remedy),
        }
    }
}

/// The verdict of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CheckGrade {
    /// There is nothing to look at.
    Skipped,
    /// As it should be.
    Good,
    /// It measures, and could measure better or more safely.
    Warn,
    /// It does not measure, or what it measures is not to be used.
    Fail,
}

/// A box in set-up mode: its camera's picture leaves it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Aim {
    /// The number of the latest picture; 0: there is none yet. `picture.jpeg?number=N` gives it.
    pub picture: u32,
    /// Its width and height.
    pub picture_px: [u32; 2],
    /// What to do next, in one sentence that can be read from where the board is held.
    pub next: String,
    /// Whether nothing is left to do.
    pub is_good: bool,
    /// The frame's numbers, in words; empty until there are some.
    pub frame: String,
    /// What to do about the frame.
    pub frame_advice: Vec<String>,
    /// Each target's.
    pub targets: Vec<AimTarget>,
    /// From where on they are good enough.
    pub enough: AimEnough,
    /// Since when nothing is heard of the box, if it is silent.
    pub silent_since_at_ms: Option<f64>,
    /// How the frames are exposed.
    pub exposure_us: Option<u32>,
    /// The camera's gain.
    pub gain: Option<f32>,
    /// The search for an exposure.
    pub exposure: Option<ExposureSearch>,
    /// When set-up mode ends by itself, so that no page left open keeps a ward in view.
    pub ends_at_ms: f64,
}

/// From where on what is seen of a target is good enough, in the units of [`AimTarget`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AimEnough {
    /// Its focus.
    pub focus: u8,
    /// Its light squares.
    pub light: f32,
    /// Its contrast.
    pub contrast: f32,
    /// The size of a square.
    pub pitch_px: f32,
}

/// What is seen of a target while a camera is aimed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AimTarget {
    /// Its name.
    pub name: String,
    /// Whether it is found, and why not, in words.
    pub state: String,
    /// Whether its pose is known.
    pub is_found: bool,
    /// 0 to 100, as sharp as it gets; `null` where it was not measured.
    pub focus: Option<u8>,
    /// The best focus so far.
    pub focus_best: Option<u8>,
    /// Light squares, as a part of white: 0 to 1.
    pub light: Option<f32>,
    /// The same minus that of the dark ones.
    pub contrast: Option<f32>,
    /// The size of a square.
    pub pitch_px: Option<f32>,
    /// All numbers, in words.
    pub numbers: Vec<String>,
    /// What to do.
    pub advice: Vec<String>,
}

/// A search for an exposure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExposureSearch {
    /// Whether it goes on.
    pub is_running: bool,
    /// What was tried and what it gave, each in words.
    pub tried: Vec<String>,
    /// What was found; `null` while it goes on, and where nothing was.
    pub found: Option<String>,
}

/// Photographs of the board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Photographs {
    /// Inner corners along both sides of the board.
    pub board: [u8; 2],
    /// From corner to corner.
    pub pitch_mm: f64,
    /// Where they are kept.
    pub folder: String,
    /// Each of them.
    pub list: Vec<Photograph>,
    /// How many parts of the frame the map has, across and down.
    pub cells: [usize; 2],
    /// In how many photographs each part showed the board: rows from the top, each from the left.
    pub covered: Vec<Vec<u32>>,
    /// The share of the frame that is covered, 0 to 1.
    pub share: f64,
    /// What to do next, in one sentence.
    pub next: String,
    /// When the next one is taken by itself, if so.
    pub next_at_ms: Option<f64>,
    /// How many are still to be taken by themselves.
    pub to_go: u32,
    /// How much of the one under way has come, 0 to 1.
    pub arriving: Option<f64>,
}

/// A photograph of the board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Photograph {
    /// Its number, by which it is fetched and removed.
    pub number: u32,
    /// The name of its file.
    pub file: String,
    /// Whether the board was found in it.
    pub is_found: bool,
    /// Why not, or what of it, in words.
    pub words: String,
    /// Its reprojection error in the latest calibration, root mean square; `null` where it was not used.
    pub error_px: Option<f64>,
}

/// A camera from photographs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibrationState {
    /// Whether there are no concerns.
    pub is_good: bool,
    /// What is to be known about it, each with a remedy; empty where it is good.
    pub concerns: Vec<String>,
    /// Reprojection error of all corners, root mean square.
    pub error_px: f64,
    /// The photographs that were used.
    pub used: usize,
    /// Of how many.
    pub photographs: usize,
    /// The lens model.
    pub model: String,
    /// The camera's numbers with their standard deviations, in words.
    pub numbers: Vec<String>,
    /// The file in which it is kept.
    pub file: String,
    /// Whether the box has it.
    pub is_delivered: bool,
}

/// A scene that was measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneState {
    /// Its figures, in words.
    pub words: String,
    /// What may be wrong with it, and what to do.
    pub warnings: Vec<String>,
    /// How far the board leans.
    pub leans_deg: f64,
    /// By how much one frame varies.
    pub spread_deg: f64,
    /// By how much one frame varies.
    pub spread_mm: f64,
    /// Whether the box has it.
    pub is_stored: bool,
}

/// What is measured now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Live {
    /// Frames per second, lately.
    pub rate_hz: f64,
    /// Frames that came since the box was met or since the recording began.
    pub frames: u64,
    /// Frames that did not come.
    pub lost: u64,
    /// From exposure to this computer, milliseconds, of the latest frame.
    pub arrival_ms: Option<f64>,
    /// The largest error of frames' times against this computer's clock, milliseconds.
    pub clock_error_ms: Option<f64>,
    /// From exposure to a page's pixels, milliseconds: the median and the largest that pages have
    /// reported lately.
    pub screen_ms: Option<[f64; 2]>,
    /// `wait`, `good`, `look` or `stop`: what the trial is worth so far; `null` without a recording.
    pub judgement: Option<Judged>,
    /// Why, the worst first; without a recording, why no pose comes.
    pub reasons: Vec<Reason>,
    /// The upper trunk.
    pub upper: TrunkState,
    /// The lower trunk.
    pub lower: TrunkState,
    /// How far the recording has come, in words; otherwise empty.
    pub time: String,
    /// Rate, losses and so on, in words.
    pub counts: Vec<String>,
}

/// What a trial is worth so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Judged {
    /// There is no verdict yet.
    Wait,
    /// The trial would now be good.
    Good,
    /// It would be doubtful.
    Look,
    /// It would be unusable.
    Stop,
}

/// A reason.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reason {
    /// What is amiss.
    pub words: String,
    /// What can be done; may be empty.
    pub remedy: String,
}

/// A trunk point, now and since the reference or t = 0.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TrunkState {
    /// Whether it is seen; where not, why: empty if it is.
    pub missing: String,
    /// Its figures since then; `null` as long as there are none.
    pub figures: Option<FiguresState>,
    /// Why there are none; otherwise empty.
    pub not_yet: String,
}

/// The figures of a trunk point, of positions filtered as the trial's own figures are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FiguresState {
    /// Length of the path in the transverse plane.
    pub path_mm: f64,
    /// The noise floor: the path that noise alone would have there; `null` where the box does not know
    /// its noise.
    pub noise_path_mm: Option<f64>,
    /// Root mean square of AP, ML and SI about their means.
    pub rms_mm: [f64; 3],
    /// Gaps without a position.
    pub gaps: usize,
    /// Seconds that the figures are of.
    pub span_s: f64,
}

/// From where movement is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Reference {
    /// Another number, another reference.
    pub number: u32,
    /// The upper trunk's AP, ML and SI, mm in the scene's axes.
    pub upper: Option<[f64; 3]>,
    /// The lower trunk's.
    pub lower: Option<[f64; 3]>,
}
