mod boxes;
mod power;
mod serial;

use std::io::Write;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use plumbline::packet::{
    AnatomicalPoint, CameraState, Health, Hello, MarkedInstant, MeasuredPose, Message,
    PACKET_BYTES_MAX, Packet, PosePacket, ResetReason, TargetInfo, TargetPacket, encode_datagram,
};
use plumbline::report::{NoPose, TargetState};
use plumbline::target::Role;

use super::*;
use crate::fixture::{START, SealedBox, event, known_box, packet, take};
use crate::recorder::Recorder;
use crate::transport::{Link, Raw, Serial, Udp};
use plumbline_files::poses;

const HEADER: &str = "frame,time_s,target,state,theta1_rad,theta2_rad,theta3_rad,x_mm,y_mm,z_mm,\
    sd_x_mm,sd_y_mm,sd_z_mm,rms_px,points,ap_mm,ml_mm,si_mm,session";

const FRAME_NS: u64 = 20_000_000;

fn pose(sequence: u32) -> Message {
    let measured = MeasuredPose {
        delay_ns: 0,
        theta_rad: [0.1, -0.2, 0.3],
        translation_mm: [12.5, -80.25, 1000.06],
        sd_mm: [0.0012, 0.0013, 0.025],
        sd_rad: [0.000_12, 0.000_11, 0.000_03],
        correlations: [0.0; 15],
        rms_px: 0.0312,
        corners: 18,
    };
    let target = |role, state, pose| TargetPacket { role, state, pose };
    Message::Pose(PosePacket {
        sequence,
        capture_time_ns: 5_000_000_000 + u64::from(sequence) * FRAME_NS,
        instant: MarkedInstant::Recording,
        latency_us: 4100,
        targets: [
            target(Role::Upper, TargetState::Tracking, Ok(measured)),
            target(Role::Lower, TargetState::Coasting, Err(NoPose::TooFewCorners)),
        ]
        .into_iter()
        .collect(),
        upper_trunk: Some(AnatomicalPoint { ap_mm: 1.5, ml_mm: -2.5, si_mm: 1400.0 }),
        lower_trunk: None,
    })
}

fn hello(boot_id: u32) -> Message {
    hello_of("ward 3", boot_id)
}

fn hello_of(device: &str, boot_id: u32) -> Message {
    let info =
        |name: &str, role, corners| TargetInfo { name: name.try_into().unwrap(), role, corners };
    Message::Hello(Hello {
        device: device.try_into().unwrap(),
        serial_number: "PL-0001".try_into().unwrap(),
        firmware: "0.1.0".try_into().unwrap(),
        config_crc: 7,
        boot_id,
        boot_count: None,
        reset_reason: ResetReason::Watchdog,
        width_px: 1456,
        height_px: 1088,
        targets: [info("shoulder", Role::Upper, 20), info("lumbar", Role::Lower, 30)]
            .into_iter()
            .collect(),
    })
}

/// The packet of this message: a Hello's own start, else that of the fixture's box.
fn sent(message: &Message) -> Packet {
    let start = if let Message::Hello(hello) = message { hello.boot_id } else { START };
    packet(start, message.clone())
}

fn datagram_of(packet: &Packet) -> Vec<u8> {
    let mut buffer = [0; PACKET_BYTES_MAX];
    encode_datagram(packet.start, &packet.message, &mut buffer).unwrap().to_vec()
}

fn datagram(message: &Message) -> Vec<u8> {
    datagram_of(&sent(message))
}

/// A recording into memory that can be read while it is written, as a file can.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Shared {
    fn text(&self) -> String {
        String::from_utf8(self.0.lock().unwrap().clone()).unwrap()
    }
}

fn receiver() -> (Receiver<Shared>, Shared) {
    let shared = Shared::default();
    let recorder = Recorder::new(shared.clone(), "poses.csv");
    (Receiver::new(Some(recorder)), shared)
}

