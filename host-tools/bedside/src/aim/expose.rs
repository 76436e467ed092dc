//! The controller on a real camera.

use std::cmp::Ordering;
use std::time::{Duration, Instant};

use plumbline::config::{Capture, CaptureDriver, Config};
use plumbline::packet::{Hello, Refusal, View};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_stream::link::BoxLink;

use super::exposure::{Controller, Judged, Light, Setting, Step, Verdict};
use super::session::{Exposed, Session, SilenceLines};
use crate::delivery::{self, Before};
use crate::told::Tell;

/// After a change the camera is reopened, and some cameras take a few frames to follow.
const SETTLED_AFTER: Duration = Duration::from_millis(500);

/// A setting is judged by the median of this many frames that show a target.
const VIEWS: usize = 3;

/// A target that is not found by then is taken to be absent.
const FOUND_WITHIN: Duration = Duration::from_millis(2500);

/// Frames that show another setting after this time show that the camera refuses the new one.
const REFUSED_AFTER: Duration = Duration::from_secs(1);

/// Frames with a new setting come within this time, or not at all.
const FRAMES_WITHIN: Duration = Duration::from_secs(15);

/// A box that restarts this often while a setting is sought may restart because of one.
const RESTARTS_MAX: u32 = 3;

/// Who follows a search.
pub trait Follower {
    /// Hears, in words, what was tried, what it gave, and that the box is silent or has restarted.
    ///
    /// # Errors
    /// End the search.
    fn say(&mut self, text: &str) -> Result<(), BadInput>;

    /// Whether the search is to end, asked many times a second.
    fn is_over(&mut self) -> bool;
}

/// Finds the exposure and the gain at which the targets are well exposed; `None` when the follower
/// ended the search.
///
/// # Errors
/// When the box cannot be used, no setting is good, or the follower cannot be told.
pub fn find(
    session: &mut Session,
    follower: &mut dyn Follower,
) -> Result<Option<Setting>, BadInput> {
    let Some(capture) = session.config().capture.clone() else {
        return Err(BadInput::new(
            session.place(),
            "capture",
            "the box's configuration has no camera",
            "provision the box with a --box file that has a [capture] table",
        ));
    };
    let configured = Setting { exposure_us: capture.exposure_us, gain: capture.gain };
    let gain_step = match capture.driver {
        CaptureDriver::V4l2 => 1.0,
        CaptureDriver::Libcamera => 0.01,
    };
    let (mut controller, mut setting) = Controller::new(capture.rate_hz, configured, gain_step);
    let mut silence_lines = SilenceLines::default();
    loop {
        let restarts = session.restarts();
        let seen = match session.expose(setting.exposure_us, setting.gain)? {
            Exposed::AsAsked => light_with(session, setting, &mut silence_lines, follower)?,
            Exposed::Refused(refusal, reason) => Seen::Refused(refusal, reason),
            Exposed::Unheard => Seen::Silence,
        };
        // What was seen may be from before.
        let seen = if session.restarts() == restarts { seen } else { Seen::Restart };
        let step = match seen {
            Seen::Light(light) => {
                follower.say(&format!("{setting}: {}", light_words(&light)))?;
                controller.next(light)
            }
            Seen::Refused(refusal, reason) => {
                follower.say(&format!("{setting}: the camera does not accept it"))?;
                match controller.refused() {
                    Some(step) => step,
                    None => return Err(session.refused("the exposure", refusal, &reason)),
                }
            }
            Seen::Silence => {
                while session.silence().is_some() && !follower.is_over() {
                    turn(session, &mut silence_lines, follower)?;
                }
                if follower.is_over() {
                    return Ok(None);
                }
                continue;
            }
            Seen::Restart => {
                let restarts = session.restarts();
                if restarts > RESTARTS_MAX {
                    return Err(BadInput::whole(
                        session.place(),
                        format!("the box has restarted {} meanwhile", counted(restarts, "time")),
                        "`plumb doctor` shows its state",
                    ));
                }
                follower.say("the box has restarted; the same setting again")?;
                continue;
            }
            Seen::Stopped => return Ok(None),
        };
        match step {
            Step::Try(next) => setting = next,
            Step::Done(Verdict::Good) => break,
            Step::Done(verdict) => return Err(failure(session, verdict, controller.current())),
        }
    }
    let setting = controller.current();
    follower.say(&format!("found: {setting}"))?;
    let half_us = controller.half_frame_us();
    match setting.exposure_us.map(|exposure_us| exposure_us.cmp(&half_us)) {
        Some(Ordering::Equal) => follower.say(&format!(
            "half a frame is {half_us} us: what moves is blurred by a longer exposure, and gain \
             costs less"
        ))?,
        Some(Ordering::Greater) => follower.say(&format!(
            "this is more than half a frame ({half_us} us): what moves is blurred; more light is \
             better"
        ))?,
        _ => {}
    }
    Ok(Some(setting))
}

