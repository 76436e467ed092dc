//! The poses for other programs: what programs of the Lab Streaming Layer, readers of JSON and OSC
//! get, and that the recording beside it is whole.
//!
//! Discovery by LSL stays on this computer and at ports that belong to a test: see [`settings`].

use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use common::python::python;
use nix::time::{ClockId, clock_gettime};
use plumbline::packet::{
    Action, Command as Question, Hello, MarkedInstant, Message, PosePacket, ReplyOutcome,
};
use plumbline::target::Role;
use plumbline_stream::fixture::{self, SealedBox};
use plumbline_test_support::root;
use plumbline_trial::Trial;
use serde_json::Value;

use crate::bench::{Bench, RATE_HZ, assert_whole, sorted, wait_for};
use crate::relay::{Faults, Relay};

/// Says how long the frames are taken; ten minutes show more than a test's minute.
const SECONDS: &str = "PLUMBLINE_STREAM_SECONDS";

/// Times must be true to this: see [`Taken::within_s`].
const WITHIN_S: f64 = 1e-3;

fn script() -> PathBuf {
    root().join("tests/link/streams.py")
}

/// Ports for LSL on this computer, free at this moment: one for discovery and as many in a row as
/// all streams of a test need.
fn ports() -> (u16, u16) {
    let free = |port: u16| {
        UdpSocket::bind(("127.0.0.1", port)).is_ok()
            && TcpListener::bind(("127.0.0.1", port)).is_ok()
    };
    let any = || UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let first = || Some(any()).filter(|it| *it < 65_000 && (*it..=*it + PORTS).all(free));
    let first = std::iter::repeat_with(first).take(1000).flatten().next().expect("free ports");
    (first, first + 1)
}

/// Three streams of `plumb` and one of stimuli, and the sockets of those who ask for them.
const PORTS: u16 = 12;

/// Settings of LSL by which it asks for streams at the ports of this test on this computer, and
/// nowhere else.
fn settings() -> String {
    let (discovery, base) = ports();
    format!(
        "[ports]\nMulticastPort = {discovery}\nBasePort = {base}\nPortRange = {PORTS}\nIPv6 = disable\n\
         [multicast]\nResolveScope = machine\nAddressesOverride = {{127.0.0.1}}\n\
         ListenAddress = 127.0.0.1\n\
         [lab]\nKnownPeers = {{127.0.0.1}}\nSessionID = test-{discovery}\n[log]\nlevel = -2\n"
    )
}

/// A bench whose programs find liblsl; `None` without Python.
fn bench() -> Option<(Bench, PathBuf)> {
    let python = python()?;
    let mut bench = Bench::new()?;
    bench.write("lsl_api.cfg", &settings());
    let library = Command::new(&python).arg(script()).arg("library").output().unwrap();
    let library = String::from_utf8(library.stdout).unwrap();
    assert!(Path::new(library.trim()).exists(), "{library}");
    bench.environment = vec![
        ("PLUMBLINE_LIBLSL", OsString::from(library.trim())),
        ("LSLAPICFG", bench.path("lsl_api.cfg").into_os_string()),
    ];
    Some((bench, python))
}

/// A program of the Lab Streaming Layer.
fn take(bench: &Bench, python: &Path, seconds: f64, wishes: &[&str]) -> Child {
    let mut command = Command::new(python);
    command.arg(script()).args(["take", &seconds.to_string()]).arg(bench.path("taken.json"));
    command
        .args(wishes)
        .envs(bench.environment.iter().cloned())
        .env("PYTHONDONTWRITEBYTECODE", "1");
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().unwrap();
    // It takes them from here on.
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert_eq!(line.trim(), "taking");
    child
}

/// What it took.
struct Taken {
    times_s: Vec<f64>,
    all: Value,
}

impl Taken {
    #[track_caller]
    fn of(bench: &Bench, mut program: Child) -> Self {
        assert!(program.wait().unwrap().success());
        let all: Value = serde_json::from_slice(&bench.read("taken.json")).unwrap();
        Self { times_s: numbers(&all["times"]), all }
    }

    fn column(&self, label: &str) -> Vec<f64> {
        column(&self.all, label)
    }

