extern crate std;

use std::format;
use std::string::ToString as _;
use std::vec::Vec as StdVec;

use heapless::{String, Vec};

use super::*;
use crate::common::checksum::CRC32;
use crate::limits::{RING_BYTES, RING_PACKETS};
use crate::model::target::Role;
use crate::tell::report::{NoPose, TargetState};
use crate::tell::view::{FrameView, TargetView};
use crate::test_support::repetitions;

mod framing;
mod pose;
mod schema;

const POINT: AnatomicalPoint = AnatomicalPoint { ap_mm: -1.5, ml_mm: 20.25, si_mm: 1400.0 };

const POSE: MeasuredPose = MeasuredPose {
    delay_ns: 7_654_321,
    theta_rad: [0.1, -0.2, 3.0],
    translation_mm: [-12.5, 80.0, 1000.06],
    sd_mm: [0.0012, 0.0013, 0.025],
    sd_rad: [0.000_12, 0.000_11, 0.000_03],
    correlations: [0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    rms_px: 0.0312,
    corners: 29,
};

/// How many kinds of messages there are.
const KINDS: usize = 10;

/// The kind that hosts send, which is the first byte of its body.
const COMMAND: u8 = 4;

/// Where the body of a datagram begins: after the version, the schema's hash and the start.
const BODY_AT: usize = 9;

/// Of the box that sends what follows.
const START: Start = Start::MAX;

fn full<const N: usize>() -> String<N> {
    let mut text = String::new();
    while text.push('x').is_ok() {}
    text
}

fn targets(count: usize) -> Vec<TargetPacket, TARGETS_MAX> {
    let roles = [Role::Upper, Role::Lower, Role::Scene];
    roles[..count]
        .iter()
        .map(|&role| TargetPacket { role, state: TargetState::Tracking, pose: Ok(POSE) })
        .collect()
}

fn pose(count: usize) -> PosePacket {
    PosePacket {
        sequence: u32::MAX,
        capture_time_ns: u64::MAX,
        instant: MarkedInstant::Recording,
        latency_us: u32::MAX,
        targets: targets(count),
        upper_trunk: Some(POINT),
        lower_trunk: Some(POINT),
    }
}

/// One message of each kind and shape, each as long as its type allows.
fn longest_messages() -> StdVec<Message> {
    let info = TargetInfo { name: full(), role: Role::Scene, corners: 120 };
    let link =
        LinkHealth { kind: LinkKind::File, packets_sent: u32::MAX, packets_dropped: u32::MAX };
    let pong = ReplyOutcome::Pong {
        host_sent_ns: u64::MAX,
        box_received_ns: u64::MAX,
        box_sent_ns: u64::MAX,
        stream_next: u64::MAX,
    };
    let ping = Action::Ping { host_sent_ns: u64::MAX };
    let mut messages = std::vec![
        Message::Pose(pose(3)),
        Message::Hello(Hello {
            device: full(),
            serial_number: full(),
            firmware: full(),
            config_crc: u32::MAX,
            boot_id: u32::MAX,
            boot_count: Some(u32::MAX),
            reset_reason: ResetReason::Watchdog,
            width_px: u16::MAX,
            height_px: u16::MAX,
            targets: core::iter::repeat_n(info, TARGETS_MAX).collect(),
        }),
        Message::Health(Health {
            uptime_ms: u64::MAX,
            frames: u32::MAX,
            frames_dropped: u32::MAX,
            frames_missed: u32::MAX,
            camera_losses: u32::MAX,
            corners_dropped: u32::MAX,
            heap_allocations: Some(u32::MAX),
            temperature_decicelsius: Some(i16::MIN),
            undervoltage: Some(true),
            throttled: Some(true),
            camera: CameraState::Ended,
            aiming_s: u16::MAX,
            latency_us_max: u32::MAX,
            logs_dropped: u32::MAX,
            trigger: TriggerHealth {
                input: TriggerState::Missing,
                output: TriggerState::Missing,
                sent: u32::MAX,
                bounces: u32::MAX,
                dropped: u32::MAX,
                pulses: u32::MAX,
            },
            links: core::iter::repeat_n(link, LINKS_MAX).collect(),
        }),
        Message::Log(Log {
            uptime_ms: u64::MAX,
            level: LogLevel::Trace,
            target: full(),
            text: full(),
            cut: u16::MAX,
        }),
    ];
    let actions = [
        ping,
        Action::SendHello,
        Action::SendHealth,
        Action::QueryConfig,
        Action::SendView,
        Action::SendParts {
            document: Document::Picture(u16::MAX),
            offset: u32::MAX,
            bytes: u32::MAX,
        },
        Action::StoreConfig { bytes: u32::MAX, crc: u32::MAX },
        Action::Aim { seconds: u16::MAX },
        Action::TakePicture { reduction: u8::MAX },
        Action::Expose { exposure_us: Some(u32::MAX), gain: Some(1.0) },
        Action::Reboot,
        Action::Resend { first: u64::MAX, mask: u64::MAX },
        Action::Record { on: true },
        Action::SendPoses { every: u16::MAX },
        Action::Leave,
    ];
    for action in actions {
        messages.push(Message::Command(Command { id: u16::MAX, action, is_forced: true }));
    }
    for outcome in [
        pong,
        ReplyOutcome::Config { crc: u32::MAX, bytes: u32::MAX, next_crc: u32::MAX },
        ReplyOutcome::Stored { crc: u32::MAX },
        ReplyOutcome::Gone { first: u64::MAX },
        ReplyOutcome::Accepted,
        ReplyOutcome::Refused { refusal: Refusal::Incomplete { from: u32::MAX }, reason: full() },
    ] {
        messages.push(Message::Reply(Reply { id: u16::MAX, outcome }));
    }
    let mut lost = pose(2);
    lost.targets[0].pose = Err(NoPose::FrameSize);
    lost.targets[0].state = TargetState::Coasting;
    lost.upper_trunk = None;
    messages.push(Message::Pose(lost));
    let target = TargetView {
        role: Role::Scene,
        light: 1.0,
        dark: 0.0,
        saturated: 0.5,
        blur_px: [0.7, 0.8],
        pitch_px: 21.0,
    };
    messages.push(Message::View(View {
        sequence: u32::MAX,
        exposure_us: Some(u32::MAX),
        gain: Some(1.0),
        frame: FrameView { level: 0.5, saturated: 0.5, blur_px: Some(0.7) },
        targets: core::iter::repeat_n(target, TARGETS_MAX).collect(),
    }));
    messages.push(Message::Picture(Picture {
        number: u16::MAX,
        sequence: u32::MAX,
        reduction: u8::MAX,
        bytes: u32::MAX,
        crc: u32::MAX,
    }));
    messages.push(Message::Trigger(Trigger {
        sequence: u32::MAX,
        time_ns: u64::MAX,
        uncertain_ns: u32::MAX,
        edge: Edge::Falling,
    }));
    messages.push(Message::Part(Part {
        document: Document::Picture(u16::MAX),
        offset: u32::MAX,
        bytes: core::iter::repeat_n(0xA5, PART_BYTES_MAX).collect(),
    }));
    messages
}

/// Who sends a message of this kind.
fn sender(message: &Message) -> Option<Start> {
    (!matches!(message, Message::Command(_))).then_some(START)
}

fn datagram(message: &Message) -> StdVec<u8> {
    encode_datagram(sender(message), message, &mut [0; PACKET_BYTES_MAX]).unwrap().to_vec()
}

fn frame(message: &Message) -> StdVec<u8> {
    encode_frame(sender(message), message, &mut [0; FRAME_BYTES_MAX]).unwrap().to_vec()
}

fn packet(message: Message) -> Packet {
    Packet { start: sender(&message), message }
}

fn received(bytes: &[u8]) -> StdVec<Result<Packet, PacketError>> {
    let mut deframer = Deframer::<FRAME_BYTES_MAX>::new();
    let mut outcomes = StdVec::new();
    deframer.push(bytes, |outcome| outcomes.push(outcome));
    outcomes
}

/// A body with its header and a correct checksum.
fn sealed(version: u8, hash: u32, start: u32, body: &[u8]) -> StdVec<u8> {
    let mut packet = std::vec![version];
    packet.extend(hash.to_le_bytes());
    packet.extend(start.to_le_bytes());
    packet.extend(body);
    packet.extend(CRC32.checksum(&packet).to_le_bytes());
    packet
}

/// `SplitMix64`: seeded, so that a failure can be reproduced.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }
}

