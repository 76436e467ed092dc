//! A configuration for a live box: it is sent and kept there, and the box restarts with it.

use std::time::{Duration, Instant};

use plumbline::config::{Config, Links, SerialLink};
use plumbline::packet::{Action, Hello, LinkKind, Message, Refusal, ReplyOutcome};
use plumbline_files::BadInput;
use plumbline_stream::complaints::Complaints;
use plumbline_stream::link::{BoxLink, Introduction};
use plumbline_stream::others;

use crate::box_settings::BoxSettings;
pub use crate::identity::refuse_another_box;
use crate::setup::{self, Places};
use crate::told::{Tell, Told, waiting};

/// The slowest box boots in less, its watchdog's patience included.
const RESTARTED_WITHIN: Duration = Duration::from_secs(60);

/// A box before it gets another configuration, as far as it tells.
#[derive(Debug)]
pub(crate) struct Before {
    /// Who it is; `None` where it runs with no configuration.
    pub hello: Option<Hello>,
    /// What it runs with, where that can be read back.
    pub config: Option<Config>,
}

/// Asks a box who it is and what it runs with, and tells it.
///
/// # Errors
/// When no box is heard, or it does not answer.
fn meet(link: &mut BoxLink, tell: &mut Tell<'_>) -> Result<Before, BadInput> {
    let introduction =
        waiting(tell, format!("listening at {}", link.place()), || link.introduction())?;
    let hello = match introduction {
        Introduction::Hello(hello) => hello,
        Introduction::Refusing(text) => {
            let place = link.place();
            tell(Told::Note(format!("{place}: a box that tracks nothing; it says: {text}")));
            return Ok(Before { hello: None, config: None });
        }
    };
    tell(Told::Note(format!("{}: {}", link.place(), who(&hello))));
    let config = waiting(tell, "reading its configuration back", || link.config());
    warn_of_others(link, tell)?;
    let config = config
        .inspect_err(|error| {
            tell(Told::Warning(format!("{error}; so it is not compared with the new one")));
        })
        .ok();
    Ok(Before { hello: Some(hello), config })
}

/// Tells which other boxes are heard, so that nobody takes one for another.
///
/// # Errors
/// When the link cannot be used any more.
pub fn warn_of_others(link: &mut BoxLink, tell: &mut Tell<'_>) -> Result<(), BadInput> {
    let others = waiting(tell, "listening for other boxes", || link.others())?;
    if let Some(others) = others {
        tell(Told::Warning(format!(
            "{}: {others}. This is the one that was heard first; --box-name chooses",
            link.place()
        )));
    }
    Ok(())
}

/// Waits for a box that runs with a configuration, and tells which one it is.
///
/// # Errors
/// When no box is heard, or it does not answer.
pub fn greet(link: &mut BoxLink, tell: &mut Tell<'_>) -> Result<Hello, BadInput> {
    let hello = waiting(tell, format!("listening at {}", link.place()), || link.hello())?;
    tell(Told::Note(format!("{}: {}", link.place(), who(&hello))));
    Ok(hello)
}

/// A box in a line.
#[must_use]
fn who(hello: &Hello) -> String {
    let Hello { firmware, config_crc, .. } = hello;
    format!("{}, program {firmware}, configuration {config_crc:08x}", others::name(hello))
}

