//! A box in set-up mode: its camera's picture, photographs of the board, the exposure.

use std::io::Cursor;
use std::sync::Arc;
use std::time::{Duration, Instant};

use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, GrayImage};
use plumbline::packet::LinkKind;
use plumbline_bedside::aim::{
    BestFocus, Follower, Reading, Session, Taken, find_exposure, store_exposure,
};
use plumbline_bedside::{bounds, draw};
use plumbline_files::BadInput;
use plumbline_stream::link::BoxLink;

use super::can::Stage;
use super::orders::{Envelope, Order, Refusal};
use super::{Job, Next, SHOW_EVERY, Shared, Worker};
use crate::wire::{Aim, AimEnough, AimExpose, AimTarget, ExposureSearch, Problem, Tone};
use crate::words::on_page;

/// A new picture is asked for at most this often.
const PICTURE_EVERY: Duration = Duration::from_millis(200);

/// Reduction of the pictures over a network, and over a serial line.
const REDUCTION_UDP: u8 = 2;
const REDUCTION_SERIAL: u8 = 4;

/// Set-up mode ends this long after the last order, so that no page left open keeps a ward in view.
const ENDS_AFTER: Duration = Duration::from_secs(30 * 60);

/// How good the pictures are, of 100: corners can be seen, and a slow network carries them.
const JPEG_QUALITY: u8 = 80;

/// The steps of a search for an exposure that are shown.
const TRIED_MAX: usize = 20;

/// What is known of one time in set-up mode.
struct Aiming {
    session: Session,
    best: BestFocus,
    reduction: u8,
    picture_at: Instant,
    ends_at: Instant,
    /// A photograph of the board is under way, in place of a picture.
    takes_photograph: bool,
    picture: u32,
    picture_px: [u32; 2],
    exposure: Option<ExposureSearch>,
}

/// What ends set-up mode.
enum Over {
    Ended,
    Deliver(crate::wire::CalibrationDeliver),
    Expose(AimExpose),
}

impl Worker {
    /// Brings the box into set-up mode, and stays there until that is over. `None`: the link has to be
    /// opened anew.
    pub(super) fn aim(
        &mut self,
        link: BoxLink,
        order: Order,
    ) -> Result<Option<(BoxLink, Next)>, BadInput> {
        let begin = match order {
            Order::AimBegin(begin) => begin,
            _ => crate::wire::AimBegin::default(),
        };
        let kind = link.kind();
        let usual = if kind == LinkKind::Serial { REDUCTION_SERIAL } else { REDUCTION_UDP };
        let shared = Arc::clone(&self.shared);
        let session = match Session::begin(link, begin.force, &mut |told| shared.told(told)) {
            Ok(session) => session,
            Err(error) => {
                self.shared.update(|state| state.failed = Some(error.into()));
                return Ok(None);
            }
        };
        self.enter(Stage::Aiming);
        let now = Instant::now();
        let mut aiming = Aiming {
            session,
            best: BestFocus::default(),
            reduction: begin.reduction.unwrap_or(usual).clamp(1, 16),
            picture_at: now,
            ends_at: now + ENDS_AFTER,
            takes_photograph: false,
            picture: 0,
            picture_px: [0, 0],
            exposure: None,
        };
        loop {
            let over = match self.keep_aiming(&mut aiming) {
                Ok(over) => over,
                Err(error) => {
                    self.shared.forget_picture();
                    let _ = aiming.session.end();
                    return Err(error);
                }
            };
            match over {
                Over::Expose(asked) => {
                    let Some(again) = self.expose(aiming, &asked)? else { return Ok(None) };
                    aiming = again;
                    self.enter(Stage::Aiming);
                }
                Over::Ended | Over::Deliver(_) => {
                    self.shared.forget_picture();
                    if let Some(set) = &mut self.photographs {
                        set.pause();
                    }
                    self.show_photographs(None);
                    let next = match over {
                        Over::Deliver(deliver) => Next::Job(Job::Deliver(deliver)),
                        _ => Next::Watch,
                    };
                    return match aiming.session.end() {
                        Ok(link) => Ok(Some((link, next))),
                        Err(error) => {
                            self.shared.notice(true, error.to_string());
                            Ok(None)
                        }
                    };
                }
            }
        }
    }

    /// Aims until something ends it.
    fn keep_aiming(&mut self, aiming: &mut Aiming) -> Result<Over, BadInput> {
        while !self.is_over() {
            let now = Instant::now();
            if now >= aiming.ends_at {
                self.shared.notice(true, "set-up mode has ended by itself");
                break;
            }
            self.ask_for_picture(aiming, now);
            if let Some(taken) = aiming.session.turn()? {
                self.take_picture(aiming, &taken)?;
            }
            self.poll_fit();
            while let Some(Envelope { order, answer }) = self.next_order() {
                aiming.ends_at = now + ENDS_AFTER;
                let (result, over) = self.order_while_aiming(order);
                let is_over = over.is_some() && result.is_ok();
                let _ = answer.send(result);
                if let Some(over) = over.filter(|_| is_over) {
                    return Ok(over);
                }
            }
            if now >= self.show_at {
                self.show_at = now + SHOW_EVERY;
                self.show_aim(aiming);
                let progress = aiming.session.progress();
                let share = progress.map(|it| it.there as f64 / it.total.max(1) as f64);
                let arriving = aiming.takes_photograph.then(|| share.unwrap_or(0.0));
                self.show_photographs(arriving.map(|it| (20.0 * it).round() / 20.0));
                self.show_can();
            }
        }
        Ok(Over::Ended)
    }