#[test]
fn every_message_comes_back_through_datagram_and_frame() {
    for message in longest_messages() {
        assert_eq!(decode_datagram(&datagram(&message)), Ok(packet(message.clone())));
        assert_eq!(received(&frame(&message)), [Ok(packet(message))]);
    }
}

#[test]
fn the_longest_packets_keep_their_bounds() {
    // Every field of a pose packet has a fixed width once it is there, so that
    // the packet with everything there is the longest.
    assert_eq!(frame(&Message::Pose(pose(2))).len(), 182);
    assert_eq!(frame(&Message::Pose(pose(3))).len(), 243);
    // Sealed: version, kind, counter, tag; in the ring with the length.
    let body_bytes = frame(&Message::Pose(pose(2))).len() - 2 - CLEAR_OVERHEAD_BYTES;
    assert_eq!(2 + 4 + body_bytes + 16, 189);
    const { assert!(12_000 * (189 + 2) <= RING_BYTES && 12_000 <= RING_PACKETS) }
    let lengths: StdVec<_> = longest_messages().iter().map(|m| frame(m).len()).collect();
    assert_eq!(
        lengths,
        [
            243, 172, 135, 193, 31, 21, 21, 21, 21, 35, 31, 24, 22, 32, 21, 41, 22, 24, 21, 60, 35,
            25, 30, 20, 228, 113, 121, 35, 37, 251
        ]
    );
    // Shorter buffers are refused, and nothing is written past them.
    for message in longest_messages() {
        let length = frame(&message).len();
        for short in 0..length {
            let mut buffer = [0; 256];
            assert_eq!(encode_frame(None, &message, &mut buffer[..short]), Err(EncodeError));
        }
        for short in 0..length - 2 {
            let mut buffer = [0; 256];
            assert_eq!(encode_datagram(None, &message, &mut buffer[..short]), Err(EncodeError));
        }
    }
}

