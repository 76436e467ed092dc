//! What a technician is told about a frame: numbers per target, and what to do about them.

use crate::missing::Missing;
use plumbline::config::Config;
use plumbline::packet::{PosePacket, TargetPacket, View};
use plumbline::report::TargetState;
use plumbline::target::Role;
use plumbline::view::TargetView;
use plumbline_files::camera;

use crate::bounds::{
    CONTRAST_MIN, COVERAGE, FOCUS_MIN, LIGHT_MIN, MOTION_BLUR_PX_MIN, MOTION_RATIO, PITCH_PX_MIN,
    SATURATED_MAX, focus_score,
};

/// A score this much lower than the best means that the best focus has been passed.
const FOCUS_PASSED: u8 = 5;

/// A frame without a target that is darker than this shows none because it is too dark.
const DARK_FRAME: f32 = 0.1;

/// And one of which more than this share is white, because it is too bright.
const BRIGHT_FRAME: f32 = 0.3;

/// A score, and the best since the program's start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Focus {
    /// Now.
    pub score: u8,
    /// The best so far.
    pub best: u8,
}

impl Focus {
    fn advice(self) -> Option<String> {
        let Self { score, best } = self;
        if score >= FOCUS_MIN && score + FOCUS_PASSED > best {
            return None;
        }
        Some(if best > score {
            format!("turn the lens: {score} of 100, best so far {best}")
        } else {
            format!("turn the lens: {score} of 100")
        })
    }
}

/// The best focus so far, of each target and of the whole frame.
#[derive(Debug, Default)]
pub struct BestFocus(Vec<(Option<Role>, u8)>);

impl BestFocus {
    fn with(&mut self, role: Option<Role>, score: u8) -> Focus {
        let place = self.0.iter().position(|(known, _)| *known == role).unwrap_or_else(|| {
            self.0.push((role, 0));
            self.0.len() - 1
        });
        let best = &mut self.0[place].1;
        *best = score.max(*best);
        Focus { score, best: *best }
    }
}

/// What is shown of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Of the frame as a whole.
    pub frame: FrameReading,
    /// Of each target, in the order of the configuration.
    pub targets: Vec<TargetReading>,
}

/// Of a frame as a whole.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameReading {
    /// Its numbers, in words.
    pub text: String,
    /// What to do.
    pub advice: Vec<String>,
}

/// Of a target.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetReading {
    /// The target.
    pub name: String,
    /// Its state, and why it has no pose.
    pub state: String,
    /// Whether it has a pose.
    pub is_found: bool,
    /// Its numbers, where it was measured.
    pub figures: Option<TargetFigures>,
    /// Its numbers, each in words; none where it was not measured.
    pub numbers: Vec<String>,
    /// What to do.
    pub advice: Vec<String>,
}

/// The numbers of a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetFigures {
    /// 0 to 100, as sharp as it gets.
    pub focus: u8,
    /// The best so far.
    pub focus_best: u8,
    /// The light squares, as a part of white.
    pub light: f32,
    /// The same minus the dark ones.
    pub contrast: f32,
    /// The size of a square.
    pub pitch_px: f32,
}

impl Reading {
    /// The one thing to do next; `None` where all is as it should be.
    #[must_use]
    pub fn next(&self) -> Option<String> {
        let of_target =
            |it: &TargetReading| it.advice.first().map(|advice| format!("{}: {advice}", it.name));
        // A target that is seen is put right before another one is looked for.
        let (seen, unseen): (Vec<_>, Vec<_>) = self.targets.iter().partition(|it| it.is_found);
        let targets = || seen.iter().copied().chain(unseen.iter().copied());
        let not_found = |it: &TargetReading| {
            (!it.is_found).then(|| format!("bring {} into the picture", it.name))
        };
        targets()
            .find_map(of_target)
            .or_else(|| self.frame.advice.first().cloned())
            .or_else(|| targets().find_map(not_found))
    }

    /// All of it, a line per target, and one for the frame.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let targets = self.targets.iter().map(TargetReading::line);
        targets.chain([self.frame.line()]).collect()
    }
}

impl TargetReading {
    fn line(&self) -> String {
        let told = [format!("{}: {}", self.name, self.state)].into_iter();
        let line = told.chain(self.numbers.iter().cloned()).collect::<Vec<_>>().join(", ");
        with_advice(line, &self.advice)
    }
}

impl FrameReading {
    fn line(&self) -> String {
        with_advice(format!("frame: {}", self.text), &self.advice)
    }
}

