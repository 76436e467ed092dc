//! What keeps a box that is heard from being listened to, in words, and what to do.

use plumbline::packet::{PROTOCOL_VERSION, SCHEMA_HASH};
use plumbline::seal::{Announcement, BoxState, Obstacle};
use plumbline_files::text::shown;

/// What is in the way of a session with a box, which this computer may have a name for.
pub(super) fn words_of(name: Option<&str>, obstacle: &Obstacle) -> (String, String) {
    let subject = name.map_or_else(|| "a box".to_owned(), |name| format!("the box {name}"));
    match obstacle {
        Obstacle::OtherVersions { versions: [lowest, highest] } => {
            let spoken = if lowest == highest {
                format!("version {lowest}")
            } else {
                format!("versions {lowest} to {highest}")
            };
            let remedy = if *lowest > PROTOCOL_VERSION {
                "this program is the older one: update Plumbline on this computer, or give the box the \
                 release that is on this computer (`plumb update`, or another card)"
            } else {
                "the box is the older one: give it the release that is on this computer (`plumb update`, or \
                 another card), or use the box's release of Plumbline here"
            };
            let what =
                format!("{subject} speaks {spoken} of the link, this program {PROTOCOL_VERSION}");
            (what, remedy.to_owned())
        }
        Obstacle::OtherSchema { hash } => (
            format!(
                "{subject} is of another release: its messages are {hash:08x}, this program's are \
                 {SCHEMA_HASH:08x}"
            ),
            "give both the same release: update Plumbline on this computer, or the box (`plumb update`, \
             or another card)"
                .to_owned(),
        ),
        Obstacle::Busy { reason } => {
            let reason: String = reason.chars().map(shown).collect();
            (format!("{subject} takes no further listener: {reason}"), "stop one of them".to_owned())
        }
    }
}

/// What keeps a box from being listened to that says in clear that it is there.
#[must_use]
pub fn words_of_other(name: Option<&str>, announcement: &Announcement) -> (String, String) {
    if let Some(obstacle) = Obstacle::of(announcement) {
        return words_of(name, &obstacle);
    }
    let text: String = announcement.text.chars().map(shown).collect();
    let told = |why: &str| if text.is_empty() { why.to_owned() } else { format!("{why}: {text}") };
    let pair = "bring it a key on its card (`plumb provision --new-key`) or over a serial cable \
                (`plumb pair`)";
    match (announcement.state, announcement.key_id, name) {
        (BoxState::Unpaired, ..) => (told("a box is heard that has no key"), pair.to_owned()),
        (BoxState::KeyUnreadable, ..) => {
            (told("a box is heard that cannot read its key"), pair.to_owned())
        }
        (_, _, Some(name)) => (
            format!("another box is heard: {name}"),
            "choose it with --box-name: see `plumb keys list`".to_owned(),
        ),
        (_, Some(id), None) => (
            format!("a box is heard whose key, {id}, this computer does not have"),
            "bring the key from a computer that has it (`plumb keys export` there, \
             `plumb keys import` here)"
                .to_owned(),
        ),
        (_, None, None) => (told("a box is heard that has no key"), pair.to_owned()),
    }
}
