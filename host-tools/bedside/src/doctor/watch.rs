//! Watching a box: listening to it, asking for its time, its state and its views, and looking at
//! its camera's background.

use std::time::{Duration, Instant};

use plumbline::packet::{Action, LinkKind};
use plumbline_calibration::background::{REDUCTION, motion};
use plumbline_files::BadInput;
use plumbline_stream::link::{BoxLink, HEARD_WITHIN, Introduction};

use super::findings::{Background, Expected, Findings};
use crate::told::{Tell, waiting};
use crate::{background, scale, snapshot};

/// Ten questions for the time a second, out of step with the frames of every usual camera: a
/// box looks for questions between frames, and the soonest answer counts.
pub(crate) const PING_EVERY: Duration = Duration::from_millis(97);

/// A view costs the box less than a search, and the light changes slowly.
pub(crate) const VIEW_EVERY: Duration = Duration::from_millis(480);

/// What was asked last is answered by then.
pub(crate) const LAST_ANSWERS: Duration = Duration::from_millis(300);

/// Finds out all that can be found out about the box in this time.
///
/// # Errors
/// When the link cannot be used any more; a box that is not heard is a finding.
pub fn watch(
    link: &mut BoxLink,
    duration: Duration,
    expected: Option<Expected>,
    tell: &mut Tell<'_>,
) -> Result<Findings, BadInput> {
    let started = Instant::now();
    let mut findings = Findings {
        place: link.place().to_owned(),
        is_serial: link.kind() == LinkKind::Serial,
        expected,
        ..Findings::default()
    };
    waiting(tell, format!("listening at {}", link.place()), || {
        link.listen(started + HEARD_WITHIN, |event| {
            findings.hear(event);
            (findings.packets > 0).then_some(())
        })
    })?;
    if findings.packets == 0 {
        findings.other = link.obstacle();
        return Ok(findings);
    }
    waiting(tell, "asking it who it is, and for its configuration", || ask(link, &mut findings));
    if findings.refusing.is_some() {
        return Ok(findings);
    }
    waiting(tell, format!("watching it for {} s", duration.as_secs_f64()), || {
        look(link, duration, started, &mut findings)
    })?;
    findings.compared = findings.config().map(scale::all_kept).unwrap_or_default();
    let scene_theta = findings.config().and_then(|config| config.cam_from_scene_theta);
    findings.background = scene_theta.map(|theta| compare(link, &theta, tell));
    Ok(findings)
}

/// Asks a box who it is and what it runs with.
fn ask(link: &mut BoxLink, findings: &mut Findings) {
    match link.introduction() {
        Ok(Introduction::Hello(hello)) => findings.hello = Some(hello),
        Ok(Introduction::Refusing(text)) => {
            findings.refusing = Some(text);
            return;
        }
        // It may still tell by itself.
        Err(_) => (),
    }
    let (config, next_crc) = link
        .config_and_next()
        .map_or_else(|error| (Err(error), None), |(config, next_crc)| (Ok(config), Some(next_crc)));
    (findings.config, findings.next_crc) = (Some(config), next_crc);
}

/// Compares what stands behind the person with what stood there when the scene was measured.
fn compare(link: &mut BoxLink, scene_theta: &[f64; 6], tell: &mut Tell<'_>) -> Background {
    let reference = match background::kept(scene_theta) {
        Ok(Some(reference)) => reference,
        Ok(None) => {
            return Background::NotCompared(
                "this computer has no picture from when the scene was measured (`plumb scene` keeps \
                 one)"
                    .into(),
            );
        }
        Err(error) => return Background::NotCompared(error.to_string()),
    };
    match snapshot::take(link, REDUCTION, tell) {
        Ok(now) => Background::Compared(motion(&reference, &now)),
        Err(error) => Background::NotCompared(error.to_string()),
    }
}

fn look(
    link: &mut BoxLink,
    duration: Duration,
    started: Instant,
    findings: &mut Findings,
) -> Result<(), BadInput> {
    let now_ns = || started.elapsed().as_nanos() as u64;
    let begun = Instant::now();
    let end = begun + duration;
    let (mut ping_at, mut view_at) = (begun, begun);
    link.send(Action::SendHealth);
    while Instant::now() < end {
        let now = Instant::now();
        if now >= ping_at {
            link.send(Action::Ping { host_sent_ns: now_ns() });
            findings.pings += 1;
            ping_at = now + PING_EVERY;
        }
        if now >= view_at {
            link.send(Action::SendView);
            view_at = now + VIEW_EVERY;
        }
        let until = ping_at.min(view_at).min(end);
        link.listen(until, |event| -> Option<()> {
            findings.take(event, now_ns());
            None
        })?;
    }
    link.send(Action::SendHealth);
    link.listen(Instant::now() + LAST_ANSWERS, |event| -> Option<()> {
        findings.take(event, now_ns());
        None
    })?;
    findings.silence_s = now_ns().saturating_sub(findings.heard_ns) as f64 * 1e-9;
    Ok(())
}