#[test]
fn each_fault_has_its_own_name() {
    let message = Message::Pose(pose(2));
    let good = datagram(&message);
    let body = &good[BODY_AT..good.len() - 4];
    let start = START.get();
    assert_eq!(sealed(PROTOCOL_VERSION, SCHEMA_HASH, start, body), good);

    assert_eq!(decode_datagram(&[]), Err(PacketError::Short));
    let shortest = BODY_AT + 4;
    assert_eq!(decode_datagram(&good[..shortest - 1]), Err(PacketError::Short));
    assert_eq!(decode_datagram(&good[..shortest]), Err(PacketError::Checksum));
    assert_eq!(decode_datagram(&good[..good.len() - 1]), Err(PacketError::Checksum));
    let newer = sealed(PROTOCOL_VERSION + 1, 77, start, &[1, 2, 3]);
    let version = PROTOCOL_VERSION + 1;
    assert_eq!(decode_datagram(&newer), Err(PacketError::OtherVersion { version }));
    let other = sealed(PROTOCOL_VERSION, 77, start, body);
    assert_eq!(decode_datagram(&other), Err(PacketError::OtherSchema { hash: 77 }));
    let longer = [body, &[0]].concat();
    let longer = sealed(PROTOCOL_VERSION, SCHEMA_HASH, start, &longer);
    assert_eq!(decode_datagram(&longer), Err(PacketError::Body));
    let unknown = sealed(PROTOCOL_VERSION, SCHEMA_HASH, start, &[99]);
    assert_eq!(decode_datagram(&unknown), Err(PacketError::Body));

    // A line joined in the middle of a frame, then one whole frame.
    let whole = frame(&message);
    let joined = [&whole[60..], &whole].concat();
    let arrived = Ok(self::packet(message));
    assert_eq!(received(&joined), [Err(PacketError::Fragment), arrived.clone()]);
    // Each fault costs its own frame, and the next one is good.
    let mut torn = whole[..60].to_vec();
    torn.push(0);
    let mut oversize = std::vec![1; FRAME_BYTES_MAX + 1];
    oversize.push(0);
    let mut wrong = whole.clone();
    wrong[30] ^= 0x80;
    for (bytes, fault) in [
        (&torn, PacketError::Cobs),
        (&oversize, PacketError::Oversize),
        (&wrong, PacketError::Checksum),
    ] {
        let stream = [&[0, 0], bytes.as_slice(), &whole].concat();
        assert_eq!(received(&stream), [Err(fault), arrived.clone()]);
    }
}

