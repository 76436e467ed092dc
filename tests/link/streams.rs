//! The poses for other programs: what programs of the Lab Streaming Layer, readers of JSON and OSC
//! get, and that the recording beside it is whole.
//!
//! Discovery by LSL stays on this computer and at ports that belong to a test: see [`Lab`].

use std::io::{BufRead, BufReader, ErrorKind};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use common::lsl::{self, Lab, Taken};
use nix::time::{ClockId, clock_gettime};
use plumbline::packet::{
    Action, Command as Question, Hello, MarkedInstant, Message, PosePacket, Reply, ReplyOutcome,
    decode_datagram,
};
use plumbline::target::Role;
use plumbline_stream::clock::Exchange;
use plumbline_stream::fixture::{self, SealedBox};
use plumbline_stream::transport::Raw;
use plumbline_trial::Trial;
use plumbline_trial::journal::Content;
use serde_json::Value;

use crate::bench::{Bench, RATE_HZ, assert_whole, sorted, wait_for};
use crate::relay::{Faults, Relay};

/// Says how long the frames are taken; ten minutes show more than a test's minute.
const SECONDS: &str = "PLUMBLINE_STREAM_SECONDS";

/// Times must be true to this, or to what is stated of them where that is more: on a computer that
/// answers late because it is busy, nobody can know better.
const WITHIN_S: f64 = 1e-3;

/// Two clocks differ by less, played and real ones.
const PACE_PPM: f64 = 100.0;

/// Times are whole nanoseconds; in seconds they are rounded to less than one.
const ROUNDED_S: f64 = 1e-9;

/// What is stated of a time without any answer: see [`stated`].
const UNKNOWN_S: f64 = 0.1;

/// A bench whose programs find liblsl; `None` without Python.
fn bench() -> Option<(Bench, Lab)> {
    let mut bench = Bench::new()?;
    let lab = Lab::new(&bench.path(""))?;
    bench.environment = lab.environment.clone();
    Some((bench, lab))
}

/// The box's answers in a trial, by their arrival.
fn answers(bench: &Bench, trial: &str) -> Vec<Exchange> {
    let exchange = |entry: plumbline_trial::journal::Entry| {
        let Content::Raw(Raw::Datagram(bytes)) = entry.content else { return None };
        let Message::Reply(Reply {
            outcome: ReplyOutcome::Pong { host_sent_ns, box_received_ns, box_sent_ns, .. },
            ..
        }) = decode_datagram(&bytes).ok()?.message
        else {
            return None;
        };
        let host_received_ns = entry.host_ns;
        Some(Exchange { host_sent_ns, box_received_ns, box_sent_ns, host_received_ns })
    };
    bench.entries(trial).into_iter().filter_map(exchange).collect()
}

/// When each frame came, by its number, since the trial began.
fn arrivals_ns(bench: &Bench, trial: &str) -> std::collections::HashMap<u32, u64> {
    let arrival = |entry: plumbline_trial::journal::Entry| {
        let Content::Raw(Raw::Datagram(bytes)) = entry.content else { return None };
        let Message::Pose(pose) = decode_datagram(&bytes).ok()?.message else { return None };
        Some((pose.sequence, entry.host_ns))
    };
    bench.entries(trial).into_iter().filter_map(arrival).collect()
}