/// Puts a setting into the configuration of the box that it was found with, and starts the box
/// with it.
///
/// # Errors
/// When the box does not accept it.
pub fn store(
    link: &mut BoxLink,
    met: &Hello,
    setting: Setting,
    tell: &mut Tell<'_>,
) -> Result<(), BadInput> {
    let (hello, old) = (link.hello()?, link.config_to_change()?);
    link.refuse_another(met, &hello)?;
    let capture = old.capture.clone().map(|capture| Capture {
        exposure_us: setting.exposure_us,
        gain: setting.gain,
        ..capture
    });
    let config = Config { capture, ..old.clone() };
    delivery::deliver(link, &Before { hello: Some(hello), config: Some(old) }, &config, true, tell)
}

/// The outcome of a setting.
enum Seen {
    Light(Light),
    /// By the box, or by its camera.
    Refused(Refusal, String),
    /// Nothing is heard of the box, which may be restarting.
    Silence,
    /// It has restarted, with its own setting.
    Restart,
    Stopped,
}

fn turn(
    session: &mut Session,
    silence_lines: &mut SilenceLines,
    follower: &mut dyn Follower,
) -> Result<(), BadInput> {
    session.turn()?;
    silence_lines.next(session.silence()).map_or(Ok(()), |text| follower.say(&text))
}

/// The light with a setting.
fn light_with(
    session: &mut Session,
    setting: Setting,
    silence_lines: &mut SilenceLines,
    follower: &mut dyn Follower,
) -> Result<Seen, BadInput> {
    let start = Instant::now();
    let restarts = session.restarts();
    let mut first: Option<Instant> = None;
    let mut sequence = None;
    let (mut targets, mut frames) = (Vec::new(), Vec::new());
    while !follower.is_over() {
        turn(session, silence_lines, follower)?;
        if session.restarts() != restarts {
            return Ok(Seen::Restart);
        }
        if session.silence().is_some() {
            return Ok(Seen::Silence);
        }
        let is_new = |view: &&View| sequence != Some(view.sequence);
        let now = Instant::now();
        if let Some(view) = session.view().filter(is_new) {
            sequence = Some(view.sequence);
            let with = Setting { exposure_us: view.exposure_us, gain: view.gain };
            if !is_taken(setting, with) {
                // The box goes back to its own setting where the camera refuses one.
                if now - start >= REFUSED_AFTER {
                    let reason = "its camera does not accept it".to_owned();
                    return Ok(Seen::Refused(Refusal::Unusable, reason));
                }
            } else if now - *first.get_or_insert(now) >= SETTLED_AFTER {
                let light = Light::of(view);
                let lights = if light.of == Judged::Target { &mut targets } else { &mut frames };
                lights.push(light);
            }
        }
        if targets.len() == VIEWS {
            return Ok(Seen::Light(middle(targets)));
        }
        let is_late = first.is_some_and(|first| now - first >= FOUND_WITHIN);
        if is_late && !(targets.is_empty() && frames.is_empty()) {
            return Ok(Seen::Light(middle(if targets.is_empty() { frames } else { targets })));
        }
        if now - start >= FRAMES_WITHIN {
            let why = session.without_frames().map(|why| format!(": {why}")).unwrap_or_default();
            return Err(BadInput::whole(
                session.place(),
                format!("no frame comes with {setting}{why}"),
                "`plumb doctor` says what is wrong with its camera; then start `plumb aim \
                 --expose` again",
            ));
        }
    }
    Ok(Seen::Stopped)
}

/// Whether frames are exposed as asked for; what is not asked for is as configured.
fn is_taken(asked: Setting, with: Setting) -> bool {
    asked.exposure_us.is_none_or(|_| asked.exposure_us == with.exposure_us)
        && asked.gain.is_none_or(|_| asked.gain == with.gain)
}

fn middle(mut lights: Vec<Light>) -> Light {
    lights.sort_by(|a, b| a.level.total_cmp(&b.level));
    lights[lights.len() / 2]
}

fn failure(session: &Session, verdict: Verdict, setting: Setting) -> BadInput {
    let (found, remedy) = match verdict {
        Verdict::TooDark => (
            format!("the targets are too dark even with {setting}"),
            "open the aperture, or add light",
        ),
        Verdict::TooBright => (
            format!("the targets are too bright even with {setting}"),
            "close the aperture, or reduce the light",
        ),
        Verdict::NoTarget => (
            format!("with {setting} the frame is bright enough, and no target is found"),
            "bring a target into the picture and focus first: `plumb aim`",
        ),
        Verdict::Unsettled | Verdict::Good => (
            format!("the light does not settle; the last try was {setting}"),
            "keep light and targets still meanwhile, and switch off what the camera regulates \
             by itself",
        ),
    };
    BadInput::whole(session.place(), found, remedy)
}

fn light_words(light: &Light) -> String {
    let Light { level, saturated, .. } = light;
    let of = match light.of {
        Judged::Target => "the brightest target's light squares",
        Judged::Frame => "no target is found, the frame",
    };
    format!("{of} at {level:.2} of white, {:.1} % saturated", 100.0 * saturated)
}