/// The reception goes on, but for a test that would hang.
fn on() -> impl FnMut(&mut Receiver<Shared>) -> ControlFlow<()> {
    let begun = Instant::now();
    move |_| match begun.elapsed() < Duration::from_secs(10) {
        true => ControlFlow::Continue(()),
        false => ControlFlow::Break(()),
    }
}

/// A link to the box of tests, and where that sends.
fn link() -> (Link<Udp>, std::net::SocketAddr) {
    let udp = Udp::bind("127.0.0.1:0".parse().unwrap()).unwrap();
    let to = udp.local_address().unwrap();
    (Link::new(udp, vec![known_box()], "a test"), to)
}

/// Frame, target and session of every row.
fn rows(csv: &str) -> Vec<(u32, String, u32)> {
    csv::Reader::from_reader(csv.as_bytes())
        .records()
        .map(|record| {
            let record = record.unwrap();
            let number = |column: usize| record[column].parse().unwrap();
            (number(0), record[2].to_owned(), number(18))
        })
        .collect()
}

#[test]
fn datagrams_become_rows_and_every_fault_is_counted() {
    let (mut link, to) = link();
    let sender = thread::spawn(move || {
        let mut sealed_box = SealedBox::new(to, START);
        sealed_box.meet();
        sealed_box.send(&hello(START));
        for sequence in [0, 1, 2] {
            sealed_box.send(&pose(sequence));
        }
        // 3 is lost for good, and 7 too.
        sealed_box.lose(&pose(3));
        sealed_box.forget();
        sealed_box.send(&pose(4));
        // What nobody has sealed counts as nothing.
        let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.send_to(b"hello?", to).unwrap();
        socket.send_to(&datagram(&pose(900)), to).unwrap();
        for sequence in [5, 6, 6] {
            sealed_box.send(&pose(sequence));
        }
        sealed_box.lose(&pose(7));
        sealed_box.forget();
        sealed_box.send(&pose(8));
        sealed_box.live(Duration::from_secs(2));
    });
    let (mut receiver, csv) = receiver();
    let stop = AtomicBool::new(false);
    receive(&mut link, &mut receiver, &mut (), Some(7), &stop, on()).unwrap();
    sender.join().unwrap();

    let counts = receiver.counts();
    assert_eq!((counts.received, counts.lost), (7, 2));
    assert_eq!((counts.repeated, counts.late, receiver.sessions()), (1, 0, 1));
    assert_eq!(receiver.bad().not_authentic, 1, "it looks like a packet of the link");
    assert_eq!(receiver.bad().corrupt + receiver.bad().other_version, 1, "it does not");
    let csv = csv.text();
    let lines: Vec<_> = csv.lines().collect();
    assert_eq!(lines[0], HEADER);
    assert_eq!(
        lines[3],
        "1,0.02,shoulder,tracking,0.1,-0.2,0.3,12.5,-80.25,1000.06,\
         0.0012,0.0013,0.025,0.0312,18,1.5,-2.5,1400.0,1"
    );
    assert_eq!(lines[4], "1,0.02,lumbar,coasting: too few corners,,,,,,,,,,,,,,,1");
    assert_eq!(lines.len(), 1 + 2 * 7);
    // Every reader of poses.csv reads it.
    let rows = poses::parse(csv.as_bytes(), "poses.csv").unwrap();
    assert_eq!((rows[0].frame, rows[13].frame, rows[0].z_mm), (0, 8, Some(1000.06)));
    assert_eq!(receiver.shares()["shoulder"].poses, 7);
    assert_eq!(receiver.shares()["lumbar"].poses, 0);
}

/// Packets that come at once, each after its bytes.
struct Played(Vec<Packet>);

impl Transport for Played {
    fn poll(&mut self, take: &mut dyn FnMut(Event)) -> Result<(), BadInput> {
        for packet in self.0.drain(..) {
            take(Event::Raw(Raw::Datagram(datagram_of(&packet))));
            take(Event::Packet(packet));
        }
        Ok(())
    }

    fn send(&mut self, _: &Message) {}
}

/// Takes this long to write bytes down, and notes when each event came.
struct SlowDisk(Duration, Vec<Instant>);