/// The error that is stated of each sample's time; for a frame that is missing, the one before it.
/// None may be larger than the quickest answer before the frame allows: half of the time that it was
/// under way, and the clocks' pace since (`by_answers`: the box's clock is that of the frames), or all of
/// that time.
#[track_caller]
fn stated(bench: &Bench, trial: &str, taken: &Taken, by_answers: bool) -> Vec<f64> {
    let answers = answers(bench, trial);
    let arrivals_ns = arrivals_ns(bench, trial);
    let mut last_s = UNKNOWN_S;
    let stated = taken.column("time_error").into_iter().zip(taken.frames());
    let stated = stated.map(|(stated_s, number)| {
        if stated_s.is_nan() {
            return last_s;
        }
        last_s = stated_s;
        let arrival_ns = arrivals_ns[&(number as u32)];
        let before = answers.iter().filter(|it| it.host_received_ns <= arrival_ns);
        let quickest = before.min_by_key(|it| it.round_trip_ns());
        let allowed_s = quickest.map_or(UNKNOWN_S, |it| {
            let way_s = 1e-9 * it.round_trip_ns() as f64;
            let since_s = 1e-9 * arrival_ns.saturating_sub(it.host_sent_ns) as f64;
            if by_answers { 0.5 * way_s + 1e-6 * PACE_PPM * since_s } else { way_s }
        });
        assert!(
            stated_s <= allowed_s + ROUNDED_S,
            "{number}: {stated_s} s where {allowed_s} are known"
        );
        stated_s
    });
    stated.collect()
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
    let Some((bench, lab)) = bench() else { return };
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
        let packets = std::iter::from_fn(|| {
            loop {
                match osc.recv(&mut bytes) {
                    Ok(length) => return Some(bytes[..length].to_vec()),
                    // The program was stopped, and goes on.
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(_) => return None,
                }
            }
        });
        packets.filter(|it| it.starts_with(b"#bundle\0")).count()
    });

    let taking = lab.take(&[]);
    thread::sleep(Duration::from_secs_f64(seconds));
    let taken = taking.end();
    receive.interrupt();
    let said = receive.succeeds();
    the_box.end();
    let whole = assert_whole(&bench, "trial", "sent.bin");
    drop(idle);

    // The Lab Streaming Layer: none missing, each with the numbers that were recorded.
    let numbers_taken = taken.frames();
    assert!(
        numbers_taken.len() as f64 > (seconds - 1.0) * RATE_HZ as f64,
        "{}",
        numbers_taken.len()
    );
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
    let stated_s = stated(&bench, "trial", &taken, false);
    let last = numbers_taken.len() - 1;
    let latency_s = taken.column("latency");
    let received_s = lsl::numbers(&taken.all["received"]);
    let mut soonest_s = f64::INFINITY;
    let mut furthest_s = 0.0_f64;
    for (index, at_s) in taken.times_s.iter().enumerate() {
        let due_s =
            taken.times_s[last] + (numbers_taken[index] - numbers_taken[last]) / RATE_HZ as f64;
        let error_s = (at_s - due_s).abs();
        assert!(error_s < WITHIN_S.max(stated_s[index]), "{error_s} at {}", numbers_taken[index]);
        furthest_s = furthest_s.max(error_s);
        soonest_s = soonest_s.min(received_s[index] - at_s - latency_s[index]);
    }
    println!(
        "{} frames by LSL, off their pace by {:.3} ms at most; the soonest was under way for {:.3} ms",
        numbers_taken.len(),
        1e3 * furthest_s,
        1e3 * soonest_s
    );
    assert!((-1e-6..WITHIN_S.max(stated_s[last])).contains(&soonest_s), "{soonest_s}");

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
    let Some((bench, lab)) = bench() else { return };
    let clock = BoxClock { zero_ns: now_ns() };
    let mut receive = bench.receive(0, "trial", "--lsl --mark-lsl Stimuli");
    let stop = Arc::<AtomicBool>::default();
    let the_box = played(bench.hosts[0], clock, Arc::clone(&stop));
    let mut taking = lab.take(&["record", "mark"]);
    thread::sleep(Duration::from_secs(4));
    taking.mark("zero");
    thread::sleep(Duration::from_secs(11));
    let taken = taking.end();
    receive.interrupt();
    let said = receive.succeeds();
    stop.store(true, Ordering::Relaxed);
    the_box.join().unwrap();

    let truth_s = |number: f64| 1e-9 * exposed_ns(clock, number as u32) as f64;
    let numbers_taken = taken.frames();
    assert!(numbers_taken.len() > 800, "{}", numbers_taken.len());
    // What is stated is true, and no more than is needed.
    let stated_s = stated(&bench, "trial", &taken, true);
    let mut live_s = 0.0_f64;
    for ((at_s, number), stated_s) in taken.times_s.iter().zip(&numbers_taken).zip(&stated_s) {
        let error_s = (at_s - truth_s(*number)).abs();
        assert!(error_s <= stated_s + 1e-5, "{number}: {error_s} > {stated_s}");
        assert!(error_s < WITHIN_S.max(*stated_s), "{number}: {error_s}");
        live_s = live_s.max(error_s);
    }
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
    let mark_s = taken.marks_s()[0];
    let trial = Trial::open(&bench.path("trial")).unwrap();
    let event = &trial.manifest.events[0];
    assert_eq!((&*event.label, event.source.word()), ("zero", "lsl"));
    let first = sorted(bench.recorded("trial")).remove(0);
    let wanted_s = 1e-9 * (clock.box_ns((1e9 * mark_s) as u64) - first.capture_time_ns) as f64;
    let zero_error_s = event.time_s - wanted_s;
    // By all answers of the trial, of which those that come later are as good.
    let within_s = WITHIN_S.max(*stated_s.last().unwrap());
    assert!(zero_error_s.abs() < within_s, "{zero_error_s}");

    // XDF: what LSL's own recorder wrote, read by pyxdf.
    let xdf = &taken.all["xdf"];
    assert_eq!(xdf["names"], serde_json::json!(["Plumbline", "Plumbline-late", "Plumbline-marks"]));
    assert_eq!(xdf["labels"], taken.all["labels"]);
    let (times_s, numbers_kept) = (lsl::numbers(&xdf["times"]), lsl::column(xdf, "rows", "frame"));
    assert!(times_s.len() > 800 && xdf["footer"] == times_s.len());
    let (mut kept_s, mut kept_stated_s) = (0.0_f64, 0.0);
    let kept_stated = lsl::column(xdf, "rows", "time_error");
    for ((at_s, number), stated_s) in times_s.iter().zip(&numbers_kept).zip(kept_stated) {
        if stated_s.is_finite() {
            kept_stated_s = stated_s;
        }
        let error_s = (at_s - truth_s(*number)).abs();
        assert!(error_s < WITHIN_S.max(kept_stated_s), "{number}: {error_s}");
        kept_s = kept_s.max(error_s);
    }
    assert_eq!(xdf["marks"], serde_json::json!(["zero"]));
    let marked_s = lsl::numbers(&xdf["mark_times"])[0] - mark_s;
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
    let Some((bench, lab)) = bench() else { return };
    let relay = Relay::new(&bench.hosts, 13);
    let mut receive = bench.receive(0, "trial", "--lsl");
    let mut the_box = bench.start(&relay, "sent.bin");
    let taking = lab.take(&["record"]);
    thread::sleep(Duration::from_secs(3));
    relay.set(0, Faults::lost(0.8));
    thread::sleep(Duration::from_secs(2));
    relay.set(0, Faults::default());
    thread::sleep(Duration::from_secs(10));
    let taken = taking.end();
    receive.interrupt();
    receive.succeeds();
    the_box.end();
    assert_whole(&bench, "trial", "sent.bin");

    let numbers_taken = taken.frames();
    let stated_s = stated(&bench, "trial", &taken, false);
    assert!(taken.times_s.windows(2).all(|pair| pair[1] > pair[0]), "times go back");
    let missing_of = |numbers: &[f64], depth_mm: &[f64]| -> Vec<(usize, f64)> {
        let all = numbers.iter().zip(depth_mm).enumerate();
        all.filter(|(_, (_, depth_mm))| depth_mm.is_nan()).map(|(at, (it, _))| (at, *it)).collect()
    };
    let missing = missing_of(&numbers_taken, &taken.column("lower_cam_z"));
    assert!(!missing.is_empty());
    // Each has come after all, with the time that its place had.
    let xdf = &taken.all["xdf"];
    let late = lsl::column(xdf, "late_rows", "frame");
    assert!(lsl::column(xdf, "late_rows", "lower_cam_z").iter().all(|it| it.is_finite()));
    let late_s = lsl::numbers(&xdf["late_times"]);
    let mut of_late: Vec<(f64, f64)> = late.into_iter().zip(late_s).collect();
    of_late.sort_by(|one, other| one.0.total_cmp(&other.0));
    assert_eq!(of_late.len(), missing.len());
    for ((at, number), (late, late_s)) in missing.iter().zip(&of_late) {
        assert_eq!(number, late);
        let error_s = taken.times_s[*at] - late_s;
        assert!(error_s.abs() < WITHIN_S.max(stated_s[*at]), "{number}: {error_s}");
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
