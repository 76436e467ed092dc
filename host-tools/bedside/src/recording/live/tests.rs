//! The live view of a reception.

use plumbline::packet::{AnatomicalPoint, Message, PosePacket};
use plumbline_stream::fixture::{self, take};
use plumbline_trial::mark::{Mark, Source};

use super::super::course::Zeroing;
use super::*;

fn live(criteria: Option<Criteria>) -> Live {
    Live::new(criteria, Instant::now())
}

fn upper(sequence: u32, ap_mm: f32) -> PosePacket {
    PosePacket {
        upper_trunk: Some(AnatomicalPoint { ap_mm, ml_mm: 0.0, si_mm: 0.0 }),
        ..fixture::pose_packet(sequence)
    }
}

/// A mark called zero takes the place of an earlier one, and the range is of the time since.
#[test]
fn movement_counts_from_the_mark_that_is_t_0() {
    let begun = Instant::now();
    let mut course = Course::new(begun, None, Zeroing::Mark);
    let mut live = live(Some(Criteria::default()));
    let mut receiver = Receiver::<Vec<u8>>::new(None);
    take(&mut receiver, begun, &[Message::Hello(fixture::hello(&fixture::config()))]);
    for sequence in 0..300 {
        let label = match sequence {
            90 => Some("turn"),
            200 => Some("zero"),
            _ => None,
        };
        if let Some(label) = label {
            course.mark(&Mark::new(Source::Key, label), begun.elapsed().as_secs_f64());
        }
        // It moves by 40 mm between the two marks.
        let ap_mm = if sequence < 120 { 10.0 } else { 50.0 };
        take(&mut receiver, Instant::now(), &[Message::Pose(upper(sequence, ap_mm))]);
        live.take(&receiver, &course, Instant::now());
        let seen = live.seen(&receiver, &course, Instant::now());
        let [ap, ..] = seen.movement[0].along.unwrap();
        let range_mm = ap.range_mm.map(|[low_mm, high_mm]| high_mm - low_mm);
        let wanted = match sequence {
            0..90 => (0.0, None, "from the last second"),
            90..120 => (0.0, Some(0.0), "since t = 0"),
            120..200 => (40.0, Some(40.0), "since t = 0"),
            _ => (0.0, Some(0.0), "since t = 0"),
        };
        assert_eq!((ap.now_mm, range_mm, seen.since), wanted, "{sequence}");
    }
}

#[test]
fn a_box_that_falls_silent_is_seen_before_any_packet_tells() {
    let begun = Instant::now();
    let mut course = Course::new(begun, None, Zeroing::Start);
    let mut live = live(Some(Criteria::default()));
    let mut receiver = Receiver::<Vec<u8>>::new(None);
    let hello = Message::Hello(fixture::hello(&fixture::config()));
    take(&mut receiver, begun, &[hello, Message::Pose(upper(0, 1.0))]);
    course.frame(begun);
    course.judged(Default::default());
    live.take(&receiver, &course, Instant::now());
    let word_at = |after_s: f64| {
        let now = begun + Duration::from_secs_f64(after_s);
        let Judgement { word, reasons } = live.judgement(&receiver, &course, now);
        (word.unwrap().text(), reasons.into_iter().map(|why| why.words).collect::<String>())
    };
    assert_eq!(word_at(0.5), ("GOOD", String::new()));
    assert_eq!(word_at(4.5), ("LOOK", "the box is no longer heard, for 4 s".to_owned()));
    assert_eq!(word_at(11.5), ("STOP", "the box is no longer heard, for 11 s".to_owned()));
}

#[test]
fn what_is_not_recorded_has_no_verdict() {
    let course = Course::new(Instant::now(), None, Zeroing::Start);
    let receiver = Receiver::<Vec<u8>>::new(None);
    let judged = live(None).judgement(&receiver, &course, Instant::now());
    assert_eq!(judged.word, None);
    assert!(judged.reasons[0].words.starts_with("not recorded"), "{judged:?}");
}
