//! Packets in clear, and their frames on a serial line.
//!
//! The first byte chooses how the rest is used. Most inputs would be refused by their checksum alone;
//! so there is a way in which the law itself puts a right head and a right checksum around each body.
//!
//! Laws:
//! - What is decoded is encoded again, within the bounds, and decoded to the same; a frame of it comes
//!   out of a serial line as it was.
//! - Poses are finite, rotations are rotations, and variances are not negative.
//! - A line gives no more outcomes than it had delimiters. Whatever it carried before, a whole frame
//!   after a delimiter comes through, and nothing else comes with it.
//! - A receiver's counts add up, whatever a box says and when.

use std::time::{Duration, Instant};

use plumbline::packet::{
    DELIMITER, Deframer, FRAME_BYTES_MAX, MeasuredPose, Message, PACKET_BYTES_MAX,
    PROTOCOL_VERSION, Packet, PacketError, SCHEMA_HASH, Start, decode_datagram, document_crc,
    encode_datagram, encode_frame, frame_packet,
};
use plumbline_stream::fixture;
use plumbline_stream::receiver::Receiver;
use plumbline_stream::transport::Event;

use crate::input::{Input, put_block};

/// How the bytes after the first are used.
const DATAGRAM: u8 = 0;
const BODY: u8 = 1;
const LINE: u8 = 2;
const RECEIVER: u8 = 3;
const WAYS: usize = 4;

/// The most packets of one input.
const PACKETS_MAX: usize = 64;

/// Checks the laws for an input.
pub fn check(bytes: &[u8]) {
    let mut input = Input::new(bytes);
    match input.below(WAYS) as u8 {
        DATAGRAM => datagram(input.rest()),
        BODY => {
            let start = input.number();
            datagram(&around(start, input.rest()));
        }
        LINE => line(input),
        _ => receiver(input),
    }
}

/// The most bytes between the head and the checksum of a packet.
pub const BODY_BYTES_MAX: usize = PACKET_BYTES_MAX - 13;

/// A packet with a right head and checksum.
pub fn around(start: u32, body: &[u8]) -> Vec<u8> {
    let mut packet = vec![PROTOCOL_VERSION];
    packet.extend(SCHEMA_HASH.to_le_bytes());
    packet.extend(start.to_le_bytes());
    packet.extend(body);
    packet.extend(document_crc(&packet).to_le_bytes());
    packet
}

/// The start and the body of a packet in clear.
pub fn parts(packet: &[u8]) -> (u32, &[u8]) {
    let start = packet[5..9].try_into().expect("four bytes");
    (u32::from_le_bytes(start), &packet[9..packet.len() - 4])
}

fn datagram(packet: &[u8]) {
    if let Ok(found) = decode_datagram(packet) {
        decoded(&found);
    }
}

fn decoded(found: &Packet) {
    let mut buffer = [0; PACKET_BYTES_MAX];
    let again = encode_datagram(found.start, &found.message, &mut buffer);
    let again = again.expect("every message fits a packet");
    assert_eq!(decode_datagram(again).as_ref(), Ok(found), "it is decoded to something else");
    let mut frame = [0; FRAME_BYTES_MAX];
    let frame = encode_frame(found.start, &found.message, &mut frame).expect("and a frame");
    assert_eq!(frame.iter().position(|byte| *byte == DELIMITER), Some(frame.len() - 1));
    let mut deframer: Deframer = Deframer::new();
    deframer.feed(DELIMITER);
    let outcomes: Vec<_> = frame.iter().filter_map(|byte| deframer.feed(*byte)).collect();
    assert_eq!(outcomes, [Ok(found.clone())], "a line changes it");
    if let Message::Pose(packet) = &found.message {
        for target in &packet.targets {
            if let Ok(measured) = &target.pose {
                pose(measured, packet.capture_time_ns);
            }
        }
    }
}

fn pose(measured: &MeasuredPose, capture_time_ns: u64) {
    let pose = measured.cam_from_target();
    let numbers = pose.rotation.iter().chain(&pose.translation_mm);
    assert!(numbers.copied().all(f64::is_finite), "{measured:?}");
    let unit = pose.rotation.transpose() * pose.rotation;
    assert!((unit - nalgebra::Matrix3::identity()).norm() < 1e-9, "{measured:?}");
    let covariance = measured.covariance();
    assert!(covariance.iter().copied().all(f64::is_finite), "{measured:?}");
    assert!(covariance.diagonal().iter().all(|variance| *variance >= 0.0), "{measured:?}");
    assert_eq!(covariance, covariance.transpose(), "{measured:?}");
    assert!(measured.own_time_ns(capture_time_ns) >= capture_time_ns);
}

