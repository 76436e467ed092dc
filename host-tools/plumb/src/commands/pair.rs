//! `plumb pair`: a key for a box, over its serial cable.
//!
//! ```text
//! announcement ─▶ who it is, may it have a key now ─▶ key kept here ─▶ sent until answered
//!              ─▶ a sealed session over the same line: both have the key
//! ```

use std::time::{Duration, Instant};

use plumbline::packet::{Action, LinkKind};
use plumbline::seal::{
    Announcement, BoxState, Key, OneWay, Paired, Pairing, Peer, SEALED_BYTES_MAX, TOKEN_BYTES,
    greeting,
};
use plumbline_bedside::box_settings;
use plumbline_bedside::keys::{self, KnownBox, Store, device_text};
use plumbline_files::BadInput;
use plumbline_files::text::shown;
use plumbline_stream::link::{BAUD, BoxLink};
use plumbline_stream::transport::{Arrived, Carrier, KnownBox as Called, Link, Serial};

use crate::ui::waiting::Waiting;

/// A box announces itself every second or two, and answers a greeting at once.
const HEARD_WITHIN: Duration = Duration::from_secs(10);

/// A box stores a key on its card, which may be slow.
const STORED_WITHIN: Duration = Duration::from_secs(15);

/// What got no answer is sent again after this.
const SEND_EVERY: Duration = Duration::from_secs(1);

/// A session that was not opened in six times this is not opened at all.
const SESSION_WITHIN: Duration = Duration::from_secs(3);

/// The longest wait for bytes.
const WAIT: Duration = Duration::from_millis(100);

/// Give a box its key over a serial cable.
///
/// For a box whose card is not at hand: this computer makes a key, keeps it (`plumb keys`), sends it
/// over the cable, and then talks to the box under it, which shows that both have the same one. A key
/// that is kept here for the serial number of this box already is taken instead of a new one.
///
/// A box without a key takes one at any time. A box with a key takes another only in the first minute
/// after it was switched on: whoever holds the cable then could as well change the card. Its old key
/// is replaced with --replace alone, since every computer that hears the box then needs the new one.
///
/// Nothing hides the key on the cable. Use one that goes from this computer to the box and nowhere
/// else. If pairing fails, a box goes on with the key it had, and pairing again sends the same key.
///
/// Exit code 0: the box has the key; 2: it could not be paired.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  A new box on a cable; it says itself what it is called:
    plumb pair --serial /dev/ttyUSB0
  One that has no configuration yet, and so no name:
    plumb pair --serial /dev/ttyUSB0 --name \"ward 3\" --serial-number PL-0001
  A box whose key was lost: switch it off and on, and within a minute
    plumb pair --serial /dev/ttyUSB0 --serial-number PL-0001 --replace
  Afterwards, for a second computer:
    plumb keys export PL-0001 --out /media/stick/ward-3.key")]
pub struct Arguments {
    /// The serial device of this computer to which the box's cable goes
    #[arg(long, value_name = "DEVICE")]
    serial: String,

    /// Bits per second of the serial device
    #[arg(long, value_name = "RATE", default_value_t = BAUD)]
    baud: u32,

    /// The box's name [default: as it says itself]
    #[arg(long, value_name = "NAME", value_parser = device_text)]
    name: Option<String>,

    /// The box's serial number, by which its key is kept [default: as it says itself]
    #[arg(long, value_name = "NUMBER", value_parser = device_text)]
    serial_number: Option<String>,

    /// Give the box another key than the one that it has
    #[arg(long)]
    replace: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When the device cannot be used, no box is heard, or it does not take the key.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let store = Store::open()?;
    let place = &arguments.serial;
    let mut line = Serial::open(place, arguments.baud)?;
    let announcement = heard(&mut line, place)?;
    let known = announcement.key_id.map(|id| store.by_id(id)).transpose()?.flatten();
    if let Some(known) = known {
        verify(line, place, &known)?;
        eprintln!(
            "the box {} has the key {} already, and so has this computer: nothing was changed",
            known.title(),
            known.key.id()
        );
        return Ok(());
    }
    refuse(&announcement, place, arguments.replace)?;
    let known = key_for(&announcement, &store, arguments)?;
    let id = known.key.id();
    eprintln!("the key {id} for the box {} is kept in {}", known.title(), store.folder().display());
    give(&mut line, place, &known.key)?;
    eprintln!("the box has stored it");
    verify(line, place, &known)?;
    eprintln!("paired: the box {} and this computer talk under the key {id}", known.title());
    Ok(())
}

