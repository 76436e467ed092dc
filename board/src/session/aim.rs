//! Set-up mode: as long as a host keeps asking for it, pictures may leave the box, to that host
//! alone.
//!
//! It ends by itself when the host has been silent for the time it asked for, and at the
//! latest after [`TOTAL_MAX`]: a terminal left open must not keep a ward in view. At its end
//! the exposure that was being tried out is reset, and the last picture is deleted.

use std::time::{Duration, Instant};

use plumbline::packet::{AIM_S_MAX, Picture, document_crc};
use plumbline::seal::ListenerId;

use super::picture;
use crate::source::Frame;

/// The longest time in set-up mode without leaving it.
const TOTAL_MAX: Duration = Duration::from_secs(30 * 60);

/// Set-up mode and its pictures.
#[derive(Debug, Default)]
pub struct Aim {
    lease: Option<Lease>,
    /// The reduction of the picture to be made of the next frame.
    wanted: Option<u8>,
    last: Option<(Picture, Vec<u8>)>,
    pictures: u16,
}

#[derive(Debug)]
struct Lease {
    began: Instant,
    until: Instant,
    /// Who has asked for it.
    listener: ListenerId,
}

impl Aim {
    /// Enters set-up mode, or extends it, until `seconds` from now; 0 ends it.
    pub fn renew(&mut self, listener: ListenerId, seconds: u16, now: Instant) {
        if self.lease.is_none() {
            if seconds == 0 {
                return;
            }
            log::warn!("set-up mode: pictures may leave this box");
        }
        let began = self.lease.as_ref().map_or(now, |lease| lease.began);
        let asked = now + Duration::from_secs(seconds.min(AIM_S_MAX).into());
        self.lease = Some(Lease { began, until: asked.min(began + TOTAL_MAX), listener });
    }

    /// Leaves set-up mode if its time is over; returns whether it did.
    pub fn end_in_time(&mut self, now: Instant) -> bool {
        let is_over = self.lease.as_ref().is_some_and(|lease| lease.until <= now);
        if is_over {
            self.end();
        }
        is_over
    }

    /// Leaves set-up mode.
    pub fn end(&mut self) {
        if self.lease.is_some() {
            log::info!("set-up mode is over: no picture leaves this box");
            *self = Self { pictures: self.pictures, ..Self::default() };
        }
    }

    /// Whether pictures may leave for this listener.
    pub fn is_on(&self, listener: ListenerId) -> bool {
        self.lease.as_ref().is_some_and(|lease| lease.listener == listener)
    }

    /// Seconds left, rounded up; 0 outside set-up mode only, not in the instant between the
    /// end of its time and [`Self::end_in_time`].
    pub fn left_s(&self, now: Instant) -> u16 {
        let left = self.lease.as_ref().map(|lease| lease.until.saturating_duration_since(now));
        left.map_or(0, |left| left.as_secs_f64().ceil().max(1.0) as u16)
    }

    /// Asks for a picture of the next frame.
    pub fn want(&mut self, reduction: u8) {
        self.wanted = Some(reduction);
    }

    /// Makes the picture, if one was asked for; returns it with the listener to be told of it.
    pub fn take(&mut self, frame: &Frame<'_>, sequence: u32) -> Option<(ListenerId, Picture)> {
        let listener = self.lease.as_ref()?.listener;
        let reduction = self.wanted.take()?;
        let file = match picture::file(&frame.pixels, reduction) {
            Ok(file) => file,
            Err(error) => {
                log::error!("no picture: {error:#}");
                return None;
            }
        };
        self.pictures = self.pictures.wrapping_add(1);
        let picture = Picture {
            number: self.pictures,
            sequence,
            reduction,
            bytes: file.len() as u32,
            crc: document_crc(&file),
        };
        self.last = Some((picture, file));
        Some((listener, picture))
    }

    /// The file of the last picture, if that is its number.
    pub fn file(&self, number: u16) -> Option<&[u8]> {
        let (picture, file) = self.last.as_ref()?;
        (picture.number == number).then_some(file)
    }
}

#[cfg(test)]
mod tests {
    use plumbline::image::GreyImage;
    use plumbline::packet::MarkedInstant;

    use super::*;
    use crate::source::Pixels;
    use crate::test_listeners::listened_to;

    const GREY: [u8; 64 * 64] = [7; 64 * 64];

    fn frame() -> Frame<'static> {
        Frame {
            pixels: Pixels::Grey8(GreyImage::new(&GREY, 64, 64, 64).unwrap()),
            capture_time_ns: 1,
            instant: MarkedInstant::ExposureEnd,
            ready_at: Instant::now(),
            late: false,
        }
    }

    #[test]
    fn it_ends_when_the_host_is_silent_and_deletes_the_picture() {
        let start = Instant::now();
        let after = |seconds: f64| start + Duration::from_secs_f64(seconds);
        let (_, [one, other]) = listened_to();
        let mut aim = Aim::default();
        aim.want(1);
        assert!(aim.take(&frame(), 5).is_none() && !aim.is_on(one) && aim.left_s(start) == 0);
        aim.renew(one, 10, start);
        assert!(aim.is_on(one) && !aim.is_on(other));
        let (listener, picture) = aim.take(&frame(), 5).unwrap();
        assert_eq!((listener, picture.number, picture.sequence, picture.reduction), (one, 1, 5, 1));
        assert_eq!(document_crc(aim.file(1).unwrap()), picture.crc);
        // One picture for each request.
        assert!(aim.take(&frame(), 6).is_none() && aim.file(2).is_none());
        aim.renew(one, 10, after(8.0));
        assert!(!aim.end_in_time(after(17.9)));
        assert_eq!(aim.left_s(after(17.5)), 1);
        // Its time is over, but it has not been ended: 0 must mean that pictures are refused.
        assert!(aim.is_on(one) && aim.left_s(after(18.0)) == 1);
        assert!(aim.end_in_time(after(18.0)) && !aim.end_in_time(after(18.0)));
        assert!(!aim.is_on(one) && aim.file(1).is_none() && aim.left_s(after(18.0)) == 0);
    }

    #[test]
    fn its_total_time_and_the_time_of_one_request_are_bounded() {
        let start = Instant::now();
        let (_, [_, other]) = listened_to();
        let mut aim = Aim::default();
        aim.renew(other, u16::MAX, start);
        assert_eq!(aim.left_s(start), AIM_S_MAX);
        let mut now = start;
        while !aim.end_in_time(now) {
            aim.renew(other, AIM_S_MAX, now);
            now += Duration::from_secs(30);
        }
        assert_eq!(now - start, TOTAL_MAX);
        // A host can end it at once.
        aim.renew(other, 10, now);
        aim.renew(other, 0, now);
        assert!(aim.end_in_time(now));
    }
}
