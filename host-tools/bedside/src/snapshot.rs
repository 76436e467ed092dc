//! One small picture of what the camera of a box sees.
//!
//! Pictures leave a box in set-up mode only: it is switched on, and off again whatever comes.

use std::time::{Duration, Instant};

use plumbline::packet::{Action, Document, Message, Picture, Reply, ReplyOutcome, document_crc};
use plumbline_calibration::background;
use plumbline_files::BadInput;
use plumbline_stream::link::BoxLink;

use crate::told::{Tell, waiting};

/// Set-up mode ends by itself after this, if this program is stopped meanwhile. A serial line
/// carries a picture of 8 kB in a second.
const MODE_S: u16 = 20;

/// A picture is announced with the next frame.
const ANNOUNCED_WITHIN: Duration = Duration::from_secs(1);

/// The most times that a picture is asked for: the box may be busy, or a packet lost.
const TRIES: usize = 4;

/// A reduced picture that is larger is an error.
const BYTES_MAX: u32 = 4 << 20;

/// A picture of a frame, reduced by this factor each way.
///
/// # Errors
/// When the box refuses set-up mode or the picture, does not send it, or does not confirm that
/// the mode is over.
pub fn take(
    link: &mut BoxLink,
    reduction: u8,
    tell: &mut Tell<'_>,
) -> Result<background::Picture, BadInput> {
    let file = waiting(tell, "taking a small picture of the background, in set-up mode", || {
        link.request(Action::Aim { seconds: MODE_S }, "set-up mode")?;
        let file = fetched(link, reduction);
        link.request(Action::Aim { seconds: 0 }, "to leave set-up mode")?;
        file
    })?;
    let picture = image::load_from_memory(&file).map_err(|error| {
        BadInput::whole(
            link.place(),
            format!("the box's picture cannot be decoded ({error})"),
            "try again; if it happens again, update the older of the two programs",
        )
    })?;
    let grey = picture.into_luma8();
    let [width, height] = [grey.width(), grey.height()].map(|side| side as usize);
    Ok(background::Picture { width, height, samples: grey.into_raw() })
}

fn fetched(link: &mut BoxLink, reduction: u8) -> Result<Vec<u8>, BadInput> {
    let failed = |link: &BoxLink, found: &str| {
        BadInput::whole(link.place(), found, "try again; `plumb aim` shows what its camera sees")
    };
    for _ in 0..TRIES {
        let Some(picture) = announced(link, reduction)? else { continue };
        if picture.bytes > BYTES_MAX {
            return Err(failed(link, "the box announces a picture that is too large"));
        }
        let file = link.fetch(Document::Picture(picture.number), picture.bytes as usize)?;
        if document_crc(&file) == picture.crc {
            return Ok(file);
        }
    }
    Err(failed(link, "the box sends no picture"))
}

/// Asks for a picture; `None` where it is refused or not announced in time.
fn announced(link: &mut BoxLink, reduction: u8) -> Result<Option<Picture>, BadInput> {
    let asked = link.send(Action::TakePicture { reduction });
    let answer = link.messages(Instant::now() + ANNOUNCED_WITHIN, |message| match message {
        Message::Picture(picture) if picture.reduction == reduction => Some(Some(*picture)),
        Message::Reply(Reply { id, outcome: ReplyOutcome::Refused { .. } }) if *id == asked => {
            Some(None)
        }
        _ => None,
    })?;
    Ok(answer.flatten())
}
