//! Packets in frames, as on a serial line.

use super::super::*;
use super::*;

#[test]
fn the_longest_packet_gives_the_longest_frame() {
    for byte in [0, 1] {
        let packet = [byte; PACKET_BYTES_MAX + 1];
        let length = |packet| frame_packet(packet, &mut [0; 2 * FRAME_BYTES_MAX]).unwrap().len();
        assert_eq!(length(&packet[1..]), FRAME_BYTES_MAX);
        // Without a zero in it, a longer packet needs a second byte of COBS.
        assert_eq!(length(&packet), FRAME_BYTES_MAX + if byte == 0 { 1 } else { 2 });
    }
}

#[test]
fn a_line_that_was_reopened_begins_without_the_rest_of_a_frame() {
    let message = Message::Pose(pose(2));
    let whole = frame(&message);
    let mut deframer = Deframer::<FRAME_BYTES_MAX>::new();
    let arrived = Ok(packet(message));
    for (before, after, outcome) in [
        (&whole[..0], &whole[..], arrived.clone()),
        (&whole[..60], &whole[..], arrived),
        // Of the frame after it, only the end arrives.
        (&whole[..60], &whole[60..], Err(PacketError::Fragment)),
    ] {
        assert!(!deframer.is_synchronised());
        deframer.push(before, |outcome| panic!("{outcome:?} without a delimiter"));
        deframer.restart();
        let mut outcomes = StdVec::new();
        deframer.push(after, |outcome| outcomes.push(outcome));
        assert_eq!(outcomes, [outcome]);
        assert!(deframer.is_synchronised());
        deframer.restart();
    }
}

#[test]
fn a_packet_that_ends_in_zero_needs_its_room_too() {
    let mut ends_in_zero = 0;
    for id in 0..2_000 {
        let message = Message::Command(Command { id, action: Action::SendHello, is_forced: false });
        let mut packet = [0; PACKET_BYTES_MAX];
        ends_in_zero +=
            usize::from(encode_datagram(None, &message, &mut packet).unwrap().last() == Some(&0));
        let mut buffer = [0; FRAME_BYTES_MAX];
        let length = encode_frame(None, &message, &mut buffer).unwrap().len();
        for short in 0..length {
            assert_eq!(
                encode_frame(None, &message, &mut buffer[..short]),
                Err(EncodeError),
                "{id}"
            );
        }
    }
    // One checksum in 256 does.
    assert!(ends_in_zero > 0);
}
