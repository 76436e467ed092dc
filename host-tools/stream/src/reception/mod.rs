//! Receiving until there is enough: packets to the [`Receiver`] and to whoever follows beside
//! it, their questions to the box.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use plumbline::packet::Message;
use plumbline_files::BadInput;

use crate::receiver::Receiver;
use crate::transport::{Event, Transport};

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

/// Receives until this many different pose packets have come, `stop` is set or `show` breaks, which
/// it does where the end depends on what came, such as a mark. It is called after every packet, and ten times a second
/// when none comes. `tap` sees everything first.
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
    let reached =
        |receiver: &Receiver<W>| frames.is_some_and(|frames| receiver.counts().received >= frames);
    let result = loop {
        if stop.load(Ordering::Relaxed) || reached(receiver) {
            break Ok(());
        }
        let mut handled = Ok(());
        let polled = transport.poll(&mut |event| {
            // The rest of one read belongs to the next recording, if any.
            if handled.is_ok() && !reached(receiver) {
                let now = Instant::now();
                handled = tap.event(&event, now).and_then(|()| receiver.handle(event, now));
            }
        });
        let result = handled.and(polled).and_then(|()| receiver.tick(Instant::now()));
        let result = result.and_then(|()| receiver.exchanged().map_or(Ok(()), Err));
        let question = match result.and_then(|()| tap.turn(Instant::now())) {
            Ok(question) => question,
            Err(error) => break Err(error),
        };
        for question in [receiver.request(Instant::now()), question].into_iter().flatten() {
            transport.send(&question);
        }
        if show(receiver).is_break() {
            break Ok(());
        }
    };
    // Poses that still wait for a Hello.
    result.and(receiver.finish(Instant::now()))
}

#[cfg(test)]
mod tests;
