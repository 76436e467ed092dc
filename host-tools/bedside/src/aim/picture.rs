//! A picture on its way from the box: asked for, announced with its frame, and fetched in parts.

use std::time::{Duration, Instant};

use image::GrayImage;
use plumbline::packet::{
    Action, Document, Message, Picture, PosePacket, Refusal, Reply, ReplyOutcome, document_crc,
};
use plumbline_files::BadInput;
use plumbline_stream::link::{BoxLink, Download, Stopped};

/// A picture is announced with the next frame; otherwise the request was lost. A camera that
/// was reopened takes a second for its first frame, and a whole frame some time to become a file.
const PICTURE_WITHIN: Duration = Duration::from_secs(3);

/// A picture that is refused or damaged this often in a row will not come.
const FAILURES_MAX: usize = 5;

/// The pose of a picture's frame is waited for this long.
const POSE_WITHIN: Duration = Duration::from_millis(250);

/// A picture larger than this is an error.
const PICTURE_BYTES_MAX: u32 = 64 << 20;

/// A complete picture.
#[derive(Debug)]
pub struct Taken {
    /// Its file.
    pub file: Vec<u8>,
    /// What was found in its frame, if that came.
    pub pose: Option<PosePacket>,
}

impl Taken {
    /// The picture, in grey; `place` names the box in errors.
    ///
    /// # Errors
    /// When it cannot be decoded.
    pub fn decoded(&self, place: &str) -> Result<GrayImage, BadInput> {
        let picture = image::load_from_memory(&self.file).map_err(|error| {
            BadInput::whole(
                place,
                format!("the box's picture cannot be decoded ({error})"),
                "try again; if it happens again, update the older of the two programs",
            )
        })?;
        Ok(picture.into_luma8())
    }
}

/// How far a picture has come.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    /// Bytes that have come.
    pub there: usize,
    /// All of its bytes.
    pub total: usize,
    /// How long the rest takes, once that can be told.
    pub left: Option<Duration>,
}

/// The picture under way, if any.
#[derive(Default)]
pub(crate) struct Arriving {
    stage: Stage,
    /// The failures since the last complete picture.
    failures: usize,
}

#[derive(Default)]
enum Stage {
    #[default]
    Nothing,
    Asked {
        reduction: u8,
        id: u16,
        at: Instant,
    },
    Coming(Box<Coming>),
}

struct Coming {
    picture: Picture,
    download: Download,
    since: Instant,
    pose: Option<PosePacket>,
    /// When all of it had come.
    complete: Option<Instant>,
}

impl Arriving {
    /// Nothing is under way.
    pub fn is_nothing(&self) -> bool {
        matches!(self.stage, Stage::Nothing)
    }

    /// Asks for a picture, in place of one that was under way.
    pub fn take(&mut self, link: &mut BoxLink, reduction: u8) {
        let id = link.send(Action::TakePicture { reduction });
        self.stage = Stage::Asked { reduction, id, at: Instant::now() };
    }

    /// The box has restarted: it does not know any more which picture it was sending.
    pub fn take_again(&mut self, link: &mut BoxLink) {
        if let Stage::Coming(coming) = &self.stage {
            self.take(link, coming.picture.reduction);
        }
    }

    /// How far it has come.
    pub fn progress(&self) -> Option<Progress> {
        let Stage::Coming(coming) = &self.stage else { return None };
        let (there, total) = (coming.download.there(), coming.download.total());
        let elapsed = coming.since.elapsed();
        let left = (there > 0)
            .then(|| elapsed.mul_f64((total - there) as f64 / there as f64))
            .filter(|_| elapsed >= Duration::from_secs(1));
        Some(Progress { there, total, left })
    }