#[test]
fn numbers_that_no_room_holds_do_not_arrive() {
    use core::f32::consts::PI;
    const FAR_MM: f32 = 1.01 * POSITION_MM_MAX;
    let with_pose = |pose: MeasuredPose| {
        let mut packet = self::pose(2);
        packet.targets[1].pose = Ok(pose);
        Message::Pose(packet)
    };
    let with_trunk = |lower_trunk: AnatomicalPoint| {
        Message::Pose(PosePacket { lower_trunk: Some(lower_trunk), ..self::pose(2) })
    };
    let outcome = |message: &Message| decode_datagram(&datagram(message)).map(|it| it.message);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, FAR_MM, -FAR_MM] {
        for message in [
            with_pose(MeasuredPose { translation_mm: [0.0, bad, 0.0], ..POSE }),
            with_pose(MeasuredPose { theta_rad: [0.0, 0.0, bad], ..POSE }),
            with_trunk(AnatomicalPoint { si_mm: bad, ..POINT }),
        ] {
            assert_eq!(outcome(&message), Err(PacketError::Number), "{bad}");
        }
    }
    for bad in [PI + 1e-5, -PI - 1e-5] {
        let message = with_pose(MeasuredPose { theta_rad: [bad, 0.0, 0.0], ..POSE });
        assert_eq!(outcome(&message), Err(PacketError::Number), "{bad}");
    }
    // What is at the bound can be measured.
    for edge in [POSITION_MM_MAX, -POSITION_MM_MAX] {
        let turned = MeasuredPose { theta_rad: [PI, -PI, 0.0], translation_mm: [edge; 3], ..POSE };
        for message in [with_pose(turned), with_trunk(AnatomicalPoint { ap_mm: edge, ..POINT })] {
            assert_eq!(outcome(&message), Ok(message.clone()));
        }
    }
    let mut view = longest_messages().into_iter().find(|it| matches!(it, Message::View(_)));
    if let Some(Message::View(view)) = &mut view {
        view.targets[0].pitch_px = f32::NAN;
    }
    assert_eq!(outcome(&view.expect("there is one of each kind")), Err(PacketError::Number));
    for message in longest_messages() {
        let Message::View(view) = message else { continue };
        let mut frame = view.clone();
        frame.frame.blur_px = Some(f32::NAN);
        assert_eq!(outcome(&Message::View(frame)), Err(PacketError::Number));
    }
    let action = Action::Expose { exposure_us: None, gain: Some(f32::INFINITY) };
    let command = Message::Command(Command { id: 1, action, is_forced: false });
    assert_eq!(outcome(&command), Err(PacketError::Number));
}

