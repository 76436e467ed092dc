use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};

use plumbline::packet::{Command, Edge, MarkedInstant, Packet, PosePacket};
use plumbline_stream::fixture;
use plumbline_stream::fixture::adversity::{frame_of, hello_of};

use super::*;

const RATE_HZ: u32 = 60;

/// A publisher, and what it publishes.
struct Bench {
    publisher: Publisher,
    begun: Instant,
    items: Arc<Mutex<Vec<Item>>>,
}

impl Bench {
    fn new(asks: bool) -> Self {
        let begun = Instant::now();
        let mut publisher = Publisher::new(begun, asks);
        let items = Arc::<Mutex<Vec<Item>>>::default();
        let kept = Arc::clone(&items);
        let feed = Feed::start("a test", move |queue| {
            queue.into_iter().for_each(|item| kept.lock().unwrap().push(item));
            vec!["kept".to_owned()]
        });
        publisher.feeds.push(feed.unwrap());
        Self { publisher, begun, items }
    }

    fn at(&mut self, at_s: f64, packet: Packet) -> Option<Message> {
        let now = self.begun + Duration::from_secs_f64(at_s);
        self.publisher.event(&Event::Packet(packet), now).unwrap();
        self.publisher.turn(now).unwrap()
    }

    /// Ends it: what was published, and what is said of it.
    fn ends(self) -> (Vec<Item>, Vec<String>) {
        let said = self.publisher.finish();
        let items = std::mem::take(&mut *self.items.lock().unwrap());
        (items, said)
    }
}

/// When a frame arrives: 5 ms after its exposure.
fn arrives_s(number: u32) -> f64 {
    2.0 + f64::from(number) / f64::from(RATE_HZ) + 0.005
}

/// The session, the number and whether it is late of all frames, in their order.
fn frames(items: &[Item]) -> Vec<(u32, u32, bool)> {
    let frame = |item: &Item| match item {
        Item::Frame(it) => Some((it.session, it.packet.sequence, it.is_late)),
        _ => None,
    };
    items.iter().filter_map(frame).collect()
}

#[test]
fn a_gap_is_published_as_one_and_what_comes_late_as_late() {
    let mut bench = Bench::new(false);
    bench.at(1.9, hello_of("ward 3", 1));
    for number in 0..300 {
        if number == 200 {
            for late in 100..110 {
                bench.at(arrives_s(number), frame_of(1, late, RATE_HZ));
            }
        }
        if !(100..110).contains(&number) {
            bench.at(arrives_s(number), frame_of(1, number, RATE_HZ));
        }
    }
    // What comes twice is not published twice.
    bench.at(arrives_s(300), frame_of(1, 7, RATE_HZ));
    bench.publisher.mark_feed().mark("stands", "key", arrives_s(60) - 0.005);
    let (items, said) = bench.ends();
    assert_eq!(said, ["published: 300 frames, 10 missing, 10 of them late", "kept"]);
    assert!(matches!(&items[0], Item::Stream(stream) if stream.session == 1));
    let published = frames(&items);
    let in_order = (0..200).filter(|it| !(100..110).contains(it)).map(|it| (1, it, false));
    let late = (100..110).map(|it| (1, it, true));
    let wanted: Vec<_> = in_order.chain(late).chain((200..300).map(|it| (1, it, false))).collect();
    assert_eq!(published, wanted);
    let gap =
        items.iter().find_map(|item| if let Item::Gap(gap) = item { Some(*gap) } else { None });
    let gap = gap.unwrap();
    assert_eq!((gap.first, gap.count), (100, 10));
    // Without an answer of the box the least delay, 5 ms less the 1.2 ms that the packets say, is
    // not known.
    for item in &items {
        match item {
            Item::Frame(it) => {
                let wanted_ns = 1e9 * (arrives_s(it.packet.sequence) - 0.0012);
                assert!((it.host_ns - wanted_ns).abs() < 10.0, "{}", it.host_ns - wanted_ns);
                assert!((it.time_s - f64::from(it.packet.sequence) / 60.0).abs() < 1e-9);
                assert!((it.error_s - 0.1).abs() < 1e-9);
            }
            Item::Mark(it) => {
                assert_eq!((&*it.label, &*it.source), ("stands", "key"));
                assert!((it.time_s.unwrap() - 0.9962).abs() < 1e-6, "{:?}", it.time_s);
            }
            _ => {}
        }
    }
}

