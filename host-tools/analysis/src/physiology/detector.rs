//! Finds what recurs, beats or pulses, in a strength that is high where one may be: the rules of
//! Hamilton (2002), "Open source ECG analysis", Computers in Cardiology 29:101.
//!
//! Peaks of the strength near a larger one are not looked at. A peak counts when it is above a
//! threshold between the medians of the last eight that counted and the last eight that did not.
//! One soon after another that is less than half as strong is its echo, a T wave or a dicrotic
//! wave, and counts nowhere. When the next is overdue, the strongest that did not count does if
//! it is above half the threshold.
//!
//! Levels are learned from eight seconds, and anew from where the last was found when none has
//! been for eight seconds, so that a sudden fall of the amplitude loses nothing, unless the first
//! smaller beat comes so soon that it looks like an echo. Where the level does not stand out from
//! the rest there are no beats, but noise.

use std::collections::VecDeque;
use std::ops::Range;

use crate::statistics::describe::median;

/// How many of the last count towards a level.
const RECENT: usize = 8;

/// Levels are learned from so much, and anew after as much without anything.
const LEARN_S: f64 = 8.0;

/// Each part that is learned from has at least one beat, at 30 per minute or more.
const LEARN_PART_S: f64 = 2.0;

/// An echo has less than this part of the strength.
const ECHO: f64 = 0.5;

/// One is overdue after this many usual intervals.
const OVERDUE: f64 = 1.5;

/// What recurs.
pub(super) struct Rules {
    /// None follows another sooner.
    pub apart_s: f64,
    /// An echo comes up to so much later.
    pub echo_s: f64,
    /// Where the threshold is, from the level of the others (0) to that of the counted (1).
    pub threshold: f64,
    /// The counted stand out from the quiet quarter of the time by this factor at least.
    pub contrast: f64,
}

/// Where they are, in samples of a strength that is not negative.
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
            // What is left is too short to learn from: a T wave may be the largest in it.
            Some(last) if strength.len() - last <= learn => break,
            Some(last) if found.len() > before => last + samples(rules.apart_s),
            _ => start + learn,
        };
    }
    found
}

/// The local maxima, but for those with a larger one nearer than this.
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

/// The median of the parts' largest strengths, when it stands out.
fn level(strength: &[f64], span: Range<usize>, part: usize, contrast: f64) -> Option<f64> {
    let strength = &strength[span];
    let largest = strength.chunks(part).map(|part| part.iter().copied().fold(0.0, f64::max));
    let level = median(largest)?;
    let mut sorted = strength.to_vec();
    let quarter = sorted.len() / 4;
    let (_, quiet, _) = sorted.select_nth_unstable_by(quarter, f64::total_cmp);
    (level > contrast * *quiet).then_some(level)
}

/// The passage over peaks with levels that follow them.
struct Scan<'a> {
    strength: &'a [f64],
    rules: &'a Rules,
    rate_hz: f64,
    counted: VecDeque<f64>,
    others: VecDeque<f64>,
}

impl Scan<'_> {
    /// Until none has been found for as long as [`LEARN_S`].
    fn run(&mut self, peaks: &[usize], start: usize, found: &mut Vec<usize>) {
        let mut intervals = VecDeque::new();
        // The one that the levels are learned anew from: its echo is still to come.
        let mut last = found.last().copied().filter(|last| start - last <= self.apart());
        // The first peak that came after the last found.
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
                // An echo follows what it is of, and says nothing about the next.
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

    /// The strongest of those that did not count, if it is above half the threshold.
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