/// Sends a configuration, has the box keep it and, unless `restart` is false, restart with
/// it; tells what came of each.
///
/// # Errors
/// When the box refuses it, does not answer, or does not come back with it.
pub(crate) fn deliver(
    link: &mut BoxLink,
    before: &Before,
    config: &Config,
    restart: bool,
    tell: &mut Tell<'_>,
) -> Result<(), BadInput> {
    for warning in before.config.iter().flat_map(|old| warnings(old, config)) {
        tell(Told::Warning(warning));
    }
    let (hello, crc) = waiting(tell, "sending the configuration", || {
        link.store_config(before.hello.as_ref(), config)
    })?;
    tell(Told::Note(format!("stored, checksum {crc:08x}")));
    if !restart {
        tell(Told::Note("it is in use from the box's next start on".into()));
        return Ok(());
    }
    // No answer is as good as a yes: the box may be on its way down already.
    if let Ok(ReplyOutcome::Refused { refusal, reason }) = link.ask(Action::Reboot) {
        return match refusal {
            Refusal::NotSupported => {
                tell(Told::Note(
                    "this box is not restarted from here; it takes effect at its next start: \
                     start its program again, or switch it off and on"
                        .into(),
                ));
                Ok(())
            }
            _ => Err(link.refused("to restart", refusal, &reason)),
        };
    }
    let goes_elsewhere =
        before.config.as_ref().is_some_and(|old| !stays(link.kind(), &old.links, &config.links));
    if goes_elsewhere {
        tell(Told::Note("the box restarts, and is no longer heard here".into()));
        return Ok(());
    }
    let what = "waiting until the box has restarted";
    let hello = waiting(tell, what, || wait_for_start(link, hello.as_ref()))?;
    if hello.config_crc != crc {
        return Err(BadInput::whole(
            link.place(),
            format!("the box has restarted, but with the configuration {:08x}", hello.config_crc),
            "check that its program takes its configuration from where it stores it, and send it \
             again",
        ));
    }
    tell(Told::Note("the box has restarted with it".into()));
    Ok(())
}

/// Gives a box that is heard another configuration, of these files, once it is certain that it is
/// for this box and that the box can run with it and will be heard again; then as [`deliver`].
/// `force` gives it also where it is another box's, another size's or sends elsewhere, and while
/// somebody records a trial, which that spoils.
///
/// # Errors
/// When it is not certain, or as [`deliver`].
pub fn provision(
    link: &mut BoxLink,
    config: &Config,
    places: &Places,
    force: bool,
    restart: bool,
    tell: &mut Tell<'_>,
) -> Result<(), BadInput> {
    if force {
        link.force();
    }
    let before = meet(link, tell)?;
    if let Some(hello) = &before.hello {
        refuse_another_box(
            link.place(),
            (&hello.device, &hello.serial_number),
            (&config.device, &config.serial_number),
            force,
        )?;
    }
    // One that replays a recording may do so without a camera.
    if before.config.as_ref().is_none_or(|old| old.capture.is_some()) {
        setup::check_for_box(config, places)?;
    }
    if !force {
        if let Some(hello) = &before.hello {
            refuse_other_size(&places.camera, hello, config)?;
        }
        refuse_losing(link, &before, config)?;
    }
    deliver(link, &before, config, restart, tell)
}

/// Gives a box that is heard other settings, as a box file has them, and restarts it; its camera, its
/// targets and its scene stay. It may get another name, and keeps its number, by which its key is known.
/// `place` names the settings in errors.
///
/// # Errors
/// When they cannot be used, or are those of another box, the box would no longer be heard here, or it
/// does not take them.
pub fn store_settings(
    link: &mut BoxLink,
    settings: &BoxSettings,
    place: &str,
    tell: &mut Tell<'_>,
) -> Result<(), BadInput> {
    let hello = link.hello()?;
    let old = link.config_to_change()?;
    if settings.serial_number() != old.serial_number.as_str() {
        return Err(BadInput::new(
            place,
            "serial_number",
            format!(
                "{:?}, and this is the box {:?}",
                settings.serial_number(),
                old.serial_number.as_str()
            ),
            "leave it as it is: by its number a box's key is known",
        ));
    }
    let mut config = old.clone();
    settings.apply(&mut config, place)?;
    let places = Places::all(place);
    setup::configured(&config, &places)?;
    setup::check_for_box(&config, &places)?;
    let before = Before { hello: Some(hello), config: Some(old) };
    refuse_losing(link, &before, &config)?;
    deliver(link, &before, &config, true, tell)
}

/// Waits until the box has restarted, and says who it is.
fn wait_for_start(link: &mut BoxLink, before: Option<&Hello>) -> Result<Hello, BadInput> {
    let known = before.map(|hello| hello.boot_id);
    let mut complaints = Complaints::default();
    let until = Instant::now() + RESTARTED_WITHIN;
    let hello = link.messages(until, |message| match message {
        Message::Hello(hello) if known != Some(hello.boot_id) => Some(hello.clone()),
        other => {
            complaints.take(other);
            None
        }
    })?;
    hello.ok_or_else(|| {
        let seconds = RESTARTED_WITHIN.as_secs();
        let said = complaints.text().map(|text| format!("; it says: {text}")).unwrap_or_default();
        BadInput::whole(
            link.place(),
            format!("stored, but the box has not said in {seconds} s that it restarted{said}"),
            "switch it off and on; `plumb doctor` shows how it is",
        )
    })
}