/// A serial line that carries, by a choice for each: noise, a frame, a frame of which a part is
/// missing.
fn line(mut input: Input<'_>) {
    let mut deframer: Deframer = Deframer::new();
    let mut carried = vec![DELIMITER];
    for _ in 0..PACKETS_MAX {
        if input.is_empty() {
            break;
        }
        let way = input.below(3);
        let bytes = input.block();
        if way == 0 {
            carried.extend(bytes);
            continue;
        }
        let packet = around(7, &bytes[..bytes.len().min(BODY_BYTES_MAX)]);
        let mut buffer = [0; FRAME_BYTES_MAX];
        let frame = frame_packet(&packet, &mut buffer).expect("it is short enough");
        if way == 1 {
            // What came before may have no end yet.
            carried.push(DELIMITER);
            let before = carried.iter().filter_map(|byte| deframer.feed(*byte)).count();
            let delimiters = carried.iter().filter(|byte| **byte == DELIMITER).count();
            assert!(before <= delimiters, "{before} outcomes of {delimiters} delimiters");
            carried.clear();
            let outcomes: Vec<_> = frame.iter().filter_map(|byte| deframer.feed(*byte)).collect();
            assert_eq!(outcomes, [decode_datagram(&packet)], "a whole frame does not come through");
        } else {
            let missing = usize::from(bytes.first().copied().unwrap_or(0)) % frame.len();
            carried.extend(frame.iter().enumerate().filter(|it| it.0 != missing).map(|it| it.1));
        }
    }
    deframer.push(&carried, |outcome| {
        assert_ne!(outcome, Err(PacketError::Fragment), "the line is synchronised");
        if let Ok(packet) = outcome {
            decoded(&packet);
        }
    });
}

/// A receiver that gets these messages, each after a pause.
fn receiver(mut input: Input<'_>) {
    let mut receiver = Receiver::<Vec<u8>>::new(None);
    let mut now = Instant::now();
    let mut poses = 0;
    for _ in 0..PACKETS_MAX {
        if input.is_empty() {
            break;
        }
        now += Duration::from_millis(u64::from(input.byte()).pow(2));
        let start = input.below(4) as u32;
        let outcome = decode_datagram(&around(start, input.block()));
        poses += u64::from(matches!(&outcome, Ok(Packet { message: Message::Pose(_), .. })));
        // It refuses what cannot be recorded, and there is no recorder.
        receiver.handle(Event::of(outcome), now).expect("nothing is recorded");
        receiver.tick(now).expect("nothing is recorded");
        let counts = receiver.counts();
        assert!(
            counts.received + counts.repeated + counts.implausible <= poses,
            "{poses} poses are counted as {counts:?}"
        );
        assert!(counts.late <= poses);
        assert!(receiver.rate_hz(now).is_finite());
        assert!(!receiver.runs().is_empty());
    }
    let notices: usize = receiver.take_notices().iter().map(String::len).sum();
    assert!(notices < 1 << 20, "{notices} bytes of notices");
}

/// Inputs that are accepted: every kind of message, alone and after one another.
pub fn seeds() -> Vec<Vec<u8>> {
    let mut seeds = Vec::new();
    let mut session = vec![RECEIVER];
    let mut wire = vec![LINE];
    for message in messages() {
        let is_of_host = matches!(message, Message::Command(_));
        let start = if is_of_host { None } else { Start::new(fixture::START) };
        let mut buffer = [0; PACKET_BYTES_MAX];
        let packet = encode_datagram(start, &message, &mut buffer).expect("it fits");
        let (number, body) = parts(packet);
        seeds.push([&[DATAGRAM], packet].concat());
        seeds.push([&[BODY], &number.to_le_bytes()[..], body].concat());
        session.extend([4, 3]);
        put_block(&mut session, body);
        wire.push(1);
        put_block(&mut wire, body);
    }
    seeds.push(session);
    seeds.push(wire);
    seeds
}

/// One of each kind, from a healthy box and its host.
pub fn messages() -> Vec<Message> {
    use plumbline::packet::{
        Action, Command, Document, Edge, Log, LogLevel, Part, Picture, Reply, ReplyOutcome, Trigger,
    };
    let config = fixture::config();
    let text = |text: &str| text.try_into().expect("it is short");
    let log = Log {
        uptime_ms: 5,
        level: LogLevel::Warn,
        target: "camera".try_into().expect("it is short"),
        text: text("frames are late"),
        cut: 0,
    };
    let part = Part {
        document: Document::Config,
        offset: 0,
        bytes: b"plum"[..].try_into().expect("it is short"),
    };
    let command = |action| Message::Command(Command { id: 3, action, is_forced: false });
    let pong =
        ReplyOutcome::Pong { host_sent_ns: 1, box_received_ns: 2, box_sent_ns: 3, stream_next: 4 };
    let picture =
        Picture { number: 1, sequence: 5, reduction: 4, bytes: 4, crc: document_crc(b"plum") };
    let trigger = Trigger { sequence: 0, time_ns: 5, uncertain_ns: 1, edge: Edge::Rising };
    vec![
        Message::Hello(fixture::hello(&config)),
        Message::Health(fixture::health()),
        Message::Pose(fixture::pose_packet(0)),
        Message::Pose(fixture::pose_packet(3)),
        Message::Pose(fixture::pose_packet(1)),
        Message::View(fixture::view()),
        Message::Log(log),
        Message::Part(part),
        Message::Picture(picture),
        Message::Trigger(trigger),
        command(Action::Ping { host_sent_ns: 9 }),
        command(Action::Resend { first: 3, mask: 5 }),
        command(Action::Expose { exposure_us: Some(900), gain: Some(2.0) }),
        Message::Reply(Reply { id: 3, outcome: pong }),
    ]
}