impl Tap for SlowDisk {
    fn event(&mut self, event: &Event, now: Instant) -> Result<(), BadInput> {
        self.1.push(now);
        if matches!(event, Event::Raw(_)) {
            thread::sleep(self.0);
        }
        Ok(())
    }

    fn turn(&mut self, _: Instant) -> Result<Option<Message>, BadInput> {
        Ok(None)
    }
}

#[test]
fn a_packet_has_come_with_its_bytes_however_long_they_take_to_be_written_down() {
    let mut tap = SlowDisk(Duration::from_millis(20), Vec::new());
    let mut packets = Played([1, 2].map(|number| sent(&pose(number))).to_vec());
    turn(&mut packets, &mut receiver().0, &mut tap, &|_| false).unwrap();
    let [first_bytes, first, second_bytes, second] = tap.1[..] else { panic!("{:?}", tap.1) };
    assert_eq!((first, second), (first_bytes, second_bytes));
    assert!(second_bytes - first >= tap.0);
}

#[test]
fn names_are_asked_for_and_rows_wait_for_them() {
    let (mut link, to) = link();
    let sender = thread::spawn(move || {
        let mut sealed_box = SealedBox::new(to, START);
        sealed_box.meet();
        sealed_box.send(&pose(0));
        let asked = (0..50).find_map(|_| sealed_box.wait().pop());
        let (_, Message::Command(asked)) = asked.expect("a question") else { panic!() };
        assert_eq!(asked.action, plumbline::packet::Action::SendHello);
        sealed_box.send(&hello(START));
        sealed_box.send(&pose(1));
        sealed_box.live(Duration::from_secs(1));
    });
    let (mut receiver, csv) = receiver();
    receive(&mut link, &mut receiver, &mut (), Some(2), &AtomicBool::new(false), on()).unwrap();
    sender.join().unwrap();
    let targets: Vec<_> = rows(&csv.text()).into_iter().map(|(_, target, _)| target).collect();
    assert_eq!(targets, ["shoulder", "lumbar", "shoulder", "lumbar"]);
}

/// Hands over packets, each at its own second.
fn hear(receiver: &mut Receiver<Shared>, start: Instant, packets: &[(f64, Packet)]) {
    for (at_s, packet) in packets {
        let now = start + Duration::from_secs_f64(*at_s);
        receiver.tick(now).unwrap();
        receiver.handle(Event::Packet(packet.clone()), now).unwrap();
    }
}

#[test]
fn a_restart_begins_a_session_and_times_go_on() {
    let (mut receiver, csv) = receiver();
    let start = Instant::now();
    let box_of = |start, at: &[(f64, u32)]| -> Vec<(f64, Packet)> {
        at.iter().map(|(at_s, sequence)| (*at_s, packet(start, pose(*sequence)))).collect()
    };
    let first = [vec![(0.0, sent(&hello(5)))], box_of(5, &[(0.0, 100), (0.02, 101)])].concat();
    // The box restarts, with the same capture times; its Hello comes after some of its poses.
    let second = [box_of(6, &[(10.0, 0), (10.02, 1)]), vec![(10.5, sent(&hello(6)))]].concat();
    hear(&mut receiver, start, &first);
    hear(&mut receiver, start, &second);
    hear(&mut receiver, start, &box_of(6, &[(10.52, 26)]));
    assert_eq!(receiver.sessions(), 2);
    receiver.finish(start + Duration::from_secs(11)).unwrap();
    let rows: Vec<_> = poses::parse(csv.text().as_bytes(), "poses.csv").unwrap();
    let times: Vec<_> = rows.iter().step_by(2).map(|row| (row.frame, row.time_s)).collect();
    assert_eq!(times, [(100, 0.0), (101, 0.02), (0, 10.0), (1, 10.02), (26, 10.52)]);
    let sessions: Vec<_> = self::rows(&csv.text()).iter().step_by(2).map(|row| row.2).collect();
    assert_eq!(sessions, [1, 1, 2, 2, 2]);
    let notices = receiver.take_notices().join("; ");
    assert!(notices.contains("the box has restarted"), "{notices}");
}