/// Refuses a configuration with which a box would no longer be heard here: nobody could
/// correct it from here.
///
/// # Errors
/// When it sends elsewhere.
fn refuse_losing(link: &BoxLink, before: &Before, config: &Config) -> Result<(), BadInput> {
    match &before.config {
        Some(old) if !stays(link.kind(), &old.links, &config.links) => Err(BadInput::new(
            link.place(),
            "links",
            format!(
                "the box would no longer be heard here: {}",
                moves(&old.links, &config.links).join("; ")
            ),
            "correct the links in the box file; `plumb provision --send --force` sends it all the same",
        )),
        _ => Ok(()),
    }
}

/// Refuses a camera file of another size than the box's frames: the box would not start with it.
///
/// # Errors
/// When the sizes differ.
fn refuse_other_size(place: &str, hello: &Hello, config: &Config) -> Result<(), BadInput> {
    let [is, new] =
        [(hello.width_px, hello.height_px), (config.lens.width_px, config.lens.height_px)]
            .map(|(width, height)| format!("{width} x {height} px"));
    if is == new {
        return Ok(());
    }
    Err(BadInput::whole(
        place,
        format!("it is for frames of {new}, and the frames of this box are {is}"),
        "give the camera file of this box, or calibrate it with photographs of that size (`plumb \
         aim --stills` takes them); give --force if its camera is to give frames of another size",
    ))
}

/// Whether a box that is heard over a link of this kind will be heard there again.
fn stays(kind: LinkKind, old: &Links, new: &Links) -> bool {
    match kind {
        LinkKind::Serial => old.serial == new.serial,
        _ => old.udp == new.udp,
    }
}

/// What whoever sends the new configuration may not have meant.
fn warnings(old: &Config, new: &Config) -> Vec<String> {
    let mut warnings = moves(&old.links, &new.links);
    if old.cam_from_scene_theta.is_some() && new.cam_from_scene_theta.is_none() {
        warnings.push(
            "the box has a scene, and will have none: measure it again with `plumb scene \
             --store`, or give the one from before with --scene"
                .into(),
        );
    }
    let keeps_scene =
        new.cam_from_scene_theta.is_some() && old.cam_from_scene_theta == new.cam_from_scene_theta;
    if keeps_scene && old.lens != new.lens {
        warnings.push(
            "the box gets another camera and keeps its scene, which was measured with the camera \
             from before: measure it again with `plumb scene --store`"
                .into(),
        );
    }
    let size = |config: &Config| (config.lens.width_px, config.lens.height_px);
    if size(old) != size(new) {
        let ((width, height), (next_width, next_height)) = (size(old), size(new));
        warnings.push(format!(
            "the box's frames are {width} x {height} px, and will be {next_width} x \
             {next_height}: a camera file holds for the size of its photographs"
        ));
    }
    let fixed = |config: &Config| config.capture.as_ref().and_then(|capture| capture.exposure_us);
    if let (Some(exposure_us), None) = (fixed(old), fixed(new)) {
        warnings.push(format!(
            "the box exposes for {exposure_us} us, and will expose as the camera likes: fix it \
             again with `plumb aim --expose --store`, or give exposure_us in the box file"
        ));
    }
    warnings
}

