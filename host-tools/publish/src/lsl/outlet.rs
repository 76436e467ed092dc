//! The streams that are offered to programs of the Lab Streaming Layer:
//!
//! | stream | type | samples |
//! |---|---|---|
//! | NAME | MoCap | one for each frame of the camera, in order: a frame that has not come is NaN |
//! | NAME-late | MoCap | the same channels: frames that came after all, when they come |
//! | NAME-marks | Markers | the marks of the recording |
//!
//! The rate is stated as irregular: each sample has its own measured time, which consumers must
//! neither replace by a fitted one nor deduce from a rate. Times within a stream never go back,
//! which consumers rely on: where the relation of the clocks is corrected by more than a frame's
//! period, a time waits for that. So a late frame cannot take its place, and has a stream of its own: its
//! number says where it belongs. The time of a sample is that of its frame; the channels `delay`
//! say how much later each target was exposed.
//!
//! Between two sessions there is one sample of NaN, because nobody knows how many frames were missed.

use std::sync::mpsc::Receiver;
use std::thread;
use std::time::{Duration, Instant};

use plumbline_files::counting::counted;

use super::LslClock;
use super::description::{self, CHANNELS};
use super::library::{Lsl, Outlet, StreamInfo};
use crate::item::{Gap, Item, Sample, Stream};

/// What the name of the stream of late frames ends with.
pub const LATE_SUFFIX: &str = "-late";

/// What the name of the stream of marks ends with.
pub const MARKS_SUFFIX: &str = "-marks";

/// What is kept for a consumer that is slow, in hundreds of samples: of ten minutes at 60 Hz.
const KEPT_HUNDREDS: i32 = 360;

/// A longer gap is not filled wholly: this many samples at its beginning, of more than a minute.
const FILLED_MAX: u32 = 7_200;

/// A sample is later than the one before by this, at least.
const STEP_S: f64 = 1e-6;

/// At the end, the last samples are under way for no longer than this.
const LAST_SENT_WITHIN: Duration = Duration::from_millis(500);

/// Publishes until nothing more comes; what came of it, in words.
pub(crate) fn run(library: Lsl, name: &str, begun: Instant, items: Receiver<Item>) -> Vec<String> {
    let mut outlets = Outlets {
        library,
        name,
        begun,
        clock: LslClock::new(library),
        open: None,
        border: None,
        samples: 0,
        failed: false,
    };
    items.into_iter().for_each(|item| outlets.take(&item));
    outlets.end()
}

struct Outlets<'a> {
    library: Lsl,
    name: &'a str,
    begun: Instant,
    clock: LslClock,
    open: Option<Open>,
    /// The time of the last frame of the session before, until the next one's first.
    border: Option<f64>,
    samples: u64,
    failed: bool,
}

struct Open {
    of: Stream,
    frames: Outlet,
    late: Outlet,
    marks: Outlet,
    last_ns: Option<f64>,
    /// The time of the last sample.
    last_s: f64,
}

impl Open {
    fn push(&mut self, values: &[f64], at_s: f64) {
        self.last_s = at_s.max(self.last_s + STEP_S);
        self.frames.push(values, self.last_s);
    }
}

impl Outlets<'_> {
    fn take(&mut self, item: &Item) {
        self.clock.keep();
        match item {
            Item::Stream(stream) => self.describe(stream),
            Item::Frame(sample) => self.frame(sample),
            Item::Gap(gap) => self.gap(gap),
            Item::Mark(mark) => {
                let at_s = self.lsl_s(mark.host_ns);
                if let Some(open) = &self.open {
                    open.marks.push_text(&mark.label, at_s);
                }
            }
            Item::Notice(_) => {}
        }
    }

    /// A box is offered as long as it is the same in the same configuration; its restarts are in the
    /// channel `session`.
    fn describe(&mut self, stream: &Stream) {
        self.border = self.open.as_ref().and_then(|open| open.last_ns);
        let identity = |it: &Stream| {
            let hello = &it.hello;
            (hello.serial_number.clone(), hello.firmware.clone(), hello.config_crc, it.instant)
        };
        if self.open.as_ref().is_some_and(|open| identity(&open.of) == identity(stream)) {
            return;
        }
        self.open = None;
        self.border = None;
        let serial = &stream.hello.serial_number;
        let outlet = |suffix: &str, content_type, channels, desc: &[_]| {
            let info = StreamInfo {
                name: &format!("{}{suffix}", self.name),
                content_type,
                source_id: &format!("plumbline:{serial}:{}{suffix}", self.name),
                channels,
                desc,
            };
            Outlet::new(self.library, &info, KEPT_HUNDREDS)
        };
        let (frames, marks) = (description::of_frames(stream), description::of_marks());
        self.open = (|| {
            Some(Open {
                of: stream.clone(),
                frames: outlet("", "MoCap", Some(CHANNELS), &frames)?,
                late: outlet(LATE_SUFFIX, "MoCap", Some(CHANNELS), &frames)?,
                marks: outlet(MARKS_SUFFIX, "Markers", None, &marks)?,
                last_ns: None,
                last_s: f64::NEG_INFINITY,
            })
        })();
        self.failed |= self.open.is_none();
    }

    fn frame(&mut self, sample: &Sample) {
        let at_s = self.lsl_s(sample.host_ns);
        let border_s = self.border.map(|last_ns| self.lsl_s(0.5 * (last_ns + sample.host_ns)));
        let Some(open) = &mut self.open else { return };
        if sample.is_late {
            open.late.push(&description::values(sample), at_s);
            return;
        }
        if let Some(border_s) = border_s {
            self.border = None;
            open.push(&description::nothing(sample.session, None), border_s);
        }
        open.push(&description::values(sample), at_s);
        open.last_ns = Some(sample.host_ns);
        self.samples += 1;
    }

    fn gap(&mut self, gap: &Gap) {
        let zero_s = self.lsl_s(0.0);
        let Some(open) = &mut self.open else { return };
        for index in 0..gap.count.min(FILLED_MAX) {
            let at_s = zero_s + 1e-9 * gap.host_ns(index);
            open.push(&description::missing(gap, index), at_s);
        }
    }

    fn lsl_s(&self, host_ns: f64) -> f64 {
        self.clock.lsl_s(self.begun) + 1e-9 * host_ns
    }

    fn end(self) -> Vec<String> {
        if let Some(Open { frames, late, marks, .. }) = &self.open
            && [frames, late, marks].into_iter().any(Outlet::has_consumers)
        {
            thread::sleep(LAST_SENT_WITHIN);
        }
        let mut said = vec![format!(
            "Lab Streaming Layer, stream {}: {}",
            self.name,
            counted(self.samples, "frame")
        )];
        if self.failed {
            said.push(
                "warning: Lab Streaming Layer: a stream could not be offered: its ports (16571 and \
                 following) may be taken or forbidden"
                    .to_owned(),
            );
        }
        said
    }
}
