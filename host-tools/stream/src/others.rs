//! Telling boxes apart that send to the same place.

use std::net::SocketAddr;

use plumbline::packet::{Hello, Message};

/// Whether two Hellos have the same name and serial number.
#[must_use]
pub fn is_same_box(one: &Hello, other: &Hello) -> bool {
    (&one.device, &one.serial_number) == (&other.device, &other.serial_number)
}

/// A box, for people.
#[must_use]
pub fn name(hello: &Hello) -> String {
    format!("{} ({})", hello.device, hello.serial_number)
}

/// More than this would not be an oversight.
const OTHERS_MAX: usize = 8;

/// The boxes that are not listened to: each by its address, and by its name once that is known.
#[derive(Debug, Default)]
pub struct Others(Vec<(SocketAddr, Option<String>)>);

impl Others {
    /// Takes note of a packet; returns what is new about its sender, for people.
    pub fn take(&mut self, from: SocketAddr, message: &Message) -> Option<String> {
        let name = match message {
            Message::Hello(hello) => Some(name(hello)),
            _ => None,
        };
        if let Some((_, known)) = self.0.iter_mut().find(|(address, _)| *address == from) {
            let name = name.filter(|name| known.as_ref() != Some(name))?;
            let news = format!("{name} is the box at {from}");
            *known = Some(name);
            return Some(news);
        }
        if self.0.len() == OTHERS_MAX {
            return None;
        }
        let other = (from, name);
        let news = format!("{} sends here too", words(&other));
        self.0.push(other);
        Some(news)
    }

    /// All of them; `None` when there are none.
    #[must_use]
    pub fn words(&self) -> Option<String> {
        let all: Vec<String> = self.0.iter().map(words).collect();
        (!all.is_empty()).then(|| all.join(", "))
    }
}

fn words((address, name): &(SocketAddr, Option<String>)) -> String {
    match name {
        Some(name) => format!("{name} at {address}"),
        None => address.to_string(),
    }
}