/// What the box will send elsewhere than it does now.
fn moves(old: &Links, new: &Links) -> Vec<String> {
    let line = |line: &SerialLink| {
        let one_way = if line.one_way { ", one way" } else { "" };
        format!("{} at {} baud{one_way}", line.path, line.baud)
    };
    let udp = [old, new].map(|links| links.udp.map(|to| to.to_string()));
    let serial = [old, new].map(|links| links.serial.as_ref().map(line));
    [("UDP", udp), ("a serial line", serial)]
        .into_iter()
        .filter(|(_, [old, new])| old != new)
        .map(|(what, [old, new])| match (old, new) {
            (Some(old), Some(new)) => {
                format!("the box will send by {what} to {new}, and not to {old} as it is told now")
            }
            (Some(old), None) => {
                format!("the box will not send by {what} any more; it is told {old} now")
            }
            (_, new) => {
                format!("the box will send by {what} too, to {}", new.unwrap_or_default())
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_measured_and_would_be_lost_is_warned_of() {
        let mut old = plumbline_stream::fixture::config();
        assert_eq!(warnings(&old, &old), [""; 0]);
        let mut new = old.clone();
        new.cam_from_scene_theta = None;
        new.capture.as_mut().unwrap().exposure_us = None;
        let texts = warnings(&old, &new);
        let [scene, exposure] = &texts[..] else { panic!("{texts:?}") };
        assert!(scene.contains("plumb scene --store") && scene.contains("--scene"), "{scene}");
        assert!(exposure.contains("4000 us") && exposure.contains("--expose"), "{exposure}");
        old.cam_from_scene_theta = None;
        old.capture = None;
        assert_eq!(warnings(&old, &new), [""; 0]);
    }

    /// A scene file that a person has written does not say through which camera it was measured.
    #[test]
    fn a_scene_that_outlives_its_camera_is_warned_of() {
        let old = plumbline_stream::fixture::config();
        let mut new = old.clone();
        new.lens.fx_px += 1.0;
        let texts = warnings(&old, &new);
        let [scene] = &texts[..] else { panic!("{texts:?}") };
        assert!(scene.contains("another camera") && scene.contains("plumb scene --store"));
        // One that was measured anew is none.
        new.cam_from_scene_theta.as_mut().unwrap()[0] += 1e-9;
        assert_eq!(warnings(&old, &new), [""; 0]);
    }

    #[test]
    fn a_camera_of_another_size_than_the_frames_is_refused() {
        let config = plumbline_stream::fixture::config();
        let mut hello = plumbline_stream::fixture::hello(&config);
        assert_eq!(refuse_other_size("camera.toml", &hello, &config), Ok(()));
        hello.width_px = 640;
        let error = refuse_other_size("camera.toml", &hello, &config).unwrap_err().to_string();
        let (width, height) = (config.lens.width_px, config.lens.height_px);
        assert!(error.starts_with("camera.toml: it is for frames of "), "{error}");
        let sizes = [format!("of {width} x {height} px"), format!("are 640 x {height} px")];
        assert!(sizes.iter().all(|it| error.contains(it)) && error.contains("--force"), "{error}");
    }

    #[test]
    fn a_box_that_will_send_elsewhere_is_warned_of() {
        let links = |udp: Option<&str>, serial: Option<u32>| Links {
            udp: udp.map(|udp| udp.parse().unwrap()),
            serial: serial.map(|baud| {
                let path = "/dev/ttyS0".try_into().unwrap();
                SerialLink { path, baud, one_way: false }
            }),
        };
        let (here, there) = (Some("192.168.1.20:4210"), Some("192.168.1.21:4210"));
        assert_eq!(moves(&links(here, None), &links(here, None)), [""; 0]);
        for (old, new, said) in [
            (
                links(here, None),
                links(there, None),
                "by UDP to 192.168.1.21:4210, and not to 192.168.1.20:4210",
            ),
            (links(here, None), links(None, None), "not send by UDP any more"),
            (links(here, None), links(here, Some(9600)), "too, to /dev/ttyS0 at 9600 baud"),
            (
                links(here, Some(115_200)),
                links(here, Some(9600)),
                "to /dev/ttyS0 at 9600 baud, and not to /dev/ttyS0 at 115200 baud",
            ),
        ] {
            let warnings = moves(&old, &new);
            let [warning] = &warnings[..] else { panic!("{warnings:?}") };
            assert!(warning.contains(said), "{warning}");
        }
        let (old, new) = (links(here, Some(9600)), links(there, Some(9600)));
        assert!(!stays(LinkKind::Udp, &old, &new) && stays(LinkKind::Serial, &old, &new));
    }
}
