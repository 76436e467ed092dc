//! Telling boxes apart that send to the same place.

use std::net::SocketAddr;

use plumbline::packet::Hello;
use plumbline::seal::Announcement;

use crate::transport::words_of_other;

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

/// The boxes that are not listened to: what is said of each.
#[derive(Debug, Default)]
pub struct Others(Vec<(Option<SocketAddr>, String)>);

impl Others {
    /// Takes note of a box; returns what is new about it, for people.
    pub fn take(
        &mut self,
        from: Option<SocketAddr>,
        name: Option<&str>,
        announcement: &Announcement,
    ) -> Option<String> {
        let (what, remedy) = words_of_other(name, announcement);
        if self.0.len() == OTHERS_MAX || self.0.iter().any(|known| *known == (from, what.clone())) {
            return None;
        }
        self.0.push((from, what.clone()));
        Some(format!("{}: {remedy}", words(&(from, what))))
    }

    /// All of them; `None` when there are none.
    #[must_use]
    pub fn words(&self) -> Option<String> {
        let all: Vec<String> = self.0.iter().map(words).collect();
        (!all.is_empty()).then(|| all.join("; "))
    }
}

fn words((address, what): &(Option<SocketAddr>, String)) -> String {
    match address {
        Some(address) => format!("{what} (at {address})"),
        None => what.clone(),
    }
}
