//! The poses for other programs, while they are received; and marks from the Lab Streaming Layer.

use std::time::Instant;

use plumbline_files::BadInput;
use plumbline_publish::lsl::Lsl;
use plumbline_publish::lsl::markers::Markers;
use plumbline_publish::lsl::outlet::MARKS_SUFFIX;
use plumbline_publish::{MarkFeed, Publisher, Ways};
use plumbline_stream::reception::Tap;
use plumbline_trial::mark::{Mark, MarkSender, Source};

/// The streams in use.
pub(super) struct Streams(Publisher);

impl Streams {
    /// Opens what is asked for, and says so unless `is_quiet`. `begun` is the zero of the recording's
    /// times; without a recording, `asks`, the streams ask the box for its clock.
    ///
    /// # Errors
    /// When an address cannot be used.
    pub(super) fn open(
        ways: &Ways,
        lsl: Option<Lsl>,
        begun: Instant,
        asks: bool,
        is_quiet: bool,
    ) -> Result<Option<Self>, BadInput> {
        if ways.is_none() {
            return Ok(None);
        }
        for warning in ways.warnings() {
            eprintln!("warning: {warning}");
        }
        let mut publisher = Publisher::new(begun, asks);
        for opened in ways.open(&mut publisher, lsl)? {
            if !is_quiet {
                eprintln!("{opened}");
            }
        }
        Ok(Some(Self(publisher)))
    }

    /// What follows the reception.
    pub(super) fn tap(&mut self) -> &mut dyn Tap {
        &mut self.0
    }

    /// Through which the recording tells its marks.
    pub(super) fn mark_feed(&self) -> MarkFeed {
        self.0.mark_feed()
    }

    /// Ends them; what came of them, in words.
    pub(super) fn finish(self) -> Vec<String> {
        self.0.finish()
    }
}

/// Listens to the markers that are named.
///
/// # Errors
/// When no stream can have that name.
pub(super) fn markers(
    arguments: &super::Arguments,
    lsl: Option<Lsl>,
    sender: &MarkSender,
) -> Result<Option<Markers>, BadInput> {
    let (Some(name), Some(lsl)) = (&arguments.mark_lsl, lsl) else { return Ok(None) };
    if arguments.streams.ways().lsl.is_some_and(|own| *name == format!("{own}{MARKS_SUFFIX}")) {
        return Err(BadInput::whole(
            format!("--mark-lsl {name}"),
            "is the stream in which the marks of this recording are published",
            "name another program's stream",
        ));
    }
    let sender = sender.clone();
    let take = move |at, label: &str| sender.send(at, Mark::new(Source::Lsl, label));
    Markers::of(lsl, name, take).map(Some)
}
