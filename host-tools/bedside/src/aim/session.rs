//! The set-up mode of a box, kept up as long as it is wanted.
//!
//! Everything goes on side by side: the mode is renewed, poses and health come by themselves,
//! numbers are asked for, and a picture is taken and fetched in parts ([`Arriving`]), which over a
//! serial line takes longer than the mode lasts. [`Session::turn`] does what is due and returns soon.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use plumbline::config::Config;
use plumbline::packet::{
    AIM_S_MAX, Action, CameraState, Health, Hello, LinkKind, Message, PosePacket, Refusal,
    ReplyOutcome, View,
};
use plumbline_files::BadInput;
use plumbline_stream::link::{BoxLink, SILENT_AFTER, Stopped, is_of_box};

use super::picture::{Arriving, Progress, Taken};
use super::reading::{self, BestFocus, Reading};
use crate::told::{Tell, waiting};

/// The time for which the mode is asked for: the box leaves it soon after this program has gone.
const MODE_S: u16 = 20;
const _: () = assert!(MODE_S <= AIM_S_MAX);

/// The mode is renewed this often: four renewals may be lost in a row.
const RENEW_EVERY: Duration = Duration::from_secs(4);

/// Numbers are asked for this often.
const VIEW_EVERY: Duration = Duration::from_millis(400);

/// After this much silence the box is no longer waited for.
const GONE_AFTER: Duration = Duration::from_secs(10);

/// A question whose answer is waited for is repeated after this time.
const ANSWER_WITHIN: Duration = Duration::from_millis(700);

/// The approximate time of one turn, short enough for keys.
const TURN: Duration = Duration::from_millis(30);

/// The pose packets that are kept, to find that of a picture's frame: at 60 Hz a picture comes four
/// seconds later, or its pose is found as soon as word of it comes.
const POSES: usize = 256;

/// When the box was last heard.
#[derive(Debug, Clone, Copy)]
struct Hearing(Instant);

impl Hearing {
    fn heard(&mut self, now: Instant) {
        self.0 = now;
    }

    /// For how long nothing has been heard, once that is longer than usual.
    fn silence(&self, now: Instant) -> Option<Duration> {
        let silence = now.saturating_duration_since(self.0);
        (silence >= SILENT_AFTER).then_some(silence)
    }
}

/// The words for a silent box.
#[must_use]
pub fn silence_words(silence: Duration) -> String {
    format!("nothing heard from the box for {} s", silence.as_secs())
}

/// Words about a box that is silent: for each second once.
#[derive(Debug, Default)]
pub struct SilenceLines {
    told_s: Option<u64>,
}

impl SilenceLines {
    /// What there is to say now, if anything, of a box that has been silent for this long.
    pub fn next(&mut self, silence: Option<Duration>) -> Option<String> {
        let told_s = std::mem::replace(&mut self.told_s, silence.map(|it| it.as_secs()));
        silence.filter(|_| told_s != self.told_s).map(silence_words)
    }
}

/// The outcome of asking the box for an exposure.
pub(crate) enum Exposed {
    /// It will.
    AsAsked,
    /// Why not, in the box's own words.
    Refused(Refusal, String),
    /// It was not heard meanwhile.
    Unheard,
}

/// A box in set-up mode, and the link to it.
pub struct Session {
    link: BoxLink,
    hearing: Hearing,
    /// As of the last time of listening: while this program is busy, the box is not silent.
    silence: Option<Duration>,
    /// Who the box is, and which of its starts this is.
    hello: Hello,
    restarts: u32,
    config: Config,
    renewed: Instant,
    viewed: Instant,
    view: Option<View>,
    health: Option<Health>,
    poses: VecDeque<PosePacket>,
    picture: Arriving,
}

impl Session {
    /// Brings a box into set-up mode; `force`: even while somebody records a trial, which that
    /// spoils.
    ///
    /// # Errors
    /// When no box is heard, or it refuses.
    pub fn begin(mut link: BoxLink, force: bool, tell: &mut Tell<'_>) -> Result<Self, BadInput> {
        if force {
            link.force();
        }
        let (hello, config) = waiting(tell, format!("listening at {}", link.place()), || {
            Ok((link.hello()?, link.config()?))
        })?;
        link.request(Action::Aim { seconds: MODE_S }, "set-up mode")?;
        let now = Instant::now();
        Ok(Self {
            link,
            hearing: Hearing(now),
            silence: None,
            hello,
            restarts: 0,
            config,
            renewed: now,
            viewed: now - VIEW_EVERY,
            view: None,
            health: None,
            poses: VecDeque::with_capacity(POSES),
            picture: Arriving::default(),
        })
    }

