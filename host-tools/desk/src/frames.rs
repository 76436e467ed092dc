//! The frames of a box, for pages: the latest ones, and where each page is in them.
//!
//! In: what the box's [`Publisher`](plumbline_publish::Publisher) gives, whose times are of this
//! computer's clock. Out: [`FrameRow`]s with numbers that rise by one. A page asks for those after the
//! one it has; what is no longer kept is counted as dropped for that page. So a slow page costs nothing
//! but its own frames. Every frame, drawn or not, is in the [`Figures`] so far.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError, mpsc};
use std::time::Instant;

use nalgebra::Matrix3;
use plumbline_bedside::recording::{Figures, NotYet, TrunkFigures};
use plumbline_publish::item::{Item, Sample};
use plumbline_trial::body::{self, Body};
use plumbline_trial::frame::{Point, Trunk};

use crate::hub::Hub;
use crate::wire::{BATCH_FRAMES_MAX, FrameRow, HISTORY_FRAMES, PointRow};

/// The latest frames of a box.
#[derive(Debug, Default)]
pub struct Frames {
    kept: Mutex<Kept>,
}

#[derive(Debug, Default)]
struct Kept {
    rows: VecDeque<FrameRow>,
    /// The number of the next frame, from 1, minus 1.
    newest: u64,
    gap: u32,
    /// What relates targets to the body.
    body: Option<Body>,
    /// Path, RMS, noise and gaps so far.
    figures: Figures,
    /// The time of the latest frame, as the figures have it.
    latest_s: f64,
    /// The largest error of the latest frame's time, milliseconds.
    clock_error_ms: Option<f64>,
}

impl Frames {
    fn lock(&self) -> MutexGuard<'_, Kept> {
        // A row is whole or not there.
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// From now on points have their covariance by this.
    pub fn set_body(&self, body: Option<Body>) {
        self.lock().body = body;
    }

    /// The figures count from now on.
    pub fn start_figures(&self) {
        let mut kept = self.lock();
        let latest_s = kept.latest_s;
        kept.figures.start_over(latest_s);
    }

    /// The figures of a trunk so far.
    ///
    /// # Errors
    /// Why there are none.
    pub fn figures(&self, trunk: Trunk) -> Result<TrunkFigures, NotYet> {
        self.lock().figures.so_far(trunk)
    }

    /// The number of the newest frame; 0: there is none.
    #[must_use]
    pub fn newest(&self) -> u64 {
        self.lock().newest
    }

    /// The largest error of the latest frame's time, milliseconds.
    #[must_use]
    pub fn clock_error_ms(&self) -> Option<f64> {
        self.lock().clock_error_ms
    }

    /// The frames after this number, at most [`BATCH_FRAMES_MAX`], and how many before them are no
    /// longer kept.
    #[must_use]
    pub fn after(&self, number: u64) -> (Vec<FrameRow>, u64) {
        let kept = self.lock();
        let first = kept.newest + 1 - kept.rows.len() as u64;
        // A page of an earlier desk may have a number that is still to come.
        let wanted = if number > kept.newest { first } else { number + 1 };
        let from = wanted.max(first);
        let skip = (from - first) as usize;
        let rows = kept.rows.iter().skip(skip).take(BATCH_FRAMES_MAX).cloned().collect();
        (rows, from - wanted)
    }

    fn push(&self, at_ms: f64, sample: &Sample) {
        let mut kept = self.lock();
        let body = kept.body;
        let [upper, lower] = [Trunk::Upper, Trunk::Lower]
            .map(|trunk| body::point(&sample.packet, trunk, body.as_ref(), time_s));
        if !sample.is_late {
            kept.figures.take(sample.session, upper.as_ref(), lower.as_ref());
            kept.latest_s = time_s(sample.packet.capture_time_ns);
        }
        if kept.rows.len() == HISTORY_FRAMES {
            kept.rows.pop_front();
        }
        kept.newest += 1;
        kept.clock_error_ms = Some(1e3 * sample.error_s);
        let gap = if sample.is_late { 0 } else { std::mem::take(&mut kept.gap) };
        let row = FrameRow {
            number: kept.newest,
            at_ms: (1e3 * at_ms).round() / 1e3,
            upper: upper.as_ref().map(row),
            lower: lower.as_ref().map(row),
            gap,
            is_late: sample.is_late,
        };
        kept.rows.push_back(row);
    }

    /// Takes what is published until nothing more comes; `begun` is the publisher's zero.
    pub fn follow(&self, items: &mpsc::Receiver<Item>, hub: &Hub, begun: Instant) -> Vec<String> {
        let zero_ms = hub.ms(begun);
        while let Ok(item) = items.recv() {
            match item {
                Item::Frame(sample) => self.push(zero_ms + 1e-6 * sample.host_ns, &sample),
                Item::Gap(gap) => {
                    let mut kept = self.lock();
                    kept.gap = kept.gap.saturating_add(gap.count);
                }
                Item::Stream(_) | Item::Mark(_) | Item::Notice(_) => {}
            }
        }
        Vec::new()
    }
}

fn time_s(capture_ns: u64) -> f64 {
    1e-9 * capture_ns as f64
}

/// A trunk's point as pages get it: to a micrometre, its covariance in the transverse plane.
fn row(point: &Point) -> PointRow {
    let rounded = |value: f64, steps: f64| (steps * value).round() / steps;
    let plane = |it: Matrix3<f64>| [it[(0, 0)], it[(0, 1)], it[(1, 1)]].map(|it| rounded(it, 1e6));
    PointRow {
        p: point.position_mm.map(|it| rounded(it, 1e3)),
        c: point.covariance_mm2.map_or([0.0; 3], plane),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(newest: u64, kept: u64) -> Frames {
        let frames = Frames::default();
        let mut inner = frames.lock();
        inner.newest = newest;
        for number in newest + 1 - kept..=newest {
            inner.rows.push_back(FrameRow {
                number,
                at_ms: 0.0,
                upper: None,
                lower: None,
                gap: 0,
                is_late: false,
            });
        }
        drop(inner);
        frames
    }

    fn numbers(frames: &Frames, after: u64) -> (Option<u64>, usize, u64) {
        let (rows, dropped) = frames.after(after);
        (rows.first().map(|row| row.number), rows.len(), dropped)
    }

    #[test]
    fn a_page_gets_what_it_has_missed_and_hears_what_is_gone() {
        let frames = with(100, 10);
        assert_eq!(numbers(&frames, 100), (None, 0, 0));
        assert_eq!(numbers(&frames, 97), (Some(98), 3, 0));
        assert_eq!(numbers(&frames, 90), (Some(91), 10, 0));
        assert_eq!(numbers(&frames, 0), (Some(91), 10, 90));
        // Of a desk that was ended: everything is new.
        assert_eq!(numbers(&frames, 5000), (Some(91), 10, 0));
        assert_eq!(numbers(&Frames::default(), 0), (None, 0, 0));
    }

    #[test]
    fn a_batch_is_bounded() {
        let frames = with(HISTORY_FRAMES as u64, HISTORY_FRAMES as u64);
        assert_eq!(numbers(&frames, 0), (Some(1), BATCH_FRAMES_MAX, 0));
    }
}
