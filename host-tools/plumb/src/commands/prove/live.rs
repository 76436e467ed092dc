//! A box that is watched now, and what the user is told meanwhile.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use plumbline::packet::{Message, PosePacket};
use plumbline_files::BadInput;
use plumbline_files::camera;
use plumbline_stream::accounting::{Accounting, Arrival};
use plumbline_stream::link::BoxLink;
use plumbline_stream::recorder::SessionClock;

use super::source::Recording;
use crate::arguments::LinkArguments;
use crate::delivery;
use crate::setup;
use crate::ui::stop::stop_on_signals;

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
    let hello = delivery::greet(&mut link)?;
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
    let mut arrivals = Arrivals::default();
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
        link.messages(until.min(Instant::now() + ADVICE_EVERY), |message| -> Option<()> {
            if let Message::Pose(packet) = message {
                heard_at = Instant::now();
                let arrival_ns = begun.elapsed().as_nanos() as u64;
                if let Some(time_s) = arrivals.time_s(packet, arrival_ns) {
                    recording.take(time_s, packet);
                }
            }
            None
        })?;
    }
    Ok(())
}

/// Which packets are new, and when their frames were taken.
#[derive(Default)]
struct Arrivals {
    accounting: Accounting,
    clock: SessionClock,
}

impl Arrivals {
    /// When the frame was taken, since the first of all. `None` for a packet that came before or
    /// was overtaken: it would be out of order.
    fn time_s(&mut self, packet: &PosePacket, arrival_ns: u64) -> Option<f64> {
        match self.accounting.pose(packet.sequence, packet.capture_time_ns) {
            Arrival::Repeated | Arrival::Late => return None,
            Arrival::NewSession => {
                self.clock.start_session(packet.capture_time_ns, arrival_ns);
            }
            Arrival::New { .. } => {}
        }
        Some(self.clock.time_s(packet.capture_time_ns))
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::MarkedInstant;

    use super::*;

    /// By number, capture time in frames and arrival in seconds.
    #[test]
    fn each_frame_is_taken_once_in_order_and_after_a_restart_of_the_box_too() {
        const FRAME_NS: u64 = 100_000_000;
        let mut arrivals = Arrivals::default();
        let mut time_s = |sequence: u32, frames: u64, arrival_s: u64| {
            let packet = PosePacket {
                sequence,
                capture_time_ns: frames * FRAME_NS,
                instant: MarkedInstant::Recording,
                latency_us: 0,
                targets: [].into_iter().collect(),
                upper_trunk: None,
                lower_trunk: None,
            };
            arrivals.time_s(&packet, 1_000_000_000 * arrival_s)
        };
        assert_eq!(time_s(7, 100, 3), Some(0.0));
        assert_eq!(time_s(9, 102, 3), Some(0.2));
        assert_eq!((time_s(9, 102, 3), time_s(8, 101, 3)), (None, None));
        // Restarted: its clock begins anew.
        assert_eq!((time_s(0, 1, 13), time_s(1, 2, 13)), (Some(10.0), Some(10.1)));
    }
}