    /// Ends the mode; returns the link.
    ///
    /// # Errors
    /// When the box does not confirm it; a silent one is asked, but not waited for.
    pub fn end(mut self) -> Result<BoxLink, BadInput> {
        let action = Action::Aim { seconds: 0 };
        let why = if self.silence.is_some() {
            self.link.send(action);
            None
        } else {
            match self.ask(action) {
                Ok(ReplyOutcome::Refused { refusal, reason }) => {
                    Some(self.refused("to leave set-up mode", refusal, &reason).found)
                }
                Ok(_) => return Ok(self.link),
                Err(error) => Some(error.found),
            }
        };
        let why = match (self.silence, why) {
            (Some(silence), _) => silence_words(silence),
            (None, why) => why.unwrap_or_default(),
        };
        Err(BadInput::whole(
            self.link.place(),
            format!("the box has not confirmed that set-up mode is over: {why}"),
            format!("it ends by itself within {MODE_S} s"),
        ))
    }

    /// Repeats a question until it is answered, and takes note of what else comes.
    fn ask(&mut self, action: Action) -> Result<ReplyOutcome, BadInput> {
        let hearing = &mut self.hearing;
        let mut hello = None;
        let outcome = self.link.ask_aside(action, ANSWER_WITHIN, |message| {
            if is_of_box(message) {
                hearing.heard(Instant::now());
            }
            if let Message::Hello(heard) = message {
                hello = Some(heard.clone());
            }
        });
        let now = Instant::now();
        if outcome.is_ok() {
            self.hearing.heard(now);
        }
        self.silence = self.hearing.silence(now);
        hello.map_or(Ok(()), |hello| self.take_hello(hello))?;
        outcome
    }

    /// A box that has restarted is not in set-up mode, and what was seen of it is outdated.
    fn take_hello(&mut self, hello: Hello) -> Result<(), BadInput> {
        if hello.boot_id == self.hello.boot_id {
            return Ok(());
        }
        self.link.refuse_another(&self.hello, &hello)?;
        if hello.config_crc != self.hello.config_crc {
            return Err(BadInput::whole(
                self.link.place(),
                "the box has restarted, with another configuration",
                "start `plumb aim` again",
            ));
        }
        self.hello = hello;
        self.restarts += 1;
        self.forget();
        self.picture.take_again(&mut self.link);
        self.renew(Instant::now());
        Ok(())
    }

    /// How often the box has restarted meanwhile.
    #[must_use]
    pub fn restarts(&self) -> u32 {
        self.restarts
    }

    /// Who the box is.
    #[must_use]
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// For how long the box has been silent, if that is longer than usual. This is different from
    /// a camera that gives no frames.
    #[must_use]
    pub fn silence(&self) -> Option<Duration> {
        self.silence
    }

    /// What the box runs with.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The kind of the link.
    #[must_use]
    pub fn kind(&self) -> LinkKind {
        self.link.kind()
    }

    /// The name of the link in messages.
    #[must_use]
    pub fn place(&self) -> &str {
        self.link.place()
    }

    /// The latest numbers.
    #[must_use]
    pub fn view(&self) -> Option<&View> {
        self.view.as_ref()
    }

    /// What the latest numbers say, if there are any.
    #[must_use]
    pub fn reading(&self, best: &mut BestFocus) -> Option<Reading> {
        let view = self.view()?;
        let pose = self.pose_of(view.sequence).or(self.poses.back());
        Some(reading::read(&self.config, view, pose, best))
    }

    /// What was found in a frame, if that came and is not long ago.
    fn pose_of(&self, sequence: u32) -> Option<&PosePacket> {
        pose_in(&self.poses, sequence)
    }