/// Waits until a box says that it is there.
fn heard(line: &mut impl Carrier, place: &str) -> Result<Announcement, BadInput> {
    let _waiting = Waiting::new(format!("listening at {place} for a box"));
    let until = Instant::now() + HEARD_WITHIN;
    let mut token = [0; TOKEN_BYTES];
    getrandom::fill(&mut token).map_err(|error| {
        BadInput::whole(place, error, "the operating system gives no random numbers")
    })?;
    let mut buffer = [0; SEALED_BYTES_MAX];
    let (mut noise, mut is_one_way) = (0_u32, false);
    let found =
        until_found(line, until, place, greeting(token, &mut buffer), |arrived| match arrived {
            Ok(bytes) => {
                is_one_way |= OneWay::key_id(bytes).is_some();
                Announcement::parse(bytes)
            }
            Err(()) => {
                noise += 1;
                None
            }
        })?;
    found.ok_or_else(|| match (is_one_way, noise) {
        (true, _) => BadInput::whole(
            place,
            "the box sends on this line and does not listen to it",
            "take the key to it on its card (`plumb provision --new-key --card`), or take one_way \
             out of its box file",
        ),
        (false, 0) => BadInput::whole(
            place,
            format!("no box is heard in {} s", HEARD_WITHIN.as_secs()),
            "check that the box is on, that its box file has links.serial, and both ends of the cable",
        ),
        (false, _) => BadInput::whole(
            place,
            format!("no box is heard, but {noise} pieces of noise"),
            "check the cable, and that --baud is the rate of links.serial in the box file",
        ),
    })
}

/// Refuses a box that takes no key now, or should keep the one that it has.
fn refuse(announcement: &Announcement, place: &str, replace: bool) -> Result<(), BadInput> {
    let text: String = announcement.text.chars().map(shown).collect();
    if let Some(id) = announcement.key_id.filter(|_| !replace) {
        return Err(BadInput::whole(
            place,
            format!("the box has a key already, {id}, which this computer does not have"),
            "bring that key here from a computer that has it (`plumb keys export` there, `plumb keys \
             import` here); --replace gives the box another, which every computer then needs",
        ));
    }
    if announcement.pairing_s == 0 {
        let said = if text.is_empty() { String::new() } else { format!(": {text}") };
        return Err(not_now(place, &said));
    }
    Ok(())
}

fn not_now(place: &str, said: &str) -> BadInput {
    BadInput::whole(
        place,
        format!("the box takes no key now{said}"),
        "switch the box off and on, and pair it within a minute",
    )
}

/// The key that the box is to have; it is kept before it is sent.
fn key_for(
    announcement: &Announcement,
    store: &Store,
    arguments: &Arguments,
) -> Result<KnownBox, BadInput> {
    let (said_name, said_number) = match said_identity(announcement) {
        Some((name, number)) => (Some(name), Some(number)),
        None => (None, None),
    };
    if let (Some(given), Some(said)) = (&arguments.serial_number, &said_number)
        && given != said
    {
        return Err(BadInput::new(
            "--serial-number",
            "",
            format!("the box on this line says that it is {said}"),
            format!("check the cable; without --serial-number its key is kept for {said}"),
        ));
    }
    let Some(number) = arguments.serial_number.clone().or(said_number) else {
        return Err(BadInput::whole(
            &arguments.serial,
            "the box does not say which one it is",
            "give --serial-number, and --name: its key is kept by them, as its box file has them",
        ));
    };
    if let Some(known) = store.by_serial_number(&number)? {
        return Ok(known);
    }
    let new = KnownBox::new(keys::draw()?, arguments.name.clone().or(said_name), Some(number));
    store.add(&new)?;
    Ok(new)
}

/// Name and serial number, as a box without a usable key says them: `ward 3 (PL-0001) has no key`.
/// `None` for a box that has a key, which says neither, or that was never named.
fn said_identity(announcement: &Announcement) -> Option<(String, String)> {
    let end = match announcement.state {
        BoxState::Unpaired => ") has no key",
        BoxState::KeyUnreadable => "): its key cannot be used",
        _ => return None,
    };
    let (identity, _) = announcement.text.split_once(end)?;
    let (name, number) = identity.rsplit_once(" (")?;
    if box_settings::is_unnamed(name, number) {
        return None;
    }
    Some((device_text(name).ok()?, device_text(number).ok()?))
}

