//! The scene board's poses as a live box sends them.

use std::time::{Duration, Instant};

use plumbline::lens::Lens;
use plumbline::packet::{Hello, Message, PosePacket};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::NoPose;
use plumbline::target::Role;
use plumbline_calibration::background::REDUCTION;
use plumbline_files::BadInput;
use plumbline_stream::link::BoxLink;

use super::Seen;
use crate::snapshot;
use crate::ui::missing::{self, Missing};
use crate::ui::waiting::Waiting;

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
pub(super) fn check_board(place: &str, hello: &Hello) -> Result<(), BadInput> {
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

/// Listens for a while to the box, which sees through this lens.
pub(super) fn listen(
    link: &mut BoxLink,
    hello: &Hello,
    lens: Lens,
    duration: Duration,
) -> Result<Seen, BadInput> {
    let mut heard = Heard::default();
    {
        let _waiting = Waiting::new("watching the board");
        link.messages(Instant::now() + duration, |message| -> Option<()> {
            if let Message::Pose(packet) = message {
                heard.take(packet);
            }
            None
        })?;
    }
    // The scene is right without it.
    let background = snapshot::take(link, REDUCTION)
        .inspect_err(|error| eprintln!("warning: no picture of the background: {error}"))
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
}
