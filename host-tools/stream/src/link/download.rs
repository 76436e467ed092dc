//! A document from a box, piece by piece, beside whatever else goes over the link.
//!
//! It does no input or output: it is told of the messages that come, and says what to ask for.
//! So its user can go on listening, and keep set-up mode alive, while a picture comes over a
//! slow line.

use std::ops::Range;
use std::time::{Duration, Instant};

use plumbline::packet::{Action, Document, Message, Refusal, ReplyOutcome};
use plumbline_files::BadInput;

use super::{ANSWER_WITHIN, BARREN_MAX, BoxLink};

/// Parts that have been asked for come without a pause as long as this.
const PART_WITHIN: Duration = Duration::from_millis(500);

/// A document of known length under way.
pub struct Download {
    document: Document,
    file: Vec<u8>,
    missing: Missing,
    request: Option<Request>,
    /// Requests in a row that have brought nothing.
    barren: usize,
}

/// What was asked for last.
struct Request {
    id: u16,
    range: Range<usize>,
    /// Bytes that were missing then.
    missing: usize,
    /// Nothing more of it will come after this time.
    quiet_at: Instant,
}

/// Why a download cannot go on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Stopped {
    /// The box refuses, and says why.
    Refused(Refusal, String),
    /// Requests bring nothing.
    Barren,
}

impl Download {
    /// Before anything of it was asked for.
    #[must_use]
    pub fn new(document: Document, bytes: usize) -> Self {
        let missing = Missing::all(bytes);
        Self { document, file: vec![0; bytes], missing, request: None, barren: 0 }
    }

    /// The request that is due, if any. The number under which it is sent must be passed to
    /// [`asked`](Self::asked).
    ///
    /// # Errors
    /// When requests bring nothing.
    pub fn due(&mut self, now: Instant) -> Result<Option<Action>, Stopped> {
        let Some(first) = self.missing.first() else { return Ok(None) };
        if let Some(request) = &self.request {
            if first.start < request.range.end && now < request.quiet_at {
                return Ok(None);
            }
            let is_barren = self.missing.bytes() == request.missing;
            self.barren = if is_barren { self.barren + 1 } else { 0 };
            if self.barren == BARREN_MAX {
                return Err(Stopped::Barren);
            }
        }
        let (offset, bytes) = (first.start as u32, first.len() as u32);
        Ok(Some(Action::SendParts { document: self.document, offset, bytes }))
    }

    /// What was [`due`](Self::due) has been asked for under this number.
    pub fn asked(&mut self, id: u16, now: Instant) {
        let Some(range) = self.missing.first() else { return };
        let missing = self.missing.bytes();
        self.request = Some(Request { id, range, missing, quiet_at: now + ANSWER_WITHIN });
    }