#[test]
fn a_restart_begins_a_session_and_keeps_the_times() {
    let mut bench = Bench::new(false);
    for (start, from_s) in [(1, 0.0), (2, 20.0)] {
        for number in 0..240 {
            if number % RATE_HZ == 0 {
                bench.at(from_s + arrives_s(number) - 0.001, hello_of("ward 3", start));
            }
            bench.at(from_s + arrives_s(number), frame_of(start, number, RATE_HZ));
        }
    }
    // The last frame of the first session was held up by all that.
    bench.at(25.0, frame_of(1, 240, RATE_HZ));
    let (items, _) = bench.ends();
    let sessions: Vec<u32> = items
        .iter()
        .filter_map(|item| if let Item::Stream(it) = item { Some(it.session) } else { None })
        .collect();
    assert_eq!(sessions, [1, 2]);
    let published = frames(&items);
    assert_eq!(published.iter().filter(|it| it.0 == 1 && !it.2).count(), 240);
    assert_eq!(published.iter().filter(|it| it.0 == 2 && !it.2).count(), 240);
    assert!(!items.iter().any(|it| matches!(it, Item::Gap(_))));
    let said =
        |item: &Item| matches!(item, Item::Notice(text) if text.contains("session 2 begins"));
    assert!(items.iter().any(said));
    for item in &items {
        let Item::Frame(it) = item else { continue };
        let from_s = if it.session == 1 { 0.0 } else { 20.0 };
        let wanted_ns = 1e9 * (from_s + arrives_s(it.packet.sequence) - 0.0012);
        assert!((it.host_ns - wanted_ns).abs() < 10.0, "{}", it.host_ns - wanted_ns);
    }
}

#[test]
fn the_box_is_asked_for_its_clock_unless_a_recording_asks() {
    for asks in [false, true] {
        let mut bench = Bench::new(asks);
        // There is nobody to ask.
        assert_eq!(bench.publisher.turn(bench.begun).unwrap(), None);
        bench.at(0.5, hello_of("ward 3", 1));
        let mut asked_s = Vec::new();
        for at_cs in 51_u32..800 {
            let now = bench.begun + Duration::from_millis(10) * at_cs;
            let question = bench.publisher.turn(now).unwrap();
            let Some(Message::Command(Command { action: Action::Ping { host_sent_ns }, .. })) =
                question
            else {
                continue;
            };
            assert_eq!(host_sent_ns, 10_000_000 * u64::from(at_cs));
            asked_s.push(0.01 * f64::from(at_cs));
        }
        if !asks {
            assert!(asked_s.is_empty());
            continue;
        }
        let steps_s: Vec<f64> = asked_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(steps_s[..6].iter().all(|it| (it - 0.1).abs() < 0.011), "{steps_s:?}");
        assert!(steps_s[7..].iter().all(|it| (it - 1.0).abs() < 0.011), "{steps_s:?}");
    }
}

#[test]
fn a_way_out_that_stands_still_stops_nobody() {
    const FRAMES: u32 = 9_000;
    let mut bench = Bench::new(false);
    let (go_on, stands) = channel::<()>();
    let feed = Feed::start("a slow program", move |queue| {
        let _ = stands.recv();
        vec![format!("{} items", queue.into_iter().count())]
    });
    bench.publisher.feeds.push(feed.unwrap());
    bench.at(1.9, hello_of("ward 3", 1));
    let begun = Instant::now();
    for number in 0..FRAMES {
        bench.at(arrives_s(number), frame_of(1, number, RATE_HZ));
    }
    assert!(begun.elapsed() < Duration::from_secs(10));
    drop(go_on);
    let (items, said) = bench.ends();
    assert_eq!(frames(&items).len(), FRAMES as usize);
    // One more item is the stream's description.
    assert_eq!(said[2], "8192 items");
    assert!(
        said[3].contains(&format!("{} frames and marks were not", FRAMES + 1 - 8192)),
        "{said:?}"
    );
}