fn with_advice(line: String, advice: &[String]) -> String {
    if advice.is_empty() { line } else { format!("{line} -> {}", advice.join("; ")) }
}

/// What a frame's numbers say.
pub(crate) fn read(
    config: &Config,
    view: &View,
    pose: Option<&PosePacket>,
    best: &mut BestFocus,
) -> Reading {
    let is_calibrated = !camera::is_stand_in(&config.lens);
    let targets: Vec<_> = config
        .targets
        .iter()
        .map(|target| {
            let role = target.geometry.role();
            let seen = view.targets.iter().find(|seen| seen.role == role);
            let found =
                pose.and_then(|pose| pose.targets.iter().find(|target| target.role == role));
            let is_other_measured = pose.is_some_and(|pose| is_other_measured(pose, role));
            target_reading(&target.name, is_calibrated, seen, found, is_other_measured, best)
        })
        .collect();
    Reading { frame: frame_reading(view, best), targets }
}

/// Whether a grid in the frame is another one of the box's targets.
fn is_other_measured(pose: &PosePacket, role: Role) -> bool {
    pose.targets.iter().any(|target| target.role != role && target.pose.is_ok())
}

fn target_reading(
    name: &str,
    is_calibrated: bool,
    seen: Option<&TargetView>,
    found: Option<&TargetPacket>,
    is_other_measured: bool,
    best: &mut BestFocus,
) -> TargetReading {
    let mut numbers = Vec::new();
    let mut advice = Vec::new();
    let mut figures = None;
    if let Some(seen) = seen {
        // A picture is as sharp as the worse of its directions.
        let focus = best.with(Some(seen.role), focus_score(seen.blur_px[0].max(seen.blur_px[1])));
        numbers.push(format!("focus {} (best {})", focus.score, focus.best));
        numbers.push(format!("contrast {:.2}", seen.light - seen.dark));
        numbers.push(format!("light {:.2}", seen.light));
        numbers.push(format!("saturated {:.1} %", 100.0 * seen.saturated));
        numbers.push(format!("{:.1} px per square", seen.pitch_px));
        advice.extend(advice_on(seen, focus));
        figures = Some(TargetFigures {
            focus: focus.score,
            focus_best: focus.best,
            light: seen.light,
            contrast: seen.light - seen.dark,
            pitch_px: seen.pitch_px,
        });
    }
    let mut state = match found {
        Some(found) => found.state.word().to_owned(),
        None => TargetState::Acquiring.word().to_owned(),
    };
    match found.map(|found| &found.pose) {
        Some(Ok(pose)) => {
            if is_calibrated {
                let [x, y, z] = pose.translation_mm;
                numbers.push(format!("{:.0} mm away", (x * x + y * y + z * z).sqrt()));
                numbers.push(format!("depth +-{:.3} mm per frame", COVERAGE * pose.sd_mm[2]));
            } else {
                numbers.push("no distance before the calibration".to_owned());
            }
        }
        Some(Err(why)) => {
            let missing = Missing::new(*why, is_other_measured);
            state = format!("{state}, {}", missing.words());
            advice.extend(missing.remedy().map(str::to_owned));
        }
        None => {}
    }
    let is_found = found.is_some_and(|found| found.pose.is_ok());
    TargetReading { name: name.to_owned(), state, is_found, figures, numbers, advice }
}

/// In the order in which it is to be followed: light first, because all else needs it.
fn advice_on(seen: &TargetView, focus: Focus) -> Vec<String> {
    let mut advice = Vec::new();
    if seen.saturated > SATURATED_MAX {
        advice.push("light squares are saturated: expose less".to_owned());
    } else if seen.light < LIGHT_MIN {
        advice.push("too dark: open the aperture or expose longer".to_owned());
    } else if seen.light - seen.dark < CONTRAST_MIN {
        advice.push(
            "little contrast: keep light from shining into the lens or on the print's gloss"
                .to_owned(),
        );
    }
    let [along_x, along_y] = seen.blur_px;
    let (more, less) = (along_x.max(along_y), along_x.min(along_y));
    if more > MOTION_RATIO * less && more > MOTION_BLUR_PX_MIN {
        advice.push("blurred in one direction: hold it still, or expose less".to_owned());
    } else {
        advice.extend(focus.advice());
    }
    if seen.pitch_px < PITCH_PX_MIN {
        advice.push(format!(
            "too far: {:.0} px per square, at least {PITCH_PX_MIN:.0}",
            seen.pitch_px
        ));
    }
    advice
}

