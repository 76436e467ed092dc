//! What is known of a recording while it goes on: the times, the judgement, the movement, the
//! counts. Plain values and words, for a terminal or a page.

use std::io::Write;
use std::time::{Duration, Instant};

use plumbline::packet::PosePacket;
use plumbline_files::counting::counted;
use plumbline_stream::receiver::Receiver;
use plumbline_trial::body;
use plumbline_trial::frame::Trunk;
use plumbline_trial::verdict::Criteria;

use super::course::Course;
use super::figures::{Figures, NotYet, TrunkFigures};
use super::judgement::{self, Judgement, Silence};
use super::silence::silence;
use super::sway::{Movement, Sway};

/// Frames that wait for the configuration: those of two seconds at 200 Hz.
const EARLY_MAX: usize = 400;

/// One moment of a reception.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// What the recording is worth so far.
    pub judgement: Judgement,
    /// Since t = 0; until it comes, since the start.
    pub elapsed: Duration,
    /// Until the end, where it is known.
    pub remaining: Option<Duration>,
    /// The times in words.
    pub time: String,
    /// Empty without a pose, and where movement is not followed.
    pub movement: Vec<Movement>,
    /// From where movement counts.
    pub since: &'static str,
    /// Rate, losses and so on, the most important first.
    pub counts: Vec<String>,
    /// The figures of the upper trunk and of the lower one, or why there are none yet; empty where
    /// movement is not followed.
    pub figures: Vec<(&'static str, Result<TrunkFigures, NotYet>)>,
}

/// Follows a reception.
#[derive(Debug)]
pub struct Live {
    /// By what the trial is judged; absent where nothing is recorded.
    criteria: Option<Criteria>,
    begun: Instant,
    motion: Option<Motion>,
}

/// Follows the trunks.
#[derive(Debug)]
struct Motion {
    sway: Sway,
    figures: Figures,
    /// The frames that came before the box's configuration, which tells their covariances; `None`
    /// once it has come, or does not.
    early: Option<Vec<(u32, PosePacket)>>,
    /// The t = 0 from which movement counts.
    zero: Option<Instant>,
}

impl Live {
    /// Follows a reception that begins now. By the criteria the trial is judged; without them
    /// nothing is recorded.
    #[must_use]
    pub fn new(criteria: Option<Criteria>, begun: Instant) -> Self {
        // Where nothing is recorded, nobody asks for it.
        let early = criteria.is_some().then(Vec::new);
        let motion = Motion { sway: Sway::new(), figures: Figures::default(), early, zero: None };
        Self { motion: Some(motion), ..Self::without_motion(criteria, begun) }
    }

    /// The same for whoever has movement and figures from elsewhere.
    #[must_use]
    pub fn without_motion(criteria: Option<Criteria>, begun: Instant) -> Self {
        Self { criteria, begun, motion: None }
    }

    /// Takes note of the latest frame. To be called after each packet.
    pub fn take<W: Write>(&mut self, receiver: &Receiver<W>, course: &Course, now: Instant) {
        if let Some(motion) = &mut self.motion {
            motion.take(receiver, course, now);
        }
    }

    /// What is known at this moment.
    #[must_use]
    pub fn seen<W: Write>(&self, receiver: &Receiver<W>, course: &Course, now: Instant) -> Seen {
        let motion = self.motion.as_ref();
        let movement =
            motion.zip(receiver.latest(now)).map(|(motion, latest)| motion.sway.movement(latest));
        let figures = motion.map(|motion| {
            [Trunk::Upper, Trunk::Lower]
                .map(|trunk| (trunk.word(), motion.figures.so_far(trunk)))
                .to_vec()
        });
        Seen {
            judgement: self.judgement(receiver, course, now),
            elapsed: course.elapsed(now).0,
            remaining: course
                .remaining(now)
                .map(|(to_go, _)| to_go)
                .filter(|_| !course.awaits_mark()),
            time: time(course, now),
            movement: movement.unwrap_or_default(),
            since: course.movement_since(),
            counts: counts(receiver, course, now),
            figures: figures.unwrap_or_default(),
        }
    }

    fn judgement<W: Write>(
        &self,
        receiver: &Receiver<W>,
        course: &Course,
        now: Instant,
    ) -> Judgement {
        let lasts = receiver.silence(now);
        let silence = receiver.latest(now).is_none().then(|| Silence {
            lasts: lasts.unwrap_or(now.saturating_duration_since(self.begun)),
            had_pose: lasts.is_some(),
            words: silence(receiver, now),
        });
        match &self.criteria {
            Some(criteria) => judgement::of_recording(criteria, course.verdict(), silence),
            None => judgement::of_nothing(silence),
        }
    }
}

impl Motion {
    fn take<W: Write>(&mut self, receiver: &Receiver<W>, course: &Course, now: Instant) {
        let latest = receiver.latest(now);
        if std::mem::replace(&mut self.zero, course.zero()) != course.zero() {
            self.sway.start_over();
            if let (Some(zero), Some(latest)) = (course.zero(), latest) {
                let since = now.saturating_duration_since(zero).as_secs_f64();
                self.figures.start_over(time_s(latest.capture_time_ns) - since);
            }
        }
        if let Some(latest) = latest {
            self.sway.take(latest, !course.awaits_mark());
            match &mut self.early {
                Some(early) if course.body().is_none() && early.len() < EARLY_MAX => {
                    let is_new = early.last().is_none_or(|(_, last)| last != latest);
                    if is_new {
                        early.push((receiver.sessions(), latest.clone()));
                    }
                }
                early => {
                    for (session, packet) in early.take().into_iter().flatten() {
                        take_figures(&mut self.figures, session, &packet, course);
                    }
                    take_figures(&mut self.figures, receiver.sessions(), latest, course);
                }
            }
        }
    }
}

fn take_figures(figures: &mut Figures, session: u32, packet: &PosePacket, course: &Course) {
    let [upper, lower] =
        [Trunk::Upper, Trunk::Lower].map(|trunk| body::point(packet, trunk, course.body(), time_s));
    figures.take(session, upper.as_ref(), lower.as_ref());
}

fn time_s(capture_ns: u64) -> f64 {
    1e-9 * capture_ns as f64
}

/// How far the recording has come.
fn time(course: &Course, now: Instant) -> String {
    let (elapsed, since) = course.elapsed(now);
    let mut words = vec![format!("{:.0} s {since}", elapsed.as_secs_f64())];
    words.extend(
        course.remaining(now).map(|(to_go, until)| format!("{} s {until}", to_go.as_secs())),
    );
    words.extend(course.note().map(str::to_owned));
    words.join(", ")
}

/// Rate, losses and so on, the most important first.
fn counts<W: Write>(receiver: &Receiver<W>, course: &Course, now: Instant) -> Vec<String> {
    let counts = receiver.counts();
    let of = course.asked_hz().map(|hz| format!(" of {hz}")).unwrap_or_default();
    let lost_percent = 100.0 * counts.lost as f64 / (counts.received + counts.lost).max(1) as f64;
    let mut words = vec![
        format!("{:.1}{of} Hz", receiver.rate_hz(now)),
        format!("{} lost ({lost_percent:.1} %)", counts.lost),
        counted(counts.received, "frame"),
    ];
    if let Some(latest) = receiver.latest(now) {
        words.push(format!("latency {:.1} ms", f64::from(latest.latency_us) / 1000.0));
    }
    words.push(format!("{} late", counts.late));
    words.push(format!("{} corrupt", receiver.bad().corrupt));
    words
}

#[cfg(test)]
mod tests;
