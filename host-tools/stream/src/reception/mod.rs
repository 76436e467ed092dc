//! Receiving until there is enough: packets to the [`Receiver`] and to whoever follows beside
//! it, their questions to the box.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use plumbline::packet::{Message, Packet, Start};
use plumbline_files::BadInput;

use crate::receiver::Receiver;
use crate::transport::{Event, Transport};

/// What was lost on the way is waited for at the end for as long as some of it comes within this
/// time.
const BACKLOG_PAUSE: Duration = Duration::from_secs(3);

/// And no longer than this: what a box keeps goes over a slow line in that time.
const BACKLOG_MAX: Duration = Duration::from_secs(120);

/// Who follows a reception beside its [`Receiver`].
pub trait Tap {
    /// Something came.
    ///
    /// # Errors
    /// When the reception cannot go on.
    fn event(&mut self, event: &Event, now: Instant) -> Result<(), BadInput>;

    /// Time passes, whether or not something comes; a question that the box should get.
    ///
    /// # Errors
    /// When the reception cannot go on.
    fn turn(&mut self, now: Instant) -> Result<Option<Message>, BadInput>;
}

/// Nobody.
impl Tap for () {
    fn event(&mut self, _: &Event, _: Instant) -> Result<(), BadInput> {
        Ok(())
    }

    fn turn(&mut self, _: Instant) -> Result<Option<Message>, BadInput> {
        Ok(None)
    }
}

/// Both, in this order. The second asks when the first has no question.
impl Tap for (&mut dyn Tap, &mut dyn Tap) {
    fn event(&mut self, event: &Event, now: Instant) -> Result<(), BadInput> {
        self.0.event(event, now)?;
        self.1.event(event, now)
    }

    fn turn(&mut self, now: Instant) -> Result<Option<Message>, BadInput> {
        match self.0.turn(now)? {
            None => self.1.turn(now),
            question => Ok(question),
        }
    }
}

/// Receives until this many different pose packets have come, `stop` is set or `show` breaks, which
/// it does where the end depends on what came, such as a mark. It is called after every packet, and ten times a second
/// when none comes. `tap` sees everything first. At the end it takes what was lost on the way and is
/// sent again.
///
/// # Errors
/// When the transport or the recording cannot go on, or the box has been exchanged for another one.
/// What was received before is in the recording.
pub fn receive<W: std::io::Write>(
    transport: &mut dyn Transport,
    receiver: &mut Receiver<W>,
    tap: &mut dyn Tap,
    frames: Option<u64>,
    stop: &AtomicBool,
    mut show: impl FnMut(&mut Receiver<W>) -> ControlFlow<()>,
) -> Result<(), BadInput> {
    let result = follow(transport, receiver, tap, frames, stop, &mut show);
    let result = result.and_then(|()| take_backlog(transport, receiver, tap, &mut show));
    // Poses that still wait for a Hello.
    result.and(receiver.finish(Instant::now()))
}

/// The same, for who only watches: what was lost on the way is not waited for at the end.
///
/// # Errors
/// As [`receive`].
pub fn follow<W: std::io::Write>(
    transport: &mut dyn Transport,
    receiver: &mut Receiver<W>,
    tap: &mut dyn Tap,
    frames: Option<u64>,
    stop: &AtomicBool,
    show: &mut impl FnMut(&mut Receiver<W>) -> ControlFlow<()>,
) -> Result<(), BadInput> {
    let reached =
        |receiver: &Receiver<W>| frames.is_some_and(|frames| receiver.counts().received >= frames);
    loop {
        if stop.load(Ordering::Relaxed) || reached(receiver) {
            return Ok(());
        }
        turn(transport, receiver, tap, &reached)?;
        if show(receiver).is_break() {
            return Ok(());
        }
    }
}

/// One turn of a reception: what has come, or comes while the transport waits, and the questions that
/// are due. Nothing more is taken once `is_full` is true: the rest belongs to the next recording.
///
/// # Errors
/// As [`receive`].
pub fn turn<W: std::io::Write>(
    transport: &mut dyn Transport,
    receiver: &mut Receiver<W>,
    tap: &mut dyn Tap,
    is_full: &dyn Fn(&Receiver<W>) -> bool,
) -> Result<(), BadInput> {
    let mut handled = Ok(());
    let mut bytes_came = None;
    let polled = transport.poll(&mut |event| {
        if handled.is_ok() && !is_full(receiver) {
            // A packet arrives with its bytes, which are handed over just before it: how long these take
            // to be written down is no part of its time.
            let now = match (&event, bytes_came.take()) {
                (Event::Packet(_), Some(then)) => then,
                _ => Instant::now(),
            };
            bytes_came = matches!(event, Event::Raw(_)).then_some(now);
            handled = tap.event(&event, now).and_then(|()| receiver.handle(event, now));
        }
    });
    handled.and(polled).and_then(|()| receiver.tick(Instant::now()))?;
    receiver.exchanged().map_or(Ok(()), Err)?;
    let question = tap.turn(Instant::now())?;
    for question in [receiver.request(Instant::now()), question].into_iter().flatten() {
        transport.send(&question);
    }
    Ok(())
}

fn take_backlog<W: std::io::Write>(
    transport: &mut dyn Transport,
    receiver: &mut Receiver<W>,
    tap: &mut dyn Tap,
    show: &mut impl FnMut(&mut Receiver<W>) -> ControlFlow<()>,
) -> Result<(), BadInput> {
    let mut backlog = Backlog::of(receiver);
    while backlog.is_awaited(transport) {
        backlog.turn(transport, receiver, tap)?;
        let _ = show(receiver);
    }
    Ok(())
}

/// What was lost on the way of a reception that is over, and is being sent again: nothing that is newer
/// than what has come.
#[derive(Debug, Clone, Copy)]
pub struct Backlog {
    begun: Instant,
    moved: Instant,
    newest: Option<(Start, u32)>,
}

impl Backlog {
    /// Of a reception that is over now.
    #[must_use]
    pub fn of<W: std::io::Write>(receiver: &Receiver<W>) -> Self {
        let begun = Instant::now();
        Self { begun, moved: begun, newest: receiver.newest_pose() }
    }

    /// Whether something is missing that may still come.
    #[must_use]
    pub fn is_awaited(&self, transport: &dyn Transport) -> bool {
        transport.is_missing()
            && self.moved.elapsed() < BACKLOG_PAUSE
            && self.begun.elapsed() < BACKLOG_MAX
    }

    /// Takes what has come of it, or comes while the transport waits.
    ///
    /// # Errors
    /// As [`receive`].
    pub fn turn<W: std::io::Write>(
        &mut self,
        transport: &mut dyn Transport,
        receiver: &mut Receiver<W>,
        tap: &mut dyn Tap,
    ) -> Result<(), BadInput> {
        let Self { moved, newest, .. } = self;
        let mut raw = None;
        let mut handled = Ok(());
        let polled = transport.poll(&mut |event| match event {
            Event::Raw(_) => raw = Some(event),
            Event::Packet(Packet { start, message: Message::Pose(ref pose) })
                if newest.is_some_and(|(of, last)| start == Some(of) && pose.sequence < last) =>
            {
                *moved = Instant::now();
                for event in [raw.take(), Some(event)].into_iter().flatten() {
                    let done =
                        tap.event(&event, *moved).and_then(|()| receiver.handle(event, *moved));
                    handled = std::mem::replace(&mut handled, Ok(())).and(done);
                }
            }
            _ => raw = None,
        });
        handled.and(polled)?;
        receiver.tick(Instant::now())
    }
}

#[cfg(test)]
mod tests;
