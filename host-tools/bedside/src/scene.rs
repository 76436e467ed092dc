//! Where the scene board stands, which gives the body's axes.
//!
//! In: the board's poses, as a live box sends them ([`listen`]) or from frames. Out: their mean, with
//! what may be wrong with it ([`measure`]), for a file or for the box ([`store`]).

use std::path::PathBuf;
use std::time::{Duration, Instant};

use jiff::civil::Date;
use plumbline::config::Config;
use plumbline::lens::Lens;
use plumbline::packet::{Hello, Message, PosePacket};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::NoPose;
use plumbline::target::Role;
use plumbline_calibration::background::{Picture, REDUCTION};
use plumbline_calibration::scene::{Mean, lean_deg};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_files::lens_id::LensId;
use plumbline_files::scene::SceneFile;
use plumbline_stream::link::BoxLink;

use crate::delivery::{self, Before};
use crate::missing::{self, Missing};
use crate::told::{Tell, Told, waiting};
use crate::{background, snapshot};

/// Fewer poses say nothing about whether the board stood still.
const POSES_MIN: usize = 10;

/// A board and a camera at rest show less than this (standard deviations of one frame).
const SPREAD_DEG_MAX: f64 = 0.2;
const SPREAD_MM_MAX: f64 = 0.5;

/// What varies by this is no board at rest, and nothing can be made of its mean.
const MOVED_DEG: f64 = 10.0 * SPREAD_DEG_MAX;
const MOVED_MM: f64 = 10.0 * SPREAD_MM_MAX;

/// A board that leans further has not slipped: it was put there the wrong way round.
const OVERTURNED_DEG: f64 = 45.0;

/// What was seen of the board.
#[derive(Debug, Clone)]
pub struct Seen {
    /// The recording or the box.
    pub place: String,
    /// What it was seen through.
    pub lens: Lens,
    /// All frames, with the board or without it.
    pub frames: usize,
    /// The board's poses.
    pub poses: Vec<Pose<Cam, Target>>,
    /// What the camera saw, small; `None` where no picture came.
    pub background: Option<Picture>,
    /// What to do where these poses are too few.
    pub remedy: String,
}

/// A scene, and how well it is known.
#[derive(Debug, Clone)]
pub struct Measured {
    /// The scene, its source and its camera.
    pub file: SceneFile,
    /// The frames with the board.
    pub poses: usize,
    /// All frames.
    pub frames: usize,
    /// By how much a single frame varies: standard deviations.
    pub spread_deg: f64,
    /// The same of the position.
    pub spread_mm: f64,
    /// How far the board leans from upright.
    pub leans_deg: f64,
    /// What may be wrong with it, and what to do.
    pub warnings: Vec<String>,
}

impl Measured {
    /// The figures in a line.
    #[must_use]
    pub fn words(&self) -> String {
        format!(
            "{} of {}; spread of one frame {:.3} degrees and {:.3} mm; the board leans by {:.1} degrees",
            self.poses,
            counted(self.frames, "frame"),
            self.spread_deg,
            self.spread_mm,
            self.leans_deg
        )
    }
}

/// The scene of what was seen, by a camera that looks down by `camera_pitch_deg`; a board that
/// leans by more than `upright_deg` is warned of.
///
/// # Errors
/// When the board was seen too seldom, or was moved.
pub fn measure(
    seen: &Seen,
    camera_pitch_deg: f64,
    upright_deg: f64,
    today: Date,
) -> Result<Measured, BadInput> {
    let Seen { place, poses, remedy, .. } = seen;
    let frames = counted(seen.frames, "frame");
    if poses.len() < POSES_MIN {
        return Err(BadInput::whole(
            place,
            format!("the scene board is seen in {} of {frames}", poses.len()),
            too_few(poses.len(), seen.frames, remedy),
        ));
    }
    let mean = Mean::of(poses);
    if mean.spread_deg > MOVED_DEG || mean.spread_mm > MOVED_MM {
        return Err(BadInput::whole(
            place,
            format!(
                "the board's pose varies by {:.1} degrees and {:.1} mm: it was moved",
                mean.spread_deg, mean.spread_mm
            ),
            "nothing is kept; let board and camera stand still, and try again",
        ));
    }
    let file = SceneFile {
        cam_from_scene_theta: mean.cam_from_scene.theta(),
        source: format!(
            "{place}, {}, spread {:.3} degrees and {:.3} mm, {today}",
            counted(poses.len(), "frame"),
            mean.spread_deg,
            mean.spread_mm
        ),
        camera: Some(LensId::of(&seen.lens)),
    };
    let leans_deg = lean_deg(&mean.cam_from_scene, camera_pitch_deg);
    let mut warnings = Vec::new();
    if leans_deg > upright_deg {
        let remedy = if leans_deg > OVERTURNED_DEG {
            "it stands on its side or upside down, unless the camera does: turn it so that its arrow points up, and measure again"
        } else {
            "set it upright with a level, or say with --camera-pitch-deg how far the camera looks down"
        };
        warnings.push(format!(
            "the board leans by {leans_deg:.1} degrees from upright (more than --upright-deg {upright_deg}); up and forward lean with it: {remedy}"
        ));
    }
    if 2 * poses.len() < seen.frames {
        warnings.push(format!(
            "the board was found in {} of {frames} only: check its light, and that nothing hides it",
            poses.len()
        ));
    }
    if mean.spread_deg > SPREAD_DEG_MAX || mean.spread_mm > SPREAD_MM_MAX {
        warnings.push(format!(
            "the board's pose varies by {:.2} degrees and {:.2} mm; board or camera moved, or the board is too small or too far away: let both stand still, and go nearer",
            mean.spread_deg, mean.spread_mm
        ));
    }
    let (spread_deg, spread_mm) = (mean.spread_deg, mean.spread_mm);
    let (poses, frames) = (poses.len(), seen.frames);
    Ok(Measured { file, poses, frames, spread_deg, spread_mm, leans_deg, warnings })
}