fn health(camera: CameraState, uptime_ms: u64, frames: u32) -> Message {
    Message::Health(Health {
        uptime_ms,
        frames,
        frames_dropped: 0,
        frames_missed: 0,
        camera_losses: u32::from(frames > 0 && camera == CameraState::Lost),
        corners_dropped: 0,
        heap_allocations: None,
        temperature_decicelsius: None,
        undervoltage: None,
        throttled: None,
        camera,
        aiming_s: 0,
        latency_us_max: 0,
        logs_dropped: 0,
        trigger: Default::default(),
        links: [].into_iter().collect(),
    })
}

#[test]
fn set_up_mode_is_said_when_it_begins_and_when_it_is_over() {
    let (mut receiver, _) = receiver();
    let aiming = |uptime_ms: u64, aiming_s: u16| {
        let Message::Health(before) = health(CameraState::Running, uptime_ms, 1) else {
            unreachable!("a Health")
        };
        Message::Health(Health { aiming_s, ..before })
    };
    let messages = [aiming(0, 0), aiming(100, 10), aiming(200, 9), aiming(300, 0)];
    take(&mut receiver, Instant::now(), &messages);
    assert_eq!(
        receiver.take_notices(),
        ["the box is in set-up mode: pictures may leave it", "the box has left set-up mode"]
    );
}

#[test]
fn a_box_that_fell_silent_is_not_said_to_run() {
    let (mut receiver, _) = receiver();
    let running = health(CameraState::Running, 5000, 2);
    let now = take(&mut receiver, Instant::now(), &[hello(START), pose(0), running]);
    let later = now + Duration::from_secs(7);
    assert_eq!(receiver.unheard(later), Some(Duration::from_secs(7)));
    // One whose recording is over has said so.
    take(&mut receiver, now, &[health(CameraState::Ended, 5100, 2)]);
    assert_eq!(receiver.unheard(later), None);
}

#[test]
fn frames_belong_to_the_start_that_sent_them() {
    let (mut receiver, csv) = receiver();
    let start = Instant::now();
    let lost = health(CameraState::Lost, 3000, 0);
    hear(&mut receiver, start, &[(0.0, sent(&hello(1))), (0.1, packet(1, pose(0)))]);
    hear(&mut receiver, start, &[(0.2, packet(1, pose(1)))]);
    // It restarts without a camera: what the start before has measured is over.
    hear(&mut receiver, start, &[(5.0, sent(&hello(2))), (5.1, packet(2, lost))]);
    assert!(receiver.latest(start + Duration::from_secs_f64(5.1)).is_none());
    assert_eq!(receiver.sessions(), 2);
    // And once more, with frames.
    hear(&mut receiver, start, &[(9.0, sent(&hello(3))), (9.1, packet(3, pose(0)))]);
    assert_eq!(receiver.sessions(), 3);
    let frames: Vec<u64> = receiver.runs().iter().map(|run| run.frames).collect();
    assert_eq!(frames, [2, 0, 1]);
    let sessions: Vec<_> = rows(&csv.text()).iter().step_by(2).map(|row| row.2).collect();
    assert_eq!(sessions, [1, 1, 3]);
}

#[test]
fn the_rate_is_that_of_the_periods() {
    let start = Instant::now();
    for (rate_hz, sequences) in [(60.0, 600), (24.0, 240), (60.0, 7)] {
        let (mut receiver, _) = receiver();
        receiver.handle(event(hello(START)), start).unwrap();
        let at = |sequence: u32| start + Duration::from_secs_f64(f64::from(sequence) / rate_hz);
        for sequence in 0..sequences {
            receiver.handle(event(pose(sequence)), at(sequence)).unwrap();
        }
        // Whenever between two packets it is looked at.
        for after_ms in [0, 5, 15] {
            let shown_hz = receiver.rate_hz(at(sequences - 1) + Duration::from_millis(after_ms));
            assert!((shown_hz - rate_hz).abs() < 0.01, "{shown_hz} for {rate_hz}");
        }
    }
    let (receiver, _) = receiver();
    assert_eq!(receiver.rate_hz(start), 0.0);
}

