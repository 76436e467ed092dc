//! A box that is watched now, and what the user is told meanwhile.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use plumbline::packet::Message;
use plumbline_files::BadInput;
use plumbline_files::camera;
use plumbline_stream::link::BoxLink;

use super::source::Recording;
use crate::arguments::LinkArguments;
use crate::delivery;
use crate::setup;
use crate::ui::stop::stop_on_signals;
use crate::ui::waiting::Waiting;

/// Time from one piece of advice to the next.
const ADVICE_EVERY: Duration = Duration::from_secs(1);

/// What the user is to do while a box is watched.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Advice {
    /// This, said once until it changes.
    Do(String),
    /// Nothing more: the proof has all that it needs.
    Enough,
}

/// Watches a box for some time, until Ctrl-C or until it is enough.
///
/// # Errors
/// When no box is heard, its camera is not calibrated, or no frame comes.
pub fn watch(
    link: &LinkArguments,
    duration: Duration,
    advise: impl FnMut(&Recording) -> Advice,
) -> Result<Recording, BadInput> {
    let mut link = link.open()?;
    let hello = {
        let _waiting = Waiting::new(format!("listening at {}", link.place()));
        link.hello()?
    };
    eprintln!("{}: {}", link.place(), delivery::who(&hello));
    let config = link.config()?;
    if camera::is_stand_in(&config.lens) {
        return Err(setup::not_calibrated(link.place()));
    }
    let place = format!("{} ({})", hello.device, hello.serial_number);
    let mut recording = Recording::new(place, &config);
    listen(&mut link, &mut recording, duration, advise)?;
    if recording.frames == 0 {
        let remedy = "`plumb doctor` says how its camera is";
        return Err(BadInput::whole(&recording.place, "no frame came from the box", remedy));
    }
    Ok(recording)
}

fn listen(
    link: &mut BoxLink,
    recording: &mut Recording,
    duration: Duration,
    mut advise: impl FnMut(&Recording) -> Advice,
) -> Result<(), BadInput> {
    let stop = stop_on_signals()?;
    let until = Instant::now() + duration;
    let mut first_ns = None;
    let mut said = String::new();
    while Instant::now() < until && !stop.load(Ordering::Relaxed) {
        match advise(recording) {
            Advice::Enough => break,
            Advice::Do(words) if words != said => {
                let left_s = until.saturating_duration_since(Instant::now()).as_secs();
                eprintln!("{left_s:3} s left: {words}");
                said = words;
            }
            Advice::Do(_) => {}
        }
        link.messages(until.min(Instant::now() + ADVICE_EVERY), |message| -> Option<()> {
            if let Message::Pose(packet) = message {
                let first_ns = *first_ns.get_or_insert(packet.capture_time_ns);
                // A packet that was overtaken can be older than the first; it is left out.
                let since_ns = packet.capture_time_ns.checked_sub(first_ns)?;
                recording.take(1e-9 * since_ns as f64, packet);
            }
            None
        })?;
    }
    Ok(())
}
