//! A box that is watched now, and what the user is told meanwhile.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use plumbline::packet::PosePacket;
use plumbline_bedside::delivery;
use plumbline_bedside::setup;
use plumbline_files::BadInput;
use plumbline_files::camera;
use plumbline_stream::link::BoxLink;
use plumbline_stream::sessions::{Judged, Sessions};
use plumbline_stream::transport::Event;

use super::recording::Recording;
use crate::arguments::LinkArguments;
use crate::ui::stop::stop_on_signals;
use crate::ui::waiting;

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

/// A box that sends nothing for longer is not well: a camera has ten frames a second or more.
const SILENCE_MAX: Duration = Duration::from_secs(3);

const SILENT: &str =
    "no frame comes from the box: check its power, its cable and its camera with `plumb doctor`";

/// Watches a box for some time, until Ctrl-C or until it is enough.
///
/// # Errors
/// When no box is heard, its camera is not calibrated, no frame comes, or `advise` says that nothing
/// can come of it.
pub fn watch(
    link: &LinkArguments,
    duration: Duration,
    advise: impl FnMut(&Recording) -> Result<Advice, BadInput>,
) -> Result<Recording, BadInput> {
    let mut link = link.open()?;
    let hello = delivery::greet(&mut link, &mut waiting::shown())?;
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
    mut advise: impl FnMut(&Recording) -> Result<Advice, BadInput>,
) -> Result<(), BadInput> {
    let stop = stop_on_signals()?;
    let begun = Instant::now();
    let until = begun + duration;
    let mut sessions = Sessions::default();
    let (mut said, mut heard_at) = (String::new(), begun);
    while Instant::now() < until && !stop.load(Ordering::Relaxed) {
        let words = match advise(recording)? {
            Advice::Enough => {
                eprintln!("that is enough");
                break;
            }
            Advice::Do(_) if heard_at.elapsed() > SILENCE_MAX => SILENT.to_owned(),
            Advice::Do(words) => words,
        };
        if words != said {
            let left_s = until.saturating_duration_since(Instant::now()).as_secs_f64().round();
            eprintln!("{left_s:3} s left: {words}");
            said = words;
        }
        link.listen(until.min(Instant::now() + ADVICE_EVERY), |event| -> Option<()> {
            if let Event::Packet(packet) = event {
                sessions.take(packet.clone(), begun.elapsed().as_nanos() as u64);
            }
            for (time_s, packet) in in_order(&mut sessions) {
                heard_at = Instant::now();
                recording.take(time_s, &packet);
            }
            None
        })?;
    }
    Ok(())
}

/// The frames that have come, and when each was taken, since the first of all. One that was
/// overtaken is left out: it would be out of order.
fn in_order(sessions: &mut Sessions) -> impl Iterator<Item = (f64, PosePacket)> {
    std::iter::from_fn(|| sessions.next_judged()).filter_map(|judged| match judged {
        Judged::Frame(frame) if !frame.is_late => {
            Some((frame.clock.time_s(frame.packet.capture_time_ns), frame.packet))
        }
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use plumbline::packet::Packet;
    use plumbline_stream::fixture::adversity::{frame_of, hello_of};

    use super::*;

    #[test]
    fn each_frame_is_taken_once_in_order_and_after_a_restart_of_the_box_too() {
        let mut sessions = Sessions::default();
        let mut come = |packets: &[Packet], arrival_s: u64| -> Vec<f64> {
            for packet in packets {
                sessions.take(packet.clone(), 1_000_000_000 * arrival_s);
            }
            in_order(&mut sessions).map(|(time_s, _)| time_s).collect()
        };
        let frame = |start: u32, number: u32| frame_of(start, number, 10);
        assert_eq!(come(&[hello_of("ward 3", 1), frame(1, 7), frame(1, 9)], 3), [0.0, 0.2]);
        assert_eq!(come(&[frame(1, 9), frame(1, 8)], 3), [0.0; 0]);
        // Restarted: its clock begins anew.
        assert_eq!(come(&[hello_of("ward 3", 2), frame(2, 0), frame(2, 1)], 13), [10.0, 10.1]);
    }
}