    /// To this its times must be true. On a computer that answers late because it is busy, the error
    /// that is stated is larger, and nobody can know better.
    fn within_s(&self) -> f64 {
        self.column("time_error").into_iter().fold(WITHIN_S, f64::max)
    }

    fn xml(&self) -> &str {
        self.all["xml"].as_str().unwrap()
    }
}

fn numbers(list: &Value) -> Vec<f64> {
    list.as_array().unwrap().iter().map(|it| it.as_f64().unwrap_or(f64::NAN)).collect()
}

fn column(of: &Value, label: &str) -> Vec<f64> {
    column_of(of, "rows", label)
}

fn column_of(of: &Value, rows: &str, label: &str) -> Vec<f64> {
    let labels = of["labels"].as_array().unwrap();
    let at = labels.iter().position(|it| it == label).expect(label);
    of[rows].as_array().unwrap().iter().map(|row| row[at].as_f64().unwrap_or(f64::NAN)).collect()
}

/// A client of the lines of JSON, which takes so many lines at most; the lines.
fn client(address: SocketAddr, lines: usize) -> JoinHandle<Vec<Value>> {
    let stream = TcpStream::connect(address).unwrap();
    thread::spawn(move || {
        let lines = BufReader::new(stream).lines().map_while(Result::ok).take(lines);
        lines.map(|line| serde_json::from_str(&line).unwrap()).collect()
    })
}

fn frames(lines: &[Value]) -> Vec<u64> {
    let frames = lines.iter().filter(|it| it["kind"] == "frame");
    frames.map(|it| it["frame"].as_u64().unwrap()).collect()
}

#[test]
fn every_frame_reaches_everybody_and_the_recording_is_whole() {
    let Some((bench, python)) = bench() else { return };
    let seconds = std::env::var(SECONDS).map_or(60.0, |it| it.parse().unwrap());
    let osc = UdpSocket::bind("127.0.0.1:0").unwrap();
    osc.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    let to = osc.local_addr().unwrap();
    let relay = Relay::new(&bench.hosts, 11);
    let mut receive = bench.receive(0, "trial", &format!("--lsl --json 0 --osc {to}"));
    let mut the_box = bench.start(&relay, "sent.bin");

    let mut address = None;
    wait_for("the address for JSON", || {
        let said = receive.said();
        let words = said.split_once("connects to ").and_then(|(_, rest)| rest.lines().next());
        address = words.map(|it| it.parse().unwrap());
        address.is_some()
    });
    let address = address.unwrap();
    let clients: Vec<_> = (0..7).map(|_| client(address, usize::MAX)).collect();
    let leaver = client(address, 100);
    let idle = TcpStream::connect(address).unwrap();
    let heard = thread::spawn(move || {
        let mut bytes = [0; 2048];
        let packets =
            std::iter::from_fn(|| osc.recv(&mut bytes).ok().map(|it| bytes[..it].to_vec()));
        packets.filter(|it| it.starts_with(b"#bundle\0")).count()
    });

    let taken = Taken::of(&bench, take(&bench, &python, seconds, &[]));
    receive.interrupt();
    let said = receive.succeeds();
    the_box.end();
    let whole = assert_whole(&bench, "trial", "sent.bin");
    drop(idle);

    // The Lab Streaming Layer: none missing, each with the numbers that were recorded.
    let numbers_taken = taken.column("frame");
    assert!(
        numbers_taken.len() as f64 > (seconds - 1.0) * RATE_HZ as f64,
        "{}",
        numbers_taken.len()
    );
    assert!(numbers_taken.windows(2).all(|pair| pair[1] - pair[0] == 1.0), "a frame is missing");
    let recorded = sorted(bench.recorded("trial"));
    let first = recorded[0].sequence;
    let (depth_mm, ap_mm) = (taken.column("lower_cam_z"), taken.column("upper_ap"));
    for (index, number) in numbers_taken.iter().enumerate() {
        let packet: &PosePacket = &recorded[*number as usize - first as usize];
        let pose = packet.pose(Role::Lower).expect("a pose in every frame");
        // Single precision, as the box sends it.
        assert_eq!(depth_mm[index] as f32, pose.translation_mm[2]);
        assert_eq!(ap_mm[index] as f32, packet.upper_trunk.unwrap().ap_mm);
    }
    // A recording has its own times: the frames keep its pace, and none has come before it was sent.
    let (first_s, first_number) = (taken.times_s[0], numbers_taken[0]);
    let latency_s = taken.column("latency");
    let received_s = numbers(&taken.all["received"]);
    let mut soonest_s = f64::INFINITY;
    let mut furthest_s = 0.0_f64;
    for (index, at_s) in taken.times_s.iter().enumerate() {
        let due_s = first_s + (numbers_taken[index] - first_number) / RATE_HZ as f64;
        furthest_s = furthest_s.max((at_s - due_s).abs());
        soonest_s = soonest_s.min(received_s[index] - at_s - latency_s[index]);
    }
    println!(
        "{} frames by LSL, off their pace by {:.3} ms at most; the soonest was under way for {:.3} ms",
        numbers_taken.len(),
        1e3 * furthest_s,
        1e3 * soonest_s
    );
    assert!(furthest_s < taken.within_s(), "{furthest_s}");
    assert!((-1e-6..taken.within_s()).contains(&soonest_s), "{soonest_s}");

    // JSON: seven clients have every frame from their first on; the one that left disturbed nobody.
    for client in clients {
        let lines = client.join().unwrap();
        assert_eq!((&lines[0]["kind"], &lines[0]["format"]), (&"stream".into(), &1.into()));
        let numbers = frames(&lines);
        let last = u64::from(recorded.last().unwrap().sequence);
        assert!(numbers.iter().copied().eq(numbers[0]..=last), "{:?}", numbers.last());
        assert!(numbers.len() as f64 > (seconds - 1.0) * RATE_HZ as f64);
        assert_eq!(lines.last().unwrap()["kind"], "end");
    }
    assert_eq!(leaver.join().unwrap().len(), 100);
    let bundles = heard.join().unwrap();
    assert!(bundles.abs_diff(whole) <= 60, "{bundles} bundles of {whole} frames");
    for words in
        ["0 missing, 0 of them late", "stream Plumbline: ", ": 9 clients", "OSC to 127.0.0.1:"]
    {
        assert!(said.contains(words), "no {words:?} in {said}");
    }
}

fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC).unwrap();
    now.tv_sec() as u64 * 1_000_000_000 + now.tv_nsec() as u64
}

/// A box whose clock is far ahead of this computer's and faster by 80 ppm.
#[derive(Clone, Copy)]
struct BoxClock {
    zero_ns: u64,
}

impl BoxClock {
    fn box_ns(self, mono_ns: u64) -> u64 {
        let since_ns = mono_ns - self.zero_ns;
        7_000_000_000_000 + since_ns + since_ns * 8 / 100_000
    }
}

const PERIOD_NS: u64 = 16_666_667;

/// From a frame's exposure until its packet is sent.
const LATENCY_NS: u64 = 1_200_000;

/// Frames that nobody ever gets.
const LOST: std::ops::Range<u32> = 400..405;

/// A played box at 60 Hz, whose exposures lie at known times of this computer's clock.
fn played(host: SocketAddr, clock: BoxClock, stop: Arc<AtomicBool>) -> JoinHandle<()> {
    thread::spawn(move || {
        let mut sealed = SealedBox::new(host, fixture::START);
        sealed.meet();
        let hello =
            Message::Hello(Hello { boot_id: fixture::START, ..fixture::hello(&fixture::config()) });
        let mut number = ((now_ns() - clock.zero_ns) / PERIOD_NS + 2) as u32;
        let first = number;
        while !stop.load(Ordering::Relaxed) {
            if (number - first).is_multiple_of(RATE_HZ as u32) {
                sealed.send(&hello);
            }
            let exposed_ns = exposed_ns(clock, number);
            loop {
                for (listener, message) in sealed.receive() {
                    let Message::Command(Question {
                        id,
                        action: Action::Ping { host_sent_ns },
                        ..
                    }) = message
                    else {
                        continue;
                    };
                    let box_ns = clock.box_ns(now_ns());
                    let outcome = ReplyOutcome::Pong {
                        host_sent_ns,
                        box_received_ns: box_ns,
                        box_sent_ns: box_ns,
                        stream_next: sealed.end().stream_next(),
                    };
                    sealed.answer(listener, id, outcome);
                }
                if now_ns() >= exposed_ns + LATENCY_NS {
                    break;
                }
                thread::sleep(Duration::from_micros(200));
            }
            let pose = Message::Pose(PosePacket {
                capture_time_ns: clock.box_ns(exposed_ns),
                instant: MarkedInstant::ExposureMiddle,
                latency_us: (LATENCY_NS / 1000) as u32,
                ..fixture::pose_packet(number)
            });
            if LOST.contains(&(number - first)) {
                sealed.lose(&pose);
                sealed.forget();
            } else {
                sealed.send(&pose);
            }
            number += 1;
        }
        sealed.live(Duration::from_millis(500));
    })
}