    /// Carries out an order, or says what ends set-up mode.
    fn order_while_aiming(&mut self, order: Order) -> (Result<(), Refusal>, Option<Over>) {
        let now = Instant::now();
        self.shared.update(|state| state.failed = None);
        let result = match (order, &mut self.photographs) {
            (Order::AimEnd, _) => return (Ok(()), Some(Over::Ended)),
            (Order::CalibrationDeliver(deliver), _) => {
                return (Ok(()), Some(Over::Deliver(deliver)));
            }
            (Order::AimExpose(asked), _) => return (Ok(()), Some(Over::Expose(asked))),
            (Order::PhotographsBegin(begin), _) => self.begin_photographs(&begin),
            (Order::PhotographsTake, Some(set)) => {
                set.want();
                Ok(())
            }
            (Order::PhotographsAuto(asked), Some(set)) => set.take_by_itself(&asked, now),
            (Order::PhotographsPause, Some(set)) => {
                set.pause();
                Ok(())
            }
            (Order::PhotographsRemove(remove), _) => self.remove_photograph(&remove),
            (Order::CalibrationFit, _) => self.begin_fit(),
            (other, _) => Err(super::can::not_now(&self.shared.state(), other.needs())),
        };
        self.show_can();
        (result, None)
    }

    /// Asks for the next picture: a photograph goes before one for the page.
    fn ask_for_picture(&mut self, aiming: &mut Aiming, now: Instant) {
        let is_due = self.photographs.as_ref().is_some_and(|set| set.is_due(now));
        if is_due && !aiming.takes_photograph {
            // It replaces a picture that is under way.
            aiming.takes_photograph = true;
            aiming.session.take(1);
            self.shared.hub.tone(&self.shared.id(), Tone::Shutter, now);
        } else if aiming.session.is_free() && now >= aiming.picture_at {
            aiming.takes_photograph = false;
            aiming.picture_at = now + PICTURE_EVERY;
            aiming.session.take(aiming.reduction);
        }
    }

    /// Keeps a photograph, and shows a picture.
    fn take_picture(&mut self, aiming: &mut Aiming, taken: &Taken) -> Result<(), BadInput> {
        let picture = taken.decoded(aiming.session.place())?;
        let config = aiming.session.config();
        if std::mem::take(&mut aiming.takes_photograph)
            && let Some(set) = &mut self.photographs
        {
            if let Err(error) = set.keep(&taken.file) {
                set.pause();
                self.shared.update(|state| state.failed = Some(error.into()));
            }
            self.show_photographs(None);
        }
        let wanted = u32::from(config.lens.width_px) / u32::from(aiming.reduction);
        let picture = reduced(picture, wanted.max(1));
        let picture = DynamicImage::ImageLuma8(picture).into_rgb8();
        let picture = match &taken.pose {
            Some(pose) => draw::annotate(picture, config, draw::drawn(pose, config)),
            None => picture,
        };
        let mut file = Cursor::new(Vec::new());
        let encoder = JpegEncoder::new_with_quality(&mut file, JPEG_QUALITY);
        picture
            .write_with_encoder(encoder)
            .map_err(|error| BadInput::whole("the picture", error, "aim with another reduction"))?;
        aiming.picture_px = picture.dimensions().into();
        aiming.picture = self.shared.show_picture(file.into_inner());
        self.show_aim(aiming);
        Ok(())
    }

    fn show_aim(&self, aiming: &mut Aiming) {
        let Aiming { session, best, .. } = aiming;
        let reading = session.reading(best);
        let silence = session.silence();
        let photographs = self.photographs.as_ref().map(|set| set.next().to_owned());
        let advice = match (&silence, session.without_frames(), &reading) {
            (Some(silence), ..) => Some(plumbline_bedside::aim::silence_words(*silence)),
            (None, Some(why), _) => Some(why.to_owned()),
            (None, None, None) => Some("no numbers yet".to_owned()),
            (None, None, Some(reading)) => reading.next(),
        };
        let is_good = advice.is_none();
        let next = advice.or(photographs).map_or_else(
            || "Focus, light and size are as they should be.".to_owned(),
            |words| sentence(&on_page(&words)),
        );
        let (exposure_us, gain) =
            session.view().map_or((None, None), |view| (view.exposure_us, view.gain));
        let silent_since = silence.map(|lasts| self.shared.ms(Instant::now() - lasts).round());
        let aim = Aim {
            picture: aiming.picture,
            picture_px: aiming.picture_px,
            next,
            is_good,
            frame: reading.as_ref().map(|it| it.frame.text.clone()).unwrap_or_default(),
            frame_advice: reading
                .as_ref()
                .map(|it| all_on_page(&it.frame.advice))
                .unwrap_or_default(),
            targets: reading.as_ref().map(targets).unwrap_or_default(),
            enough: AimEnough {
                focus: bounds::FOCUS_MIN,
                light: bounds::LIGHT_MIN,
                contrast: bounds::CONTRAST_MIN,
                pitch_px: bounds::PITCH_PX_MIN,
            },
            silent_since_at_ms: silent_since,
            exposure_us,
            gain,
            exposure: aiming.exposure.clone(),
            ends_at_ms: self.shared.ms(aiming.ends_at).round(),
        };
        self.shared.update(|state| state.aim = Some(aim));
    }