/// Sends the key until the box has it.
fn give(line: &mut impl Carrier, place: &str, key: &Key) -> Result<(), BadInput> {
    let _waiting = Waiting::new("sending the key");
    let mut buffer = [0; SEALED_BYTES_MAX];
    let pairing = Pairing { key: key.clone() };
    let until = Instant::now() + STORED_WITHIN;
    let answer = until_found(line, until, place, pairing.packet(&mut buffer), |arrived| {
        let bytes = arrived.ok()?;
        if let Some(paired) = Paired::read(bytes).filter(|it| it.key_id == key.id()) {
            return Some(if paired.is_stored { Answer::Stored } else { Answer::NotStored });
        }
        let announcement = Announcement::parse(bytes)?;
        if announcement.key_id == Some(key.id()) {
            // Its answer was lost.
            return Some(Answer::Stored);
        }
        (announcement.pairing_s == 0).then_some(Answer::NotNow)
    });
    zeroize::Zeroize::zeroize(&mut buffer);
    match answer? {
        Some(Answer::Stored) => Ok(()),
        Some(Answer::NotStored) => Err(BadInput::whole(
            place,
            "the box could not store the key, and goes on as before",
            "check its card, and pair again: the same key is sent",
        )),
        Some(Answer::NotNow) => Err(not_now(place, ": its time is over")),
        None => Err(BadInput::whole(
            place,
            format!("the box has not answered in {} s", STORED_WITHIN.as_secs()),
            "check the cable, switch the box off and on, and pair again within a minute: the same key \
             is sent",
        )),
    }
}

/// What a box says to a key.
enum Answer {
    Stored,
    NotStored,
    NotNow,
}

/// Talks to the box under its key.
fn verify(line: Serial, place: &str, known: &KnownBox) -> Result<(), BadInput> {
    let _waiting = Waiting::new("talking to the box under its key");
    let called = Called { name: known.title(), key: known.key.clone(), address: None };
    let link = Link::new(line, vec![called], &crate::arguments::program());
    let mut link = BoxLink::new(Box::new(link), place.to_owned(), LinkKind::Serial);
    let ping = Action::Ping { host_sent_ns: 0 };
    link.ask_aside(ping, SESSION_WITHIN, |_| {}).map(|_| ()).map_err(|error| {
        BadInput::whole(
            place,
            format!(
                "the box says that it has the key {}, but no session is opened: {error}",
                known.key.id()
            ),
            "switch the box off and on, and see `plumb doctor --serial`",
        )
    })
}

/// Sends a packet again and again until one of those that come is what is looked for; `Err(())` is a
/// piece of noise.
fn until_found<T>(
    line: &mut impl Carrier,
    until: Instant,
    place: &str,
    packet: &[u8],
    mut look: impl FnMut(Result<&[u8], ()>) -> Option<T>,
) -> Result<Option<T>, BadInput> {
    let mut send_at = Instant::now();
    let (mut found, mut lost) = (None, None);
    while found.is_none() && Instant::now() < until {
        if Instant::now() >= send_at {
            send_at = Instant::now() + SEND_EVERY;
            line.send(Peer::Serial, packet);
        }
        line.poll(WAIT, &mut |arrived| match arrived {
            _ if found.is_some() => {}
            Arrived::Packet { bytes, .. } => found = look(Ok(bytes)),
            Arrived::Bad(_) => found = look(Err(())),
            Arrived::LineLost(why) => lost = Some(why),
            Arrived::LineBack => lost = None,
        })?;
    }
    match (found, lost) {
        (None, Some(why)) => {
            Err(BadInput::whole(place, format!("the line is lost: {why}"), "check the cable"))
        }
        (found, _) => Ok(found),
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::{SCHEMA_HASH, Start};

    use super::*;

    fn announcement(state: BoxState, text: &str) -> Announcement {
        Announcement {
            key_id: None,
            start: Start::MIN,
            schema_hash: SCHEMA_HASH,
            versions: [1, 1],
            state,
            pairing_s: 255,
            text: text.try_into().unwrap(),
        }
    }

    #[test]
    fn a_box_without_a_key_says_who_it_is() {
        let said = |state, text| said_identity(&announcement(state, text));
        let ward = Some(("ward 3".to_owned(), "PL-0001".to_owned()));
        assert_eq!(said(BoxState::Unpaired, "ward 3 (PL-0001) has no key; no config.plb"), ward);
        let unreadable = "ward 3 (PL-0001): its key cannot be used: box.key is not a key";
        assert_eq!(said(BoxState::KeyUnreadable, unreadable), ward);
        let left = Some(("ward (left)".to_owned(), "7".to_owned()));
        assert_eq!(said(BoxState::Unpaired, "ward (left) (7) has no key"), left);
        for text in ["plumbline (0) has no key", "a box without a name has no key", ""] {
            assert_eq!(said(BoxState::Unpaired, text), None, "{text}");
        }
        assert_eq!(said(BoxState::Ready, "ward 3 (PL-0001) has no key"), None);
    }
}