/// The first frames of a box that has kept them come at once, long after their time.
#[test]
fn frames_of_the_past_get_their_own_times() {
    let mut bench = Bench::new(false);
    bench.at(61.0, hello_of("ward 3", fixture::START));
    let packet = |number| {
        let instant = MarkedInstant::Recording;
        let mut packet = frame_of(fixture::START, number, RATE_HZ);
        if let Message::Pose(pose) = &mut packet.message {
            *pose = PosePacket { instant, ..pose.clone() };
        }
        packet
    };
    for number in 0..3_540 {
        bench.at(61.1, packet(number));
    }
    for number in 3_540..3_700 {
        bench.at(arrives_s(number), packet(number));
    }
    let (items, _) = bench.ends();
    assert_eq!(frames(&items).len(), 3_700);
    for item in &items {
        let Item::Frame(it) = item else { continue };
        let wanted_ns = 1e9 * (arrives_s(it.packet.sequence) - 0.0012);
        assert!((it.host_ns - wanted_ns).abs() < 10.0, "{}", it.host_ns - wanted_ns);
    }
}

#[test]
fn marks_without_room_are_counted() {
    let mut bench = Bench::new(false);
    bench.at(1.9, hello_of("ward 3", 1));
    for number in 0..60 {
        bench.at(arrives_s(number), frame_of(1, number, RATE_HZ));
    }
    let feed = bench.publisher.mark_feed();
    (0..MARKS_MAX + 3).for_each(|_| feed.mark("stands", "udp", 2.5));
    let (items, said) = bench.ends();
    assert_eq!(items.iter().filter(|it| matches!(it, Item::Mark(_))).count(), MARKS_MAX);
    assert!(said[1].starts_with("warning: 3 marks came at once"), "{said:?}");
}

#[test]
fn a_trigger_is_a_mark_with_its_time_by_the_clock_of_the_frames() {
    let mut bench = Bench::new(false);
    // The trigger comes before the box has said who it is, and waits as the frames do.
    let captured_ns = |number: u32| match frame_of(1, number, RATE_HZ).message {
        Message::Pose(pose) => pose.capture_time_ns,
        other => panic!("{other:?}"),
    };
    let trigger = |after_ns| Packet {
        message: Message::Trigger(Trigger {
            sequence: 0,
            time_ns: captured_ns(0) + after_ns,
            uncertain_ns: 100_000,
            edge: Edge::Rising,
        }),
        ..frame_of(1, 0, RATE_HZ)
    };
    bench.at(arrives_s(0), trigger(7_000_000));
    bench.at(arrives_s(0), hello_of("ward 3", 1));
    for number in 0..300 {
        bench.at(arrives_s(number), frame_of(1, number, RATE_HZ));
    }
    bench.at(arrives_s(300), trigger(1_234_567_890));
    let (items, _) = bench.ends();
    let marks: Vec<_> = items
        .iter()
        .filter_map(|item| if let Item::Mark(mark) = item { Some(mark) } else { None })
        .collect();
    assert_eq!(marks.len(), 2);
    for (mark, after_s) in marks.iter().zip([0.007, 1.234_567_89]) {
        assert_eq!((&*mark.label, &*mark.source), ("rising edge", "trigger"));
        assert!((mark.time_s.unwrap() - after_s).abs() < 1e-9, "{mark:?}");
        let wanted_ns = 1e9 * (arrives_s(0) - 0.0012 + after_s);
        assert!((mark.host_ns - wanted_ns).abs() < 10.0, "{}", mark.host_ns - wanted_ns);
    }
}