    /// Asks for what is due: the picture once more, or its next part.
    ///
    /// # Errors
    /// Why it does not come.
    pub fn ask(&mut self, link: &mut BoxLink, now: Instant) -> Result<(), Stopped> {
        match &mut self.stage {
            Stage::Nothing => {}
            Stage::Asked { reduction, at, .. } => {
                let reduction = *reduction;
                if now - *at >= PICTURE_WITHIN {
                    self.take(link, reduction);
                }
            }
            Stage::Coming(coming) => {
                if let Some(action) = coming.download.due(now)? {
                    let id = link.send(action);
                    coming.download.asked(id, now);
                }
            }
        }
        Ok(())
    }

    /// Takes what a message holds of it: a part, or a refusal.
    ///
    /// # Errors
    /// Why it does not come.
    pub fn message(&mut self, message: &Message) -> Result<(), Stopped> {
        match (&mut self.stage, message) {
            (Stage::Coming(coming), message) => coming.download.take(message, Instant::now()),
            (
                Stage::Asked { id, .. },
                Message::Reply(Reply {
                    id: of,
                    outcome: ReplyOutcome::Refused { refusal, reason },
                }),
            ) if id == of => Err(Stopped::Refused(*refusal, reason.to_string())),
            // Everything else is asked for again anyway.
            _ => Ok(()),
        }
    }

    /// Word of a picture, and what was found in its frame if that is known already.
    ///
    /// # Errors
    /// When it is larger than any.
    pub fn word_of(
        &mut self,
        picture: Picture,
        pose: Option<&PosePacket>,
        place: &str,
    ) -> Result<(), BadInput> {
        let Stage::Asked { reduction, .. } = &self.stage else { return Ok(()) };
        if picture.reduction != *reduction {
            return Ok(());
        }
        if picture.bytes > PICTURE_BYTES_MAX {
            return Err(BadInput::whole(
                place,
                format!("the box announces a picture of {} bytes", picture.bytes),
                "update the older of the two programs",
            ));
        }
        self.stage = Stage::Coming(Box::new(Coming {
            picture,
            download: Download::new(Document::Picture(picture.number), picture.bytes as usize),
            since: Instant::now(),
            pose: pose.cloned(),
            complete: None,
        }));
        Ok(())
    }

    /// It does not come: asks for it again after the usual wait, because "busy" passes. Gives whether
    /// that is of no use.
    pub fn fail(&mut self, stopped: &Stopped) -> bool {
        self.failures += 1;
        let reduction = match &self.stage {
            Stage::Nothing => None,
            Stage::Asked { reduction, .. } => Some(*reduction),
            Stage::Coming(coming) => Some(coming.picture.reduction),
        };
        if let Some(reduction) = reduction {
            self.stage = Stage::Asked { reduction, id: 0, at: Instant::now() };
        }
        let is_final =
            matches!(stopped, Stopped::Refused(Refusal::NotSupported, _) | Stopped::Barren);
        is_final || self.failures == FAILURES_MAX
    }

    /// Hands it out when it and the pose of its frame are here, or that has been waited for.
    ///
    /// # Errors
    /// When it is damaged.
    pub fn complete<'p>(
        &mut self,
        pose_of: impl FnOnce(u32) -> Option<&'p PosePacket>,
    ) -> Result<Option<Taken>, Stopped> {
        let Stage::Coming(coming) = &mut self.stage else { return Ok(None) };
        let Some(file) = coming.download.file() else { return Ok(None) };
        if coming.pose.is_none() {
            coming.pose = pose_of(coming.picture.sequence).cloned();
        }
        let since = *coming.complete.get_or_insert_with(Instant::now);
        if coming.pose.is_none() && since.elapsed() < POSE_WITHIN {
            return Ok(None);
        }
        if document_crc(file) != coming.picture.crc {
            // Two programs that ask the same box for pictures mix them up.
            let reason = "a picture that does not match its checksum".to_owned();
            return Err(Stopped::Refused(Refusal::Busy, reason));
        }
        let taken = Taken { file: file.to_vec(), pose: coming.pose.take() };
        *self = Self::default();
        Ok(Some(taken))
    }
}