/// What to do where the board is seen too seldom.
fn too_few(poses: usize, frames: usize, remedy: &str) -> String {
    if poses == frames && frames > 0 {
        return format!(
            "{POSES_MIN} are needed, to see that it stands still: give more, as a video or at least \
             {POSES_MIN} pictures, or watch for longer with --seconds"
        );
    }
    format!("{POSES_MIN} are needed: {remedy}")
}

/// Keeps the picture of a scene's background on this computer, so that the doctor sees whether the
/// camera was moved since; returns its file.
///
/// # Errors
/// When it cannot be written.
pub fn keep_background(scene: &SceneFile, picture: &Picture) -> Result<PathBuf, BadInput> {
    background::keep(&scene.cam_from_scene_theta, picture)
}

/// Puts a scene into the configuration of the box that said `hello` and runs with `old`, and
/// restarts it, unless `restart` is false.
///
/// # Errors
/// When the box does not take it.
pub fn store(
    link: &mut BoxLink,
    hello: Hello,
    old: Config,
    scene: &SceneFile,
    restart: bool,
    tell: &mut Tell<'_>,
) -> Result<(), BadInput> {
    let mut config = old.clone();
    config.cam_from_scene_theta = Some(scene.cam_from_scene_theta);
    let before = Before { hello: Some(hello), config: Some(old) };
    delivery::deliver(link, &before, &config, restart, tell)
}

/// What a box has sent of the board.
#[derive(Default)]
struct Heard {
    frames: usize,
    poses: Vec<Pose<Cam, Target>>,
    /// Frames without a pose, by the reason.
    without: Vec<(NoPose, usize)>,
    /// Whether another target was measured in one of the frames.
    is_other_measured: bool,
}

/// Checks that the box looks for a scene board.
///
/// # Errors
/// When it has none among its targets.
pub fn check_board(place: &str, hello: &Hello) -> Result<(), BadInput> {
    if hello.targets.iter().any(|target| target.role == Role::Scene) {
        return Ok(());
    }
    let names: Vec<&str> = hello.targets.iter().map(|target| target.name.as_str()).collect();
    Err(BadInput::whole(
        place,
        format!("the box looks for {}, and for no target of the role \"scene\"", names.join(", ")),
        "add the board to its targets file (name, role = \"scene\", columns, rows, pitch_mm) and \
         provision it again; or give a recording of the board",
    ))
}

/// Watches the board for a while through a box, which sees through this lens, and takes a small
/// picture of the background.
///
/// # Errors
/// When the link cannot be used any more.
pub fn listen(
    link: &mut BoxLink,
    hello: &Hello,
    lens: Lens,
    duration: Duration,
    tell: &mut Tell<'_>,
) -> Result<Seen, BadInput> {
    let mut heard = Heard::default();
    waiting(tell, "watching the board", || {
        link.messages(Instant::now() + duration, |message| -> Option<()> {
            if let Message::Pose(packet) = message {
                heard.take(packet);
            }
            None
        })
    })?;
    // The scene is right without it.
    let background = snapshot::take(link, REDUCTION, tell)
        .inspect_err(|error| {
            tell(Told::Warning(format!("no picture of the background: {error}")));
        })
        .ok();
    Ok(Seen {
        place: format!("{} ({})", hello.device, hello.serial_number),
        lens,
        frames: heard.frames,
        remedy: heard.remedy(),
        poses: heard.poses,
        background,
    })
}