#[test]
fn other_programs_packets_are_counted_apart() {
    use plumbline::packet::{PROTOCOL_VERSION, PacketError};
    let (mut receiver, _) = receiver();
    let version = PROTOCOL_VERSION + 1;
    for error in [
        PacketError::OtherVersion { version },
        PacketError::OtherVersion { version },
        PacketError::OtherSchema { hash: 1 },
        PacketError::Body,
        PacketError::Number,
        PacketError::Checksum,
        PacketError::Cobs,
        PacketError::Oversize,
        PacketError::Short,
        PacketError::Fragment,
    ] {
        receiver.handle(Event::Bad(error), Instant::now()).unwrap();
    }
    let wanted = crate::bad_packets::BadPackets {
        corrupt: 4,
        fragments: 1,
        other_version: 2,
        other_schema: 1,
        malformed: 1,
        numbers: 1,
        not_authentic: 0,
    };
    assert_eq!(receiver.bad(), wanted);
    let notices = receiver.take_notices();
    assert_eq!(notices.len(), 4, "once for each kind: {notices:?}");
}

#[test]
fn a_recording_of_nothing_is_no_file() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("poses.csv");
    let read = || std::fs::read_to_string(&path).ok();
    let hear = |messages: &[Message]| {
        let file = plumbline_files::Late::new(&path, true).unwrap();
        let mut receiver = Receiver::new(Some(Recorder::new(file, "poses.csv")));
        for message in messages {
            receiver.handle(event(message.clone()), Instant::now()).unwrap();
        }
        receiver.finish(Instant::now()).unwrap();
    };
    hear(&[]);
    hear(&[hello(START)]);
    assert_eq!(read(), None);
    std::fs::write(&path, "precious").unwrap();
    hear(&[hello(START)]);
    assert_eq!(read().as_deref(), Some("precious"));
    hear(&[hello(START), pose(0)]);
    let csv = read().unwrap();
    assert!(csv.starts_with(HEADER) && rows(&csv).len() == 2, "{csv}");

    // What is in the way is said before anything comes.
    let error = plumbline_files::Late::new(&path, false).unwrap_err();
    assert!(error.to_string().contains("--force"), "{error}");
    assert_eq!(read().unwrap(), csv);
    plumbline_files::Late::new(directory.path(), true).unwrap_err();
    let error = plumbline_files::Late::new(&path.join("poses.csv"), true).unwrap_err();
    assert!(error.remedy.contains("a file is in its place"), "{error}");
}

#[test]
fn places_that_cannot_be_listened_at_are_explained() {
    let first = Udp::bind("127.0.0.1:0".parse().unwrap()).unwrap();
    let error = Udp::bind(first.local_address().unwrap()).err().unwrap();
    assert!(error.to_string().contains("another program listens there"), "{error}");
    let error = Udp::bind("192.0.2.1:4210".parse().unwrap()).err().unwrap();
    assert!(error.to_string().contains("its addresses: 0.0.0.0:4210"), "{error}");
    let error = Serial::open("/dev/no-such-device", 115_200).err().unwrap();
    assert!(error.to_string().contains("there is no such device"), "{error}");
    let error = Serial::open("/dev/null", 115_200).err().unwrap();
    assert!(!error.found.is_empty() && error.place == "/dev/null", "{error}");
}

/// A disk that fills up.
struct Full;

impl Write for Full {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if bytes.starts_with(b"frame") { Ok(bytes.len()) } else { Err(self.flush().unwrap_err()) }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Err(std::io::ErrorKind::StorageFull.into())
    }
}

#[test]
fn a_full_disk_ends_the_recording_with_a_reason() {
    let mut receiver = Receiver::new(Some(Recorder::new(Full, "poses.csv")));
    let mut hear = |message| receiver.handle(event(message), Instant::now());
    hear(hello(START)).unwrap();
    let error = hear(pose(0)).unwrap_err();
    assert_eq!(error.remedy, "make room on the disk");
}