#[test]
fn what_people_read_of_a_fault_says_which_it_is() {
    let other = PacketError::OtherVersion { version: 99 }.to_string();
    assert!(other.contains("99") && other.contains(&PROTOCOL_VERSION.to_string()), "{other}");
    let other = PacketError::OtherSchema { hash: 0xab }.to_string();
    assert!(other.contains("000000ab") && other.contains(&format!("{SCHEMA_HASH:08x}")), "{other}");
    assert!(PacketError::Oversize.to_string().contains(&FRAME_BYTES_MAX.to_string()));
    assert_eq!(EncodeError.to_string(), "the message does not fit the buffer");
}

#[test]
fn only_these_requests_change_the_box() {
    let changing: StdVec<_> = longest_messages()
        .into_iter()
        .filter_map(|message| match message {
            Message::Command(command) => Some(command.action),
            _ => None,
        })
        .filter(Action::changes_box)
        .collect();
    assert_eq!(
        changing,
        [
            Action::StoreConfig { bytes: u32::MAX, crc: u32::MAX },
            Action::Aim { seconds: u16::MAX },
            Action::TakePicture { reduction: u8::MAX },
            Action::Expose { exposure_us: Some(u32::MAX), gain: Some(1.0) },
            Action::Reboot,
        ]
    );
}

#[test]
fn the_checksum_of_a_document_is_the_crc_32_of_zip_and_png() {
    // The value by which the catalogue of checksums identifies it.
    assert_eq!(document_crc(b"123456789"), 0xcbf4_3926);
    assert_eq!(document_crc(&[]), 0);
}

#[test]
fn a_program_says_its_version_and_its_commit() {
    for (version, commit, text) in [
        ("0.1.0", Some("1a2b3c4d"), "0.1.0+1a2b3c4d"),
        ("0.10.12", Some("1a2b3c4d.changed"), "0.10.12+1a2b3c4d.changed"),
        ("0.1.0", Some(""), "0.1.0+dev"),
        ("0.1.0", None, "0.1.0+dev"),
    ] {
        assert_eq!(ProgramVersion::new(version, commit).as_str(), text);
    }
    let own = crate::program_version!();
    assert!(own.starts_with(concat!(env!("CARGO_PKG_VERSION"), "+")), "{own}");
    assert!(
        std::panic::catch_unwind(|| ProgramVersion::new("0.10.123", Some("1a2b3c4d.changed")))
            .is_err()
    );
}

#[test]
fn a_packet_says_which_start_of_a_box_it_is_of() {
    let packet_of = |start: u32, message: &Message| {
        let sent = datagram(message);
        let body = &sent[BODY_AT..sent.len() - 4];
        decode_datagram(&sealed(PROTOCOL_VERSION, SCHEMA_HASH, start, body))
    };
    for message in longest_messages() {
        let by_box = packet_of(7, &message).map(|packet| packet.start);
        let by_host = packet_of(0, &message).map(|packet| packet.start);
        let (as_box, as_host) = match &message {
            Message::Command(_) => (Err(PacketError::Body), Ok(None)),
            Message::Part(_) => (Ok(Start::new(7)), Ok(None)),
            // It names another start than that of its packet.
            Message::Hello(_) => (Err(PacketError::Body), Err(PacketError::Body)),
            _ => (Ok(Start::new(7)), Err(PacketError::Body)),
        };
        assert_eq!((by_box, by_host), (as_box, as_host), "{message:?}");
    }
}

