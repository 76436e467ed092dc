//! A link whose packets are published whatever is done with it: while it is watched, while a trial is
//! recorded, and while its box is asked something.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Instant;

use plumbline::packet::{Message, Reply};
use plumbline_files::BadInput;
use plumbline_stream::questions::Questions;
use plumbline_stream::reception::Tap as _;
use plumbline_stream::transport::{Event, Transport};

use crate::Publisher;

/// A transport whose packets a [`Publisher`] sees first. It has to ask for the box's clock itself: the
/// answers to its questions are handed to nobody else, because a recording would take them for answers
/// to its own.
pub struct Tapped {
    inner: Box<dyn Transport>,
    publisher: Rc<RefCell<Publisher>>,
}

impl Tapped {
    /// This transport, and who sees its packets.
    #[must_use]
    pub fn new(inner: Box<dyn Transport>, publisher: Rc<RefCell<Publisher>>) -> Self {
        Self { inner, publisher }
    }
}

/// Whether something answers a question of the publisher.
fn is_for_publisher(event: &Event) -> bool {
    matches!(event, Event::Packet(packet)
        if matches!(&packet.message, Message::Reply(Reply { id, .. }) if Questions::is_of_clock(*id)))
}

impl Transport for Tapped {
    fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput> {
        let mut told = Ok(());
        // The bytes of a packet come before it.
        let mut raw = None;
        let publisher = &self.publisher;
        let polled = self.inner.poll(&mut |event| {
            if told.is_ok() {
                told = publisher.borrow_mut().event(&event, Instant::now());
            }
            match event {
                Event::Raw(_) => {
                    if let Some(before) = raw.replace(event) {
                        take(before);
                    }
                }
                event => {
                    let before = raw.take();
                    if !is_for_publisher(&event) {
                        before.into_iter().chain([event]).for_each(&mut *take);
                    }
                }
            }
        });
        if let Some(raw) = raw {
            take(raw);
        }
        polled.and(told)?;
        let question = self.publisher.borrow_mut().turn(Instant::now())?;
        if let Some(question) = question {
            self.inner.send(&question);
        }
        Ok(())
    }

    fn send(&mut self, message: &Message) {
        self.inner.send(message);
    }

    fn is_missing(&self) -> bool {
        self.inner.is_missing()
    }

    fn obstacle(&self) -> Option<(String, String)> {
        self.inner.obstacle()
    }

    fn dropped_here(&self) -> Option<u64> {
        self.inner.dropped_here()
    }
}
