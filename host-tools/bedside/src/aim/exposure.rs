//! From the brightness of the targets to the exposure at which they are well exposed.
//!
//! Only the targets' squares count: a bright window in the room may be saturated.
//! Where no target is found, the whole frame is brought into a range in which one would be.
//!
//! ```text
//!  exposure, at most half a frame ─▶ gain ─▶ exposure, at most a frame ─▶ too dark
//!        brightness is black + slope x exposure      unit unknown: secants
//! ```
//!
//! Half a frame, because motion while the shutter is open blurs the edges: a body that sways at
//! 20 mm/s moves by a third of a pixel in half of 1/60 s. Gain comes before the other half,
//! because its noise is averaged over many pixels, and blur is not.

use std::fmt;

use crate::bounds::SATURATED_MAX;
use plumbline::packet::View;

/// The brightest target's light squares are brought here, as a part of white: bright, and so far
/// below white that a step towards the light does not saturate them.
const LIGHT_GOAL: f32 = 0.75;

/// This far from the goal is near enough: a tenth of a stop.
const LIGHT_TOLERANCE: f32 = 0.05;

/// Without a target the frame's mean is brought here, and this part of it near; where none is
/// found then, to the next: paper may be much brighter than the room, or darker.
const FRAME_GOALS: [f32; 3] = [0.35, 0.15, 0.6];
const FRAME_TOLERANCE: f32 = 0.25;

/// From this level on, a level no longer follows the brightness.
const LEVEL_CERTAIN_MAX: f32 = 0.95;

/// A saturated level is taken to be higher than white by this factor.
const DARKER: f32 = 0.35;

/// Saturation that remains at the goal, as of a shiny print: the goal itself is lowered.
const GOAL_LOWERED: f32 = 0.85;

/// The shortest exposure that is asked for: with most shutters, shorter ones are uneven.
const EXPOSURE_US_MIN: u32 = 20;

/// The most exposures and gains that are tried.
const TRIES_MAX: usize = 12;

/// The longest step of the gain: its unit may be a logarithm.
const GAIN_FACTOR_MAX: f32 = 4.0;

/// The gain that is tried first where none is set: a factor of 1, or the first of a driver's
/// steps.
const GAIN_FIRST: f32 = 1.0;

/// A step of the gain that changes the level by less than this part of it has no effect.
const GAIN_EFFECT_MIN: f32 = 0.02;

/// A step of the exposure that changes the level by less than this part of what it should has no effect.
const EFFECT_MIN: f32 = 0.2;

/// What a camera is asked for; `None`: as configured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// Exposure time.
    pub exposure_us: Option<u32>,
    /// Gain, in the camera's unit.
    pub gain: Option<f32>,
}

impl fmt::Display for Setting {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.exposure_us {
            Some(exposure_us) => write!(formatter, "exposure {exposure_us} us")?,
            None => write!(formatter, "the camera's own exposure")?,
        }
        self.gain.map_or(Ok(()), |gain| write!(formatter, ", gain {gain}"))
    }
}

/// What the light is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Judged {
    /// The light squares of the brightest target.
    Target,
    /// The whole frame: no target was measured.
    Frame,
}

/// How bright the picture is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Light {
    /// Of what.
    pub of: Judged,
    /// Part of white.
    pub level: f32,
    /// Part of the pixels that are white.
    pub saturated: f32,
}

impl Light {
    /// Of one frame.
    pub fn of(view: &View) -> Self {
        let brightest = view.targets.iter().max_by(|a, b| a.light.total_cmp(&b.light));
        match brightest {
            Some(target) => {
                let saturated = view.targets.iter().map(|target| target.saturated);
                let saturated = saturated.fold(0.0, f32::max);
                Self { of: Judged::Target, level: target.light, saturated }
            }
            None => {
                Self { of: Judged::Frame, level: view.frame.level, saturated: view.frame.saturated }
            }
        }
    }
}

/// What to do next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Step {
    /// Take frames with this setting.
    Try(Setting),
    /// It is over.
    Done(Verdict),
}

/// The end of a search, with the setting tried last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Verdict {
    /// The targets are well exposed.
    Good,
    /// No setting makes them bright enough.
    TooDark,
    /// No setting makes them dark enough.
    TooBright,
    /// The frame is neither dark nor white, but shows no target.
    NoTarget,
    /// The light does not follow the settings, or not within the allowed number of steps.
    Unsettled,
}

/// What is changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Knob {
    /// Up to half a frame.
    Exposure,
    Gain,
    /// Up to a whole frame.
    LongExposure,
}

/// One setting, and what it gave.
#[derive(Debug, Clone, Copy)]
struct Tried {
    exposure_us: Option<u32>,
    gain: Option<f32>,
    light: Light,
}