impl Heard {
    fn take(&mut self, packet: &PosePacket) {
        let Some(board) = packet.targets.iter().find(|it| it.role == Role::Scene) else { return };
        self.frames += 1;
        self.is_other_measured |=
            packet.targets.iter().any(|it| it.role != Role::Scene && it.pose.is_ok());
        match &board.pose {
            Ok(pose) => self.poses.push(pose.cam_from_target()),
            Err(why) => match self.without.iter_mut().find(|(known, _)| known == why) {
                Some((_, frames)) => *frames += 1,
                None => self.without.push((*why, 1)),
            },
        }
    }

    /// What to do when these poses are too few.
    fn remedy(&self) -> String {
        if self.frames == 0 {
            return "no frame came at all: `plumb doctor` says how its camera is".into();
        }
        let longer = "watch for longer with --seconds";
        match missing::most(self.without.iter().copied()) {
            Some((why, frames)) => {
                let missing = Missing::new(why, self.is_other_measured);
                format!("{} in {frames}: {}", missing.words(), missing.remedy().unwrap_or(longer))
            }
            None => longer.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::{MarkedInstant, MeasuredPose, ResetReason, TargetInfo, TargetPacket};
    use plumbline::report::GridRejection;
    use plumbline::report::TargetState;

    use super::*;

    fn packet(role: Role, pose: Result<MeasuredPose, NoPose>) -> PosePacket {
        PosePacket {
            sequence: 0,
            capture_time_ns: 0,
            instant: MarkedInstant::FrameArrival,
            latency_us: 0,
            targets: [TargetPacket { role, state: TargetState::Acquiring, pose }]
                .into_iter()
                .collect(),
            upper_trunk: None,
            lower_trunk: None,
        }
    }

    #[test]
    fn a_box_that_looks_for_no_board_is_refused_with_the_remedy() {
        let targets = |roles: &[Role]| Hello {
            device: "ward 3".try_into().unwrap(),
            serial_number: "PL-0001".try_into().unwrap(),
            firmware: "plumbline".try_into().unwrap(),
            config_crc: 7,
            boot_id: 1,
            boot_count: None,
            reset_reason: ResetReason::Unknown,
            width_px: 1456,
            height_px: 1088,
            targets: roles
                .iter()
                .map(|&role| TargetInfo {
                    name: format!("{role:?}").as_str().try_into().unwrap(),
                    role,
                    corners: 30,
                })
                .collect(),
        };
        check_board("UDP", &targets(&[Role::Lower, Role::Scene])).unwrap();
        let error = check_board("UDP", &targets(&[Role::Lower, Role::Upper])).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("Lower, Upper") && text.contains("role = \"scene\""), "{text}");
    }

    #[test]
    fn why_a_board_is_not_seen_is_said() {
        let mut heard = Heard::default();
        assert!(heard.remedy().contains("plumb doctor"));
        // Another target is no frame of the board.
        heard.take(&packet(Role::Upper, Err(NoPose::PoorFit)));
        assert_eq!(heard.frames, 0);
        let measured = MeasuredPose {
            delay_ns: 0,
            theta_rad: [0.1, 0.2, -0.1],
            translation_mm: [1.0, 2.0, 900.0],
            sd_mm: [0.01; 3],
            sd_rad: [0.001; 3],
            correlations: [0.0; 15],
            rms_px: 0.05,
            corners: 54,
        };
        heard.take(&packet(Role::Scene, Ok(measured)));
        assert!(heard.remedy().contains("--seconds"));
        assert!((heard.poses[0].theta()[5] - 900.0).abs() < 1e-6);
        let reason = NoPose::NotFound(GridRejection::Cut);
        heard.take(&packet(Role::Scene, Err(reason)));
        heard.take(&packet(Role::Scene, Err(reason)));
        heard.take(&packet(Role::Scene, Err(NoPose::Searching)));
        assert!(heard.remedy().starts_with("cut by the frame in 2: "), "{}", heard.remedy());
        assert_eq!((heard.frames, heard.poses.len()), (4, 1));
    }

    /// A board that every frame shows has the right columns, and light enough.
    #[test]
    fn too_few_frames_and_a_board_that_is_not_seen_have_different_remedies() {
        let more = too_few(1, 1, "check its columns");
        assert!(more.contains("10 are needed") && more.contains("give more"), "{more}");
        assert!(!more.contains("columns"), "{more}");
        for (poses, frames) in [(0, 0), (0, 1), (3, 40)] {
            let remedy = too_few(poses, frames, "check its columns");
            assert_eq!(remedy, "10 are needed: check its columns");
        }
    }
}