    /// Seeks the exposure; `None`: the link has to be opened anew.
    fn expose(
        &mut self,
        mut aiming: Aiming,
        asked: &AimExpose,
    ) -> Result<Option<Aiming>, BadInput> {
        aiming.exposure = Some(ExposureSearch { is_running: true, tried: Vec::new(), found: None });
        self.show_aim(&mut aiming);
        self.enter(Stage::Exposing);
        let shared = Arc::clone(&self.shared);
        let found = {
            let mut follower = Following { worker: self, shared: &shared, is_over: false };
            find_exposure(&mut aiming.session, &mut follower)
        };
        let search = shared.state().aim.and_then(|it| it.exposure);
        let tried = search.map(|it| it.tried).unwrap_or_default();
        let mut search = ExposureSearch { is_running: false, tried, found: None };
        let setting = match found {
            Ok(setting) => setting,
            Err(error) => {
                shared.update(|state| state.failed = Some(error.into()));
                None
            }
        };
        search.found = setting.map(|it| it.to_string());
        aiming.exposure = Some(search);
        self.show_aim(&mut aiming);
        let (true, Some(setting)) = (asked.store, setting) else { return Ok(Some(aiming)) };
        // The box is given its exposure outside set-up mode, restarts, and is aimed on.
        let met = aiming.session.hello().clone();
        self.enter(Stage::Delivering);
        let mut tell = |told| shared.told(told);
        let stored = aiming.session.end().and_then(|mut link| {
            store_exposure(&mut link, &met, setting, &mut tell).map(|()| link)
        });
        let session = stored.and_then(|link| Session::begin(link, false, &mut tell));
        match session {
            Ok(session) => Ok(Some(Aiming { session, takes_photograph: false, ..aiming })),
            Err(error) => {
                shared.update(|state| state.failed = Some(error.into()));
                Ok(None)
            }
        }
    }
}

fn all_on_page(texts: &[String]) -> Vec<String> {
    texts.iter().map(|it| on_page(it)).collect()
}

/// A sentence of a piece of advice.
fn sentence(words: &str) -> String {
    let mut letters = words.chars();
    let first = letters.next().map(|it| it.to_uppercase().to_string()).unwrap_or_default();
    let end = if words.ends_with(['.', '!', '?']) { "" } else { "." };
    format!("{first}{}{end}", letters.as_str())
}

fn targets(reading: &Reading) -> Vec<AimTarget> {
    let target = |it: &plumbline_bedside::aim::TargetReading| AimTarget {
        name: it.name.clone(),
        state: it.state.clone(),
        is_found: it.is_found,
        focus: it.figures.map(|it| it.focus),
        focus_best: it.figures.map(|it| it.focus_best),
        light: it.figures.map(|it| it.light),
        contrast: it.figures.map(|it| it.contrast),
        pitch_px: it.figures.map(|it| it.pitch_px),
        numbers: it.numbers.clone(),
        advice: all_on_page(&it.advice),
    };
    reading.targets.iter().map(target).collect()
}

/// No wider than this.
fn reduced(picture: GrayImage, width: u32) -> GrayImage {
    if picture.width() <= width {
        return picture;
    }
    let height =
        (u64::from(picture.height()) * u64::from(width) / u64::from(picture.width())) as u32;
    image::imageops::thumbnail(&picture, width, height.max(1))
}

/// A search for an exposure, which a page follows and may end.
struct Following<'a> {
    worker: &'a mut Worker,
    shared: &'a Shared,
    is_over: bool,
}

impl Follower for Following<'_> {
    fn say(&mut self, text: &str) -> Result<(), BadInput> {
        self.shared.update(|state| {
            if let Some(search) = state.aim.as_mut().and_then(|it| it.exposure.as_mut()) {
                if search.tried.len() == TRIED_MAX {
                    search.tried.remove(0);
                }
                search.tried.push(on_page(text));
            }
        });
        Ok(())
    }

    fn is_over(&mut self) -> bool {
        while let Some(Envelope { order, answer }) = self.worker.next_order() {
            let result = match order {
                Order::AimCancel => {
                    self.is_over = true;
                    Ok(())
                }
                _ => Err(Refusal::bad(Problem::new("the order", "it does not end the search", ""))),
            };
            let _ = answer.send(result);
        }
        self.is_over || self.worker.is_over()
    }
}