/// Finds the exposure, a step at a time.
pub(crate) struct Controller {
    /// How long a frame lasts.
    frame_us: u32,
    /// The exposure is `None` where the camera has no control of it.
    setting: Setting,
    gain_step: f32,
    goal: f32,
    /// Which of [`FRAME_GOALS`].
    frame_goal: usize,
    knob: Knob,
    /// The camera takes none, or none above the last that had an effect.
    gain_is_limited: bool,
    tried: Vec<Tried>,
}

impl Controller {
    /// For a camera of this rate, whose gain has steps of this size; and what to try first.
    pub fn new(rate_hz: f32, now: Setting, gain_step: f32) -> (Self, Setting) {
        let frame_us = (1e6 / rate_hz) as u32;
        let half = frame_us / 2;
        // Where the camera has its own, one that leaves room on both sides.
        let exposure_us = now.exposure_us.unwrap_or(half / 4).clamp(EXPOSURE_US_MIN, half);
        let controller = Self {
            frame_us,
            setting: Setting { exposure_us: Some(exposure_us), gain: now.gain },
            gain_step,
            goal: LIGHT_GOAL,
            frame_goal: 0,
            knob: Knob::Exposure,
            gain_is_limited: false,
            tried: Vec::new(),
        };
        let first = controller.current();
        (controller, first)
    }

    /// The setting that is being tried, or was last.
    pub fn current(&self) -> Setting {
        self.setting
    }

    /// The longest exposure that is asked for before the gain.
    pub fn half_frame_us(&self) -> u32 {
        self.frame_us / 2
    }

    /// What to do after the setting last tried gave this light.
    pub fn next(&mut self, light: Light) -> Step {
        let Setting { exposure_us, gain } = self.setting;
        self.tried.push(Tried { exposure_us, gain, light });
        let is_near = (light.level - self.goal_of(light.of)).abs()
            <= match light.of {
                Judged::Target => LIGHT_TOLERANCE,
                Judged::Frame => FRAME_TOLERANCE * self.goal_of(light.of),
            };
        match light.of {
            Judged::Target if is_near && light.saturated <= SATURATED_MAX => {
                return Step::Done(Verdict::Good);
            }
            Judged::Target if is_near => self.goal *= GOAL_LOWERED,
            Judged::Frame if is_near && self.frame_goal + 1 == FRAME_GOALS.len() => {
                return Step::Done(Verdict::NoTarget);
            }
            Judged::Frame if is_near => self.frame_goal += 1,
            _ => {}
        }
        if self.tried.len() == TRIES_MAX {
            return Step::Done(Verdict::Unsettled);
        }
        let goal = self.goal_of(light.of);
        match self.knob {
            Knob::Exposure => self.expose_towards(goal, self.half_frame_us()),
            Knob::Gain => self.amplify_towards(goal),
            Knob::LongExposure => self.expose_towards(goal, self.frame_us),
        }
    }

    /// What to do when the camera has refused the setting last tried: it goes on with the gain
    /// alone where the first exposure was, or with the exposure where a gain was; or there is
    /// nothing.
    pub fn refused(&mut self) -> Option<Step> {
        let Some(last) = self.tried.last().copied() else {
            self.setting.exposure_us.take()?;
            self.knob = Knob::Gain;
            return Some(Step::Try(self.setting));
        };
        if self.knob != Knob::Gain {
            return None;
        }
        self.gain_is_limited = true;
        self.setting = Setting { exposure_us: last.exposure_us, gain: last.gain };
        Some(self.without_gain(self.goal_of(last.light.of)))
    }

    /// Where the light is to be.
    fn goal_of(&self, judged: Judged) -> f32 {
        match judged {
            Judged::Target => self.goal,
            Judged::Frame => FRAME_GOALS[self.frame_goal],
        }
    }

    fn last(&self) -> Tried {
        *self.tried.last().expect("called after a light has come")
    }

    fn try_with(&mut self, exposure_us: Option<u32>, gain: Option<f32>) -> Step {
        self.setting = Setting { exposure_us, gain };
        Step::Try(self.setting)
    }

    fn expose_towards(&mut self, goal: f32, exposure_us_max: u32) -> Step {
        let last = self.last();
        let is_dark = last.light.level < goal;
        let bound = if is_dark { exposure_us_max } else { EXPOSURE_US_MIN };
        if let Some(exposure_us) = last.exposure_us
            && exposure_us != bound
            && !self.is_without_effect()
        {
            let wanted = self.exposure_for(goal, exposure_us as f32);
            let wanted = wanted.clamp(EXPOSURE_US_MIN as f32, exposure_us_max as f32).round();
            if wanted as u32 != exposure_us {
                return self.try_with(Some(wanted as u32), last.gain);
            }
        }
        match (self.knob, is_dark) {
            (Knob::Exposure, _) => {
                self.knob = Knob::Gain;
                self.amplify_towards(goal)
            }
            (_, true) => Step::Done(Verdict::TooDark),
            (_, false) => Step::Done(Verdict::TooBright),
        }
    }