#[test]
fn every_single_wrong_bit_is_found() {
    let good = Message::Reply(Reply { id: 7, outcome: ReplyOutcome::Accepted });
    let before = frame(&good);
    let mut flips = 0;
    for message in longest_messages() {
        let packet = datagram(&message);
        for bit in 0..packet.len() * 8 {
            let mut wrong = packet.clone();
            wrong[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(decode_datagram(&wrong), Err(PacketError::Checksum));
        }
        // On the line a flip can also make or break a delimiter: then the frame
        // falls in two or takes the next one with it, but nothing wrong passes.
        let framed = frame(&message);
        for bit in 0..framed.len() * 8 {
            let mut wrong = framed.clone();
            wrong[bit / 8] ^= 1 << (bit % 8);
            let stream = [before.as_slice(), &wrong, &before, &before].concat();
            let outcomes = received(&stream);
            let passed: StdVec<_> = outcomes.iter().flatten().collect();
            assert!(passed.iter().all(|&passed| passed.message == good), "bit {bit}");
            let delimiter = bit / 8 == framed.len() - 1;
            assert_eq!(passed.len(), if delimiter { 2 } else { 3 }, "bit {bit}");
            assert!(outcomes.iter().any(Result::is_err), "bit {bit}");
            flips += 1;
        }
    }
    assert!(flips > 6_000);
}

/// What decodes must be a message that can be sent again and is then the same.
fn is_sound(outcome: Result<Packet, PacketError>) -> bool {
    match outcome {
        Ok(packet) => {
            let mut buffer = [0; PACKET_BYTES_MAX];
            let again = encode_datagram(packet.start, &packet.message, &mut buffer).unwrap();
            assert_eq!(decode_datagram(again), Ok(packet));
            true
        }
        Err(_) => false,
    }
}

#[test]
fn no_bytes_panic() {
    let mut random = Random(1);
    let samples: StdVec<_> = longest_messages().iter().map(datagram).collect();
    // Messages decoded, by their kind, which is the first byte of a body.
    let mut decoded = [0; KINDS];
    for _ in 0..repetitions(300_000) {
        // Random bodies, and good bodies with a few bytes changed, cut or doubled, under a correct
        // header and checksum: these reach postcard.
        let sample = &samples[random.below(samples.len())];
        let mut body = sample[BODY_AT..sample.len() - 4].to_vec();
        match random.below(4) {
            0 => {
                body = (0..random.below(200)).map(|_| random.next() as u8).collect();
                if let Some(kind) = body.first_mut() {
                    *kind %= KINDS as u8;
                }
            }
            1 => body.truncate(random.below(body.len() + 1)),
            2 => {
                let from = random.below(body.len());
                body.extend_from_within(from..);
            }
            _ => {
                for _ in 0..=random.below(4) {
                    let at = random.below(body.len());
                    body[at] = random.next() as u8;
                }
            }
        }
        let from_host = body.first() == Some(&COMMAND);
        let start = if from_host { 0 } else { START.get() };
        let sealed = sealed(PROTOCOL_VERSION, SCHEMA_HASH, start, &body);
        if is_sound(decode_datagram(&sealed)) {
            decoded[usize::from(body[0])] += 1;
        }
    }
    // Many changes hit a number and give another good message: postcard was reached, for each kind.
    assert!(decoded.iter().sum::<usize>() > repetitions(15_000), "{decoded:?}");
    assert!(decoded.iter().all(|&count| count > repetitions(100)), "{decoded:?}");

    // Streams of random bytes, with many delimiters, and of damaged frames.
    let mut deframer = Deframer::<FRAME_BYTES_MAX>::new();
    let (mut good, mut bad) = (0, 0);
    for _ in 0..repetitions(100_000) {
        let mut bytes = frame(&Message::Pose(pose(2)));
        match random.below(3) {
            0 => {
                let zeros = random.below(40) as u8;
                for byte in &mut bytes {
                    *byte = random.next() as u8;
                    *byte = if *byte < zeros { 0 } else { *byte };
                }
            }
            1 => {
                let at = random.below(bytes.len());
                bytes[at] = random.next() as u8;
            }
            _ => bytes.truncate(random.below(bytes.len())),
        }
        deframer.push(&bytes, |outcome| {
            if is_sound(outcome) {
                good += 1;
            } else {
                bad += 1;
            }
        });
    }
    assert!(good > 0 && bad > repetitions(50_000), "{good} {bad}");
}