fn frame_reading(view: &View, best: &mut BestFocus) -> FrameReading {
    let frame = &view.frame;
    let mut text =
        format!("level {:.2}, {:.1} % of it saturated", frame.level, 100.0 * frame.saturated);
    let mut advice = Vec::new();
    if let Some(blur_px) = frame.blur_px {
        let focus = best.with(None, focus_score(blur_px));
        text += &format!(", focus of all edges {} (best {})", focus.score, focus.best);
        // A room has soft edges of its own: its score is advice only where there is no better.
        if view.targets.is_empty() {
            advice.extend(focus.advice());
        }
    }
    if view.targets.is_empty() {
        if frame.level < DARK_FRAME {
            advice.insert(0, "too dark: open the aperture or expose longer".to_owned());
        } else if frame.saturated > BRIGHT_FRAME {
            advice.insert(0, "too bright: expose less".to_owned());
        }
    }
    FrameReading { text, advice }
}

#[cfg(test)]
mod tests {
    use plumbline::report::GridRejection;
    use plumbline::report::NoPose;
    use plumbline::view::FrameView;

    use super::*;

    const GOOD: TargetView = TargetView {
        role: Role::Lower,
        light: 0.75,
        dark: 0.1,
        saturated: 0.0,
        blur_px: [0.7, 0.65],
        pitch_px: 28.0,
    };

    fn told(seen: &TargetView, best: &mut BestFocus) -> TargetReading {
        target_reading("lumbar", true, Some(seen), None, false, best)
    }

    #[test]
    fn a_grid_that_is_another_target_is_no_wrong_count_of_corners() {
        let found = TargetPacket {
            role: Role::Upper,
            state: TargetState::Acquiring,
            pose: Err(NoPose::NotFound(GridRejection::OtherDimensions)),
        };
        let told = |is_other_measured| {
            let best = &mut BestFocus::default();
            target_reading("shoulder", true, None, Some(&found), is_other_measured, best).line()
        };
        assert_eq!(
            told(true),
            "shoulder: acquiring, not in the picture -> bring the target into the picture"
        );
        assert_eq!(
            told(false),
            "shoulder: acquiring, other dimensions -> another board is seen: columns and rows in \
             the targets file count INNER corners"
        );
    }

    #[test]
    fn what_is_good_needs_no_advice() {
        let reading = told(&GOOD, &mut BestFocus::default());
        assert_eq!(reading.advice, [""; 0]);
        assert_eq!(
            reading.line(),
            "lumbar: acquiring, focus 96 (best 96), contrast 0.65, light 0.75, saturated 0.0 %, \
             28.0 px per square"
        );
    }

    #[test]
    fn each_fault_has_its_advice() {
        let mut best = BestFocus::default();
        let cases = [
            (TargetView { light: 0.2, ..GOOD }, "too dark: open the aperture or expose longer"),
            (TargetView { saturated: 0.02, ..GOOD }, "light squares are saturated: expose less"),
            (
                TargetView { dark: 0.55, ..GOOD },
                "little contrast: keep light from shining into the lens or on the print's gloss",
            ),
            (TargetView { pitch_px: 12.0, ..GOOD }, "too far: 12 px per square, at least 15"),
            (
                TargetView { blur_px: [0.7, 1.6], ..GOOD },
                "blurred in one direction: hold it still, or expose less",
            ),
            (
                TargetView { blur_px: [1.3, 1.2], ..GOOD },
                "turn the lens: 71 of 100, best so far 96",
            ),
        ];
        told(&GOOD, &mut best);
        for (seen, advice) in cases {
            assert_eq!(told(&seen, &mut best).advice, [advice]);
        }
        // Never better than now: there is nothing to go back to.
        let blurred = TargetView { blur_px: [1.3, 1.3], ..GOOD };
        let advice = told(&blurred, &mut BestFocus::default()).advice;
        assert_eq!(advice, ["turn the lens: 71 of 100"]);
    }

    #[test]
    fn without_a_target_the_frame_says_what_to_do() {
        let frame = FrameView { level: 0.04, saturated: 0.0, blur_px: Some(1.8) };
        let targets = heapless::Vec::new();
        let view = View { sequence: 1, exposure_us: None, gain: None, frame, targets };
        let mut best = BestFocus::default();
        assert_eq!(
            frame_reading(&view, &mut best).line(),
            "frame: level 0.04, 0.0 % of it saturated, focus of all edges 50 (best 50) -> \
             too dark: open the aperture or expose longer; turn the lens: 50 of 100"
        );
    }
}