    /// The exposure that gives a level, if brightness is black + slope x exposure.
    fn exposure_for(&self, goal: f32, exposure_us: f32) -> f32 {
        let last = self.last();
        if last.light.level >= LEVEL_CERTAIN_MAX {
            return exposure_us * DARKER;
        }
        if last.light.level <= 0.0 {
            return f32::INFINITY;
        }
        // Black is known from two exposures at one gain; without it a step is too short, and
        // the next one right.
        let black = self
            .before_last()
            .filter(|before| before.gain == last.gain && before.exposure_us != last.exposure_us)
            .and_then(|before| Some((before, before.exposure_us? as f32)))
            .map_or(0.0, |(before, before_us)| {
                let slope = (last.light.level - before.light.level) / (exposure_us - before_us);
                (last.light.level - slope * exposure_us).clamp(0.0, 0.9 * last.light.level)
            });
        exposure_us * (goal - black).max(0.0) / (last.light.level - black)
    }

    /// The setting before the last one, if both lights can be compared.
    fn before_last(&self) -> Option<Tried> {
        let [.., before, last] = self.tried[..] else { return None };
        let certain = |tried: &Tried| tried.light.level < LEVEL_CERTAIN_MAX;
        (before.light.of == last.light.of && certain(&before) && certain(&last)).then_some(before)
    }

    /// The last change of the exposure alone has changed next to nothing.
    fn is_without_effect(&self) -> bool {
        let (Some(before), last) = (self.before_last(), self.last()) else { return false };
        let Some((now_us, before_us)) = last.exposure_us.zip(before.exposure_us) else {
            return false;
        };
        let part = now_us as f32 / before_us as f32 - 1.0;
        let expected = before.light.level * part;
        before.gain == last.gain
            && part != 0.0
            && (last.light.level - before.light.level) / expected < EFFECT_MIN
    }

    fn amplify_towards(&mut self, goal: f32) -> Step {
        let last = self.last();
        let is_dark = last.light.level < goal;
        if self.gain_is_limited {
            return self.without_gain(goal);
        }
        let Some(gain) = last.gain else {
            return self.try_with(last.exposure_us, Some(GAIN_FIRST));
        };
        let before = self.tried.iter().rev().skip(1).copied().find_map(|tried| {
            let is_alike = tried.exposure_us == last.exposure_us && tried.light.of == last.light.of;
            let before_gain = tried.gain.filter(|&before| is_alike && before != gain)?;
            Some((tried, before_gain))
        });
        let Some((before, before_gain)) = before else {
            let factor = goal / last.light.level.max(1e-3);
            let wanted = if gain == 0.0 && is_dark { GAIN_FIRST } else { gain * factor };
            return self.try_gain(wanted, goal);
        };
        let (change, step) = (last.light.level - before.light.level, gain - before_gain);
        if change * step.signum() < GAIN_EFFECT_MIN * before.light.level {
            // A small step may be less than one of the driver's, or be one below its least.
            let least = before_gain.min(gain).max(GAIN_FIRST);
            if before_gain.max(gain) < GAIN_FACTOR_MAX * least {
                let factor = if is_dark { GAIN_FACTOR_MAX } else { 1.0 / GAIN_FACTOR_MAX };
                return self.try_gain(gain * factor, goal);
            }
            // The one before does as much, and is within the camera's range.
            self.gain_is_limited = true;
            self.tried.push(before);
            return self.without_gain(goal);
        }
        let brackets = (before.light.level < goal) != is_dark;
        let is_certain =
            last.light.level < LEVEL_CERTAIN_MAX && before.light.level < LEVEL_CERTAIN_MAX;
        let wanted = if brackets && !is_certain {
            0.5 * (gain + before_gain)
        } else {
            gain + (goal - last.light.level) * step / change
        };
        self.try_gain(wanted, goal)
    }

    fn try_gain(&mut self, wanted: f32, goal: f32) -> Step {
        let (exposure_us, gain) = (self.last().exposure_us, self.last().gain.unwrap_or(0.0));
        let least = gain / GAIN_FACTOR_MAX;
        let most = GAIN_FACTOR_MAX * gain.max(GAIN_FIRST);
        let wanted = (wanted.clamp(least, most) / self.gain_step).round() * self.gain_step;
        if wanted == gain {
            self.gain_is_limited = true;
            return self.without_gain(goal);
        }
        self.try_with(exposure_us, Some(wanted))
    }

    /// The gain is of no more use.
    fn without_gain(&mut self, goal: f32) -> Step {
        if self.last().light.level >= goal {
            return Step::Done(Verdict::TooBright);
        }
        self.knob = Knob::LongExposure;
        self.expose_towards(goal, self.frame_us)
    }
}

#[cfg(test)]
mod tests;