    /// Why there are no frames, if so.
    #[must_use]
    pub fn without_frames(&self) -> Option<&'static str> {
        match self.health.as_ref()?.camera {
            CameraState::Starting => Some("the camera has given no frame yet"),
            CameraState::Running => None,
            CameraState::Stalled => Some("the camera gives no frames"),
            CameraState::Lost => Some("the camera is absent or reports errors"),
            CameraState::Ended => Some("the recording that the box replays is over"),
        }
    }

    /// Nothing is being taken.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.picture.is_nothing()
    }

    /// Asks for a picture, in place of one that was under way; [`turn`](Self::turn) returns
    /// it when it has come.
    pub fn take(&mut self, reduction: u8) {
        self.picture.take(&mut self.link, reduction);
    }

    /// How far the picture under way has come.
    #[must_use]
    pub fn progress(&self) -> Option<Progress> {
        self.picture.progress()
    }

    /// Asks the box for this exposure until the mode ends.
    ///
    /// # Errors
    /// When there is no answer, and the box is heard.
    pub(crate) fn expose(
        &mut self,
        exposure_us: Option<u32>,
        gain: Option<f32>,
    ) -> Result<Exposed, BadInput> {
        self.view = None;
        let mut answer = self.ask(Action::Expose { exposure_us, gain });
        if let Ok(ReplyOutcome::Refused { refusal: Refusal::NotAiming, .. }) = answer {
            // It has restarted, or has not heard the renewals.
            answer = self
                .ask(Action::Aim { seconds: MODE_S })
                .and_then(|_| self.ask(Action::Expose { exposure_us, gain }));
        }
        match answer {
            Ok(ReplyOutcome::Refused { refusal, reason }) => {
                Ok(Exposed::Refused(refusal, reason.to_string()))
            }
            Ok(_) => Ok(Exposed::AsAsked),
            Err(_) if self.silence.is_some() => Ok(Exposed::Unheard),
            Err(error) => Err(error),
        }
    }

    /// A refusal as an error for the user.
    pub(crate) fn refused(&self, what: &str, refusal: Refusal, reason: &str) -> BadInput {
        self.link.refused(what, refusal, reason)
    }

    /// Does what is due and listens for a moment; a picture that is complete.
    ///
    /// # Errors
    /// When the link can no longer be used, the box is no longer heard, or it refuses what it
    /// is asked for.
    pub fn turn(&mut self) -> Result<Option<Taken>, BadInput> {
        let now = Instant::now();
        if now - self.renewed >= RENEW_EVERY {
            self.renew(now);
        }
        if now - self.viewed >= VIEW_EVERY {
            self.viewed = now;
            self.link.send(Action::SendView);
        }
        // A silent box's missing answers are not failures of the picture.
        if self.silence.is_none()
            && let Err(stopped) = self.picture.ask(&mut self.link, now)
        {
            self.failed(&stopped)?;
        }
        let mut messages = Vec::new();
        // From now: the first turn after a pause listens as well.
        self.link.messages(Instant::now() + TURN, |message| {
            messages.push(message.clone());
            None::<()>
        })?;
        self.listened(messages.iter().any(is_of_box), Instant::now())?;
        for message in messages {
            self.message(message)?;
        }
        match self.picture.complete(|sequence| pose_in(&self.poses, sequence)) {
            Ok(taken) => Ok(taken),
            Err(stopped) => self.failed(&stopped).map(|()| None),
        }
    }

    /// Forgets what was seen when the box falls silent: the old is not shown as new, then or when
    /// it is heard again.
    fn listened(&mut self, is_heard: bool, now: Instant) -> Result<(), BadInput> {
        if is_heard {
            self.hearing.heard(now);
        }
        self.silence = self.hearing.silence(now);
        let Some(silence) = self.silence else { return Ok(()) };
        if silence >= GONE_AFTER {
            return Err(BadInput::whole(
                self.link.place(),
                "the box is no longer heard",
                "check its power and its link; set-up mode ends by itself",
            ));
        }
        self.forget();
        Ok(())
    }

    fn forget(&mut self) {
        self.view = None;
        self.health = None;
        self.poses.clear();
    }

    fn renew(&mut self, now: Instant) {
        self.renewed = now;
        self.link.send(Action::Aim { seconds: MODE_S });
    }

    fn message(&mut self, message: Message) -> Result<(), BadInput> {
        if let Err(stopped) = self.picture.message(&message) {
            return self.failed(&stopped);
        }
        match message {
            Message::Pose(pose) => {
                if self.poses.len() == POSES {
                    self.poses.pop_front();
                }
                self.poses.push_back(pose);
            }
            Message::View(view) => self.view = Some(view),
            Message::Health(health) => self.health = Some(health),
            Message::Picture(picture) => {
                let pose = pose_in(&self.poses, picture.sequence);
                self.picture.word_of(picture, pose, self.link.place())?;
            }
            // Not needed here, or for another program on this computer.
            Message::Hello(hello) => self.take_hello(hello)?,
            Message::Reply(_)
            | Message::Log(_)
            | Message::Part(_)
            | Message::Command(_)
            | Message::Trigger(_) => {}
        }
        Ok(())
    }

    /// The picture under way does not come, and is taken again, unless that is of no use.
    fn failed(&mut self, stopped: &Stopped) -> Result<(), BadInput> {
        if self.picture.fail(stopped) {
            return Err(self.link.stopped(stopped));
        }
        if matches!(stopped, Stopped::Refused(Refusal::NotAiming, _)) {
            // It has restarted, or has not heard the renewals.
            self.renew(Instant::now());
        }
        Ok(())
    }
}

/// What was found in a frame.
fn pose_in(poses: &VecDeque<PosePacket>, sequence: u32) -> Option<&PosePacket> {
    poses.iter().rev().find(|pose| pose.sequence == sequence)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_is_told_once_a_second() {
        let mut lines = SilenceLines::default();
        let silences = [None, Some(3.0), Some(3.4), Some(4.1), None, Some(4.2)];
        let told = silences.map(|silence| lines.next(silence.map(Duration::from_secs_f64)));
        let words = |seconds| Some(format!("nothing heard from the box for {seconds} s"));
        assert_eq!(told, [None, words(3), None, words(4), None, words(4)]);
    }

    #[test]
    fn silence_counts_from_the_last_message() {
        let start = Instant::now();
        let after = |seconds: f64| start + Duration::from_secs_f64(seconds);
        let mut hearing = Hearing(start);
        assert_eq!(hearing.silence(after(2.9)), None);
        assert_eq!(hearing.silence(after(3.0)), Some(SILENT_AFTER));
        hearing.heard(after(3.5));
        assert_eq!(hearing.silence(after(6.4)), None, "it is heard again");
        let silence = hearing.silence(after(9.5)).unwrap();
        assert_eq!(silence, Duration::from_secs(6));
        assert_eq!(silence_words(silence), "nothing heard from the box for 6 s");
        assert_eq!(hearing.silence(start), None, "time that is older than the message");
    }
}
