//! The live view of a reception.

use plumbline::packet::{AnatomicalPoint, Message, PosePacket};
use plumbline_bedside::recording::Zeroing;
use plumbline_stream::fixture::{self, take};

use super::*;

/// Without a terminal.
fn screen(criteria: Option<Criteria>) -> Screen {
    Screen::new("UDP", &["trials/p01".to_owned()], criteria, true)
}

fn upper(sequence: u32, ap_mm: f32) -> PosePacket {
    PosePacket {
        upper_trunk: Some(AnatomicalPoint { ap_mm, ml_mm: 0.0, si_mm: 0.0 }),
        ..fixture::pose_packet(sequence)
    }
}

#[test]
fn without_a_terminal_all_of_it_is_one_line() {
    // It takes long to make.
    let hello = Message::Hello(fixture::hello(&fixture::config()));
    let begun = Instant::now();
    let mut course = Course::new(begun, Some(Duration::from_secs(60)), Zeroing::Start);
    course.frame(begun);
    let mut screen = screen(Some(Criteria::default()));
    let mut receiver = Receiver::<Vec<u8>>::new(None);
    take(&mut receiver, begun, &[hello, Message::Pose(upper(0, 1.0))]);
    screen.show(&mut receiver, &mut course, || None);
    let line = shown::line(&screen.live.seen(&receiver, &course, begun));
    assert_eq!(
        line,
        "0 s since the first frame, 60 s to go of 60 s; WAIT: the trial is judged 3 s after its \
         first frame; 0.0 Hz, 0 lost (0.0 %), 1 frame, latency 1.2 ms, 0 late, 0 corrupt; \
         upper trunk  AP   +0.0  ML   +0.0  SI   +0.0 mm; \
         lower trunk  seen; the box has no scene, so no AP, ML and SI"
    );
    assert!(!line.contains('\n'));
}