    /// Takes what belongs to it.
    ///
    /// # Errors
    /// When the message is the box's refusal.
    pub fn take(&mut self, message: &Message, now: Instant) -> Result<(), Stopped> {
        match message {
            Message::Part(part) if part.document == self.document => {
                let start = part.offset as usize;
                let place = start..start + part.bytes.len();
                if let Some(room) = self.file.get_mut(place.clone()) {
                    room.copy_from_slice(&part.bytes);
                    self.missing.remove(&place);
                    if let Some(request) = &mut self.request {
                        request.quiet_at = now + PART_WITHIN;
                    }
                }
            }
            Message::Reply(reply) if self.request.as_ref().is_some_and(|it| it.id == reply.id) => {
                if let ReplyOutcome::Refused { refusal, reason } = &reply.outcome {
                    return Err(Stopped::Refused(*refusal, reason.to_string()));
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Bytes that are there.
    #[must_use]
    pub fn there(&self) -> usize {
        self.file.len() - self.missing.bytes()
    }

    /// All bytes.
    #[must_use]
    pub fn total(&self) -> usize {
        self.file.len()
    }

    /// The document, once all of it is there.
    #[must_use]
    pub fn file(&self) -> Option<&[u8]> {
        self.missing.first().is_none().then_some(&self.file)
    }
}

/// Which bytes of a document are not there yet, in order.
struct Missing(Vec<Range<usize>>);

impl Missing {
    fn all(bytes: usize) -> Self {
        let whole = 0..bytes;
        Self(std::iter::once(whole).filter(|range| !range.is_empty()).collect())
    }

    fn first(&self) -> Option<Range<usize>> {
        self.0.first().cloned()
    }

    fn bytes(&self) -> usize {
        self.0.iter().map(ExactSizeIterator::len).sum()
    }

    fn remove(&mut self, there: &Range<usize>) {
        let cut = |range: &Range<usize>| {
            let before = range.start..range.end.min(there.start);
            let after = range.start.max(there.end)..range.end;
            [before, after].into_iter().filter(|rest| !rest.is_empty())
        };
        self.0 = self.0.iter().flat_map(cut).collect();
    }
}

impl BoxLink {
    /// A download that cannot go on as an error for the user.
    #[must_use]
    pub fn stopped(&self, stopped: &Stopped) -> BadInput {
        match stopped {
            Stopped::Refused(refusal, reason) => self.refused("to send it", *refusal, reason),
            Stopped::Barren => self.no_answer("a request for a part of a document"),
        }
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::{Part, Reply};

    use super::*;

    const DOCUMENT: Document = Document::Picture(3);

    fn part(offset: u32, bytes: usize) -> Message {
        let bytes = (0..bytes).map(|index| offset as u8 + index as u8).collect();
        Message::Part(Part { document: DOCUMENT, offset, bytes })
    }

    fn due(download: &mut Download, now: Instant) -> Option<(u32, u32)> {
        match download.due(now).unwrap()? {
            Action::SendParts { offset, bytes, .. } => Some((offset, bytes)),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_is_lost_on_the_way_is_asked_for_again() {
        let mut now = Instant::now();
        let mut download = Download::new(DOCUMENT, 100);
        assert_eq!(due(&mut download, now), Some((0, 100)));
        download.asked(1, now);
        for (offset, bytes) in [(0, 30), (60, 20), (60, 20), (80, 20), (95, 20)] {
            download.take(&part(offset, bytes), now).unwrap();
        }
        assert_eq!((download.there(), download.total()), (70, 100));
        assert_eq!(due(&mut download, now), None, "more may come");
        now += PART_WITHIN;
        assert_eq!(due(&mut download, now), Some((30, 30)));
        download.asked(2, now);
        assert_eq!(download.file(), None);
        download.take(&part(30, 30), now).unwrap();
        assert_eq!(due(&mut download, now), None);
        assert_eq!(download.file().unwrap(), (0..100).collect::<Vec<u8>>());
    }

    #[test]
    fn requests_that_bring_nothing_or_are_refused_end_it() {
        let mut now = Instant::now();
        let mut download = Download::new(DOCUMENT, 100);
        for id in 0..BARREN_MAX as u16 {
            assert_eq!(due(&mut download, now), Some((0, 100)));
            download.asked(id, now);
            now += ANSWER_WITHIN + Duration::from_millis(1);
        }
        assert_eq!(download.due(now), Err(Stopped::Barren));

        let outcome = ReplyOutcome::Refused {
            refusal: Refusal::NotAiming,
            reason: "why".try_into().unwrap(),
        };
        let refusal = |id| Message::Reply(Reply { id, outcome: outcome.clone() });
        assert_eq!(download.take(&refusal(99), now), Ok(()), "to another question");
        let last = BARREN_MAX as u16 - 1;
        let stopped = Stopped::Refused(Refusal::NotAiming, "why".into());
        assert_eq!(download.take(&refusal(last), now), Err(stopped));
    }

    #[test]
    fn what_is_missing_shrinks_by_what_is_there() {
        let mut missing = Missing::all(100);
        for there in [20..30, 25..40, 90..120, 0..10, 10..10] {
            missing.remove(&there);
        }
        assert_eq!(missing.0, [10..20, 40..90]);
        assert_eq!((missing.bytes(), missing.first()), (60, Some(10..20)));
        missing.remove(&(0..100));
        assert_eq!((missing.bytes(), missing.first()), (0, None));
        assert_eq!(Missing::all(0).first(), None);
    }
}