fn exposed_ns(clock: BoxClock, number: u32) -> u64 {
    clock.zero_ns + u64::from(number) * PERIOD_NS
}

/// Truth: the box and this computer have one monotonic clock, which is LSL's too; what the box says
/// is its own, other one.
#[test]
fn times_are_true_to_a_millisecond_and_a_marker_is_t_zero() {
    let Some((bench, python)) = bench() else { return };
    let clock = BoxClock { zero_ns: now_ns() };
    let mut receive = bench.receive(0, "trial", "--lsl --mark-lsl Stimuli");
    let stop = Arc::<AtomicBool>::default();
    let the_box = played(bench.hosts[0], clock, Arc::clone(&stop));
    let taken = Taken::of(&bench, take(&bench, &python, 15.0, &["record", "mark"]));
    receive.interrupt();
    let said = receive.succeeds();
    stop.store(true, Ordering::Relaxed);
    the_box.join().unwrap();

    let truth_s = |number: f64| 1e-9 * exposed_ns(clock, number as u32) as f64;
    let error_s = |times_s: &[f64], numbers: &[f64]| {
        let errors =
            times_s.iter().zip(numbers).map(|(at_s, number)| (at_s - truth_s(*number)).abs());
        errors.fold(0.0, f64::max)
    };
    let numbers_taken = taken.column("frame");
    assert!(numbers_taken.len() > 800, "{}", numbers_taken.len());
    assert!(numbers_taken.windows(2).all(|pair| pair[1] - pair[0] == 1.0), "a sample is missing");
    let within_s = taken.within_s();
    // What is stated is true, too.
    let stated_s = taken.column("time_error");
    for ((at_s, number), stated_s) in taken.times_s.iter().zip(&numbers_taken).zip(&stated_s) {
        let error_s = (at_s - truth_s(*number)).abs();
        assert!(
            stated_s.is_nan() || error_s <= stated_s + 1e-5,
            "{number}: {error_s} > {stated_s}"
        );
    }
    let live_s = error_s(&taken.times_s, &numbers_taken);
    assert!(live_s < within_s, "{live_s}");
    let depth_mm = taken.column("lower_cam_z");
    let missing: Vec<f64> = depth_mm
        .iter()
        .zip(&numbers_taken)
        .filter(|(it, _)| it.is_nan())
        .map(|(_, number)| *number)
        .collect();
    assert!(missing.len() <= LOST.len(), "{missing:?}");
    for part in [
        "<serial_number>PL-0001</serial_number>",
        "<label>lower_ap</label>",
        "<type>MoCap</type>",
        "<time_error_s>0.00",
        "middle of the exposure",
        "<device>ward 3</device>",
    ] {
        assert!(taken.xml().contains(part), "no {part} in {}", taken.xml());
    }

    // The marker is t = 0 of the trial.
    let mark_s = taken.all["mark"].as_f64().unwrap();
    let trial = Trial::open(&bench.path("trial")).unwrap();
    let event = &trial.manifest.events[0];
    assert_eq!((&*event.label, event.source.word()), ("zero", "lsl"));
    let first = sorted(bench.recorded("trial")).remove(0);
    let wanted_s = 1e-9 * (clock.box_ns((1e9 * mark_s) as u64) - first.capture_time_ns) as f64;
    let zero_error_s = event.time_s - wanted_s;
    assert!(zero_error_s.abs() < within_s, "{zero_error_s}");

    // XDF: what LSL's own recorder wrote, read by pyxdf.
    let xdf = &taken.all["xdf"];
    assert_eq!(xdf["names"], serde_json::json!(["Plumbline", "Plumbline-late", "Plumbline-marks"]));
    assert_eq!(xdf["labels"], taken.all["labels"]);
    let (times_s, numbers_kept) = (numbers(&xdf["times"]), column(xdf, "frame"));
    assert!(times_s.len() > 800 && xdf["footer"] == times_s.len());
    let kept_s = error_s(&times_s, &numbers_kept);
    assert!(kept_s < within_s, "{kept_s}");
    assert_eq!(xdf["marks"], serde_json::json!(["zero"]));
    let marked_s = numbers(&xdf["mark_times"])[0] - mark_s;
    assert!(marked_s.abs() < within_s, "{marked_s}");
    println!(
        "largest errors: live {:.3} ms (stated: {:.3} at first, {:.3} at the end), XDF {:.3} ms, \
         the marker as t = 0 {:.3} ms, in XDF {:.3} ms",
        1e3 * live_s,
        1e3 * stated_s[0],
        1e3 * stated_s.last().unwrap(),
        1e3 * kept_s,
        1e3 * zero_error_s,
        1e3 * marked_s
    );
    assert!(said.contains("1 mark"), "{said}");
}

