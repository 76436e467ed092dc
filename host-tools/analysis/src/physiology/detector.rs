//! Finds recurring events, beats or pulses, as peaks of a signal's strength, by the rules of
//! Hamilton (2002), "Open source ECG analysis", Computers in Cardiology 29:101.
//!
//! Peaks close to a larger one are ignored. A peak is accepted when it exceeds a threshold between
//! the medians of the last eight accepted and the last eight rejected peaks. A peak that soon
//! follows an accepted one and is less than half as strong is its echo, a T wave or a dicrotic
//! wave, and counts as neither. When the next event is overdue, the strongest rejected peak is
//! accepted after all if it exceeds half the threshold.
//!
//! The levels are learned from eight seconds. If nothing has been found for eight seconds, they are
//! learned again from the last event found, so that a sudden fall of the amplitude loses nothing,
//! unless the first smaller beat comes so soon that it looks like an echo. Where the level does not
//! stand out from the rest, the signal is noise and there are no events.

use std::collections::VecDeque;
use std::ops::Range;

use crate::statistics::describe::median;

/// The number of recent peaks that determine a level.
const RECENT: usize = 8;

/// The time from which levels are learned, and after which, without an event, they are learned
/// again.
const LEARN_S: f64 = 8.0;

/// Each part used for learning has at least one beat, at 30 per minute or more.
const LEARN_PART_S: f64 = 2.0;

/// An echo has less than this fraction of the strength of the event it follows.
const ECHO: f64 = 0.5;

/// The next event is overdue after this many usual intervals.
const OVERDUE: f64 = 1.5;

/// The properties of the events to be found.
pub(super) struct Rules {
    /// The least time between two events.
    pub apart_s: f64,
    /// The longest time by which an echo follows its event.
    pub echo_s: f64,
    /// The threshold, from the level of the rejected peaks (0) to that of the accepted ones (1).
    pub threshold: f64,
    /// The least ratio of the accepted level to the first quartile of the strength.
    pub contrast: f64,
}

/// The sample indices of the events, given a strength that is not negative.
pub(super) fn detect(strength: &[f64], rate_hz: f64, rules: &Rules) -> Vec<usize> {
    let samples = |duration_s: f64| (duration_s * rate_hz).round() as usize;
    let learn = samples(LEARN_S);
    let peaks = peaks(strength, samples(rules.apart_s));
    let (mut found, mut start) = (Vec::new(), 0);
    while start < strength.len() {
        let span = start..strength.len().min(start + learn);
        let before = found.len();
        if let Some(level) = level(strength, span, samples(LEARN_PART_S), rules.contrast) {
            let next = peaks.partition_point(|at| *at < start);
            let counted = [level].into();
            Scan { strength, rules, rate_hz, counted, others: VecDeque::new() }.run(
                &peaks[next..],
                start,
                &mut found,
            );
        }
        start = match found.last() {
            // The rest is too short to learn from: a T wave may be its largest peak.
            Some(last) if strength.len() - last <= learn => break,
            Some(last) if found.len() > before => last + samples(rules.apart_s),
            _ => start + learn,
        };
    }
    found
}

/// The local maxima, except those with a larger one closer than this.
fn peaks(strength: &[f64], apart: usize) -> Vec<usize> {
    let mut peaks: Vec<usize> = Vec::new();
    for at in 1..strength.len().saturating_sub(1) {
        if strength[at] <= strength[at - 1] || strength[at] < strength[at + 1] {
            continue;
        }
        match peaks.last_mut().filter(|last| at - **last < apart) {
            Some(last) if strength[at] > strength[*last] => *last = at,
            Some(_) => {}
            None => peaks.push(at),
        }
    }
    peaks
}

/// The median of the largest strengths of the parts, if it stands out.
fn level(strength: &[f64], span: Range<usize>, part: usize, contrast: f64) -> Option<f64> {
    let strength = &strength[span];
    let largest = strength.chunks(part).map(|part| part.iter().copied().fold(0.0, f64::max));
    let level = median(largest)?;
    let mut sorted = strength.to_vec();
    let quarter = sorted.len() / 4;
    let (_, quiet, _) = sorted.select_nth_unstable_by(quarter, f64::total_cmp);
    (level > contrast * *quiet).then_some(level)
}

/// A scan over peaks, with levels that adapt to them.
struct Scan<'a> {
    strength: &'a [f64],
    rules: &'a Rules,
    rate_hz: f64,
    counted: VecDeque<f64>,
    others: VecDeque<f64>,
}

impl Scan<'_> {
    /// Runs until nothing has been found for [`LEARN_S`].
    fn run(&mut self, peaks: &[usize], start: usize, found: &mut Vec<usize>) {
        let mut intervals = VecDeque::new();
        // The event from which the levels are learned again: its echo is still to come.
        let mut last = found.last().copied().filter(|last| start - last <= self.apart());
        // The first peak after the last event.
        let mut since = 0;
        let mut at = 0;
        while at < peaks.len() {
            let peak = peaks[at];
            let waited_s = (peak - last.unwrap_or(start)) as f64 / self.rate_hz;
            let overdue =
                median(intervals.iter().copied()).is_some_and(|it| waited_s > OVERDUE * it);
            let next = if overdue && let Some(missed) = self.missed(&peaks[since..at], last) {
                since + missed
            } else if waited_s > LEARN_S {
                return;
            } else if self.counts(peak, last) {
                at
            } else {
                // An echo belongs to the event before it and says nothing about the next.
                if !self.is_echo(peak, last) {
                    push(&mut self.others, self.strength[peak]);
                }
                at += 1;
                continue;
            };
            let peak = peaks[next];
            push(&mut self.counted, self.strength[peak]);
            if let Some(last) = last.replace(peak) {
                push(&mut intervals, (peak - last) as f64 / self.rate_hz);
            }
            found.push(peak);
            since = next + 1;
            at = since;
        }
    }

    fn apart(&self) -> usize {
        (self.rules.apart_s * self.rate_hz).round() as usize
    }

    fn threshold(&self) -> f64 {
        let [counted, others] =
            [&self.counted, &self.others].map(|it| median(it.iter().copied()).unwrap_or(0.0));
        others + self.rules.threshold * (counted - others).max(0.0)
    }

    fn counts(&self, peak: usize, last: Option<usize>) -> bool {
        self.strength[peak] > self.threshold() && !self.is_echo(peak, last)
    }

    fn is_echo(&self, peak: usize, last: Option<usize>) -> bool {
        last.is_some_and(|last| {
            ((peak - last) as f64) < self.rules.echo_s * self.rate_hz
                && self.strength[peak] < ECHO * self.strength[last]
        })
    }

    /// The strongest rejected peak, if it exceeds half the threshold.
    fn missed(&self, peaks: &[usize], last: Option<usize>) -> Option<usize> {
        let strength = |at: usize| self.strength[peaks[at]];
        let candidates = (0..peaks.len()).filter(|&at| !self.is_echo(peaks[at], last));
        candidates
            .max_by(|&left, &right| strength(left).total_cmp(&strength(right)))
            .filter(|&at| strength(at) > 0.5 * self.threshold())
    }
}

fn push(recent: &mut VecDeque<f64>, value: f64) {
    if recent.len() == RECENT {
        recent.pop_front();
    }
    recent.push_back(value);
}