/// For two seconds little comes through; then all of it does, much of it too late for its place. (What
/// is lost while nothing comes is not late: it comes in order, before what follows it.)
#[test]
fn what_comes_late_is_nan_in_its_place_and_has_a_stream_of_its_own() {
    let Some((bench, python)) = bench() else { return };
    let relay = Relay::new(&bench.hosts, 13);
    let mut receive = bench.receive(0, "trial", "--lsl");
    let mut the_box = bench.start(&relay, "sent.bin");
    let program = take(&bench, &python, 15.0, &["record"]);
    thread::sleep(Duration::from_secs(3));
    relay.set(0, Faults::lost(0.8));
    thread::sleep(Duration::from_secs(2));
    relay.set(0, Faults::default());
    let taken = Taken::of(&bench, program);
    receive.interrupt();
    receive.succeeds();
    the_box.end();
    assert_whole(&bench, "trial", "sent.bin");

    let numbers_taken = taken.column("frame");
    assert!(numbers_taken.windows(2).all(|pair| pair[1] - pair[0] == 1.0), "a sample is missing");
    assert!(taken.times_s.windows(2).all(|pair| pair[1] > pair[0]), "times go back");
    let missing_of = |numbers: &[f64], depth_mm: &[f64]| -> Vec<(usize, f64)> {
        let all = numbers.iter().zip(depth_mm).enumerate();
        all.filter(|(_, (_, depth_mm))| depth_mm.is_nan()).map(|(at, (it, _))| (at, *it)).collect()
    };
    let missing = missing_of(&numbers_taken, &taken.column("lower_cam_z"));
    assert!(!missing.is_empty());
    // Each has come after all, with the time that its place had.
    let xdf = &taken.all["xdf"];
    let late = column_of(xdf, "late_rows", "frame");
    assert!(column_of(xdf, "late_rows", "lower_cam_z").iter().all(|it| it.is_finite()));
    let late_s = numbers(&xdf["late_times"]);
    let mut of_late: Vec<(f64, f64)> = late.into_iter().zip(late_s).collect();
    of_late.sort_by(|one, other| one.0.total_cmp(&other.0));
    assert_eq!(of_late.len(), missing.len());
    for ((at, number), (late, late_s)) in missing.iter().zip(&of_late) {
        assert_eq!(number, late);
        let error_s = taken.times_s[*at] - late_s;
        assert!(error_s.abs() < taken.within_s(), "{number}: {error_s}");
    }
    println!("{} frames came late", of_late.len());
}

#[test]
fn without_the_library_it_says_what_to_install() {
    let Some(mut bench) = Bench::new() else { return };
    bench.environment = vec![("PLUMBLINE_LIBLSL", "/nowhere/liblsl.so".into())];
    let started = Instant::now();
    let output = bench.plumb("receive --udp 127.0.0.1:0 --lsl");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("/nowhere/liblsl.so: cannot be loaded"), "{said}");
    assert!(said.contains("install liblsl"), "{said}");
    assert!(started.elapsed() < Duration::from_secs(20));
}
