//! The times of frames that are published while they come, and while the clocks become better known.
//!
//! - A later frame is never published with an earlier time, however the answers say that those before it
//!   were placed.
//! - Each time is as true as is stated with it.

use std::sync::mpsc;
use std::time::{Duration, Instant};

use plumbline::packet::{Message, Packet, PosePacket, Reply, ReplyOutcome};
use plumbline_publish::item::Item;
use plumbline_publish::publisher::Publisher;
use plumbline_stream::fixture::adversity::hello_of;
use plumbline_stream::fixture::{packet, pose_packet};
use plumbline_stream::reception::Tap as _;
use plumbline_stream::transport::Event;
use proptest::prelude::*;

use crate::laws::Tries;

const MS: u64 = 1_000_000;

/// The box's clock is ahead by this.
const AHEAD_NS: u64 = 5_000 * MS;

/// When the first frame is taken, by this computer's clock, and how long after that it comes.
const FIRST_NS: u64 = 500 * MS;
const WAY_NS: u64 = 5 * MS;

/// A frame or an answer, as it comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Come {
    Frame(u32),
    /// The way there and back.
    Answer([u64; 2]),
}

/// What comes, and when.
fn arrivals(period_ns: u64, frames: u32, answers: &[(u64, u64, u64)]) -> Vec<(u64, Come)> {
    let frame_ns = |number: u32| FIRST_NS + u64::from(number) * period_ns + WAY_NS;
    let mut come: Vec<_> = (0..frames).map(|it| (frame_ns(it), Come::Frame(it))).collect();
    come.extend(answers.iter().map(|&(asked_ns, there_ns, back_ns)| {
        (asked_ns + there_ns + back_ns, Come::Answer([there_ns, back_ns]))
    }));
    come.sort_unstable();
    come
}

fn answer(at_ns: u64, [there_ns, back_ns]: [u64; 2]) -> Message {
    let host_sent_ns = at_ns - there_ns - back_ns;
    let box_ns = host_sent_ns + there_ns + AHEAD_NS;
    let outcome = ReplyOutcome::Pong {
        host_sent_ns,
        box_received_ns: box_ns,
        box_sent_ns: box_ns,
        stream_next: 0,
    };
    Message::Reply(Reply { id: 1, outcome })
}

fn times_rise(tries: Tries) {
    let hello = hello_of("ward 3", 1);
    let way_ns = || prop_oneof![2 => 0..80 * MS, 1 => 0..MS];
    let answer_at = (FIRST_NS..FIRST_NS + 3_000 * MS, way_ns(), way_ns());
    let inputs = (MS..34 * MS, 2..400_u32, proptest::collection::vec(answer_at, 0..12));
    tries.hold(
        "frames published while answers come that took any ways",
        "no frame was placed before an earlier one, and each as truly as was stated with it",
        &inputs,
        |(period_ns, frames, answers)| {
            let begun = Instant::now();
            let mut publisher = Publisher::new(begun, false);
            let (items, published) = mpsc::channel();
            let run = move |queue: mpsc::Receiver<Item>| {
                queue.into_iter().for_each(|item| drop(items.send(item)));
                Vec::new()
            };
            publisher.add_own("a test", run).expect("a thread");
            let mut comes = |at_ns: u64, packet: Packet| {
                let now = begun + Duration::from_nanos(at_ns);
                publisher.event(&Event::Packet(packet), now).expect("it goes on");
                publisher.turn(now).expect("it goes on");
            };
            comes(FIRST_NS, hello.clone());
            for (at_ns, come) in arrivals(period_ns, frames, &answers) {
                let message = match come {
                    Come::Answer(ways_ns) => answer(at_ns, ways_ns),
                    Come::Frame(number) => Message::Pose(PosePacket {
                        capture_time_ns: at_ns - WAY_NS + AHEAD_NS,
                        ..pose_packet(number)
                    }),
                };
                comes(at_ns, packet(1, message));
            }
            let _ = publisher.finish();
            let samples: Vec<_> = published
                .into_iter()
                .filter_map(|it| if let Item::Frame(sample) = it { Some(sample) } else { None })
                .collect();
            assert_eq!(samples.len(), frames as usize);
            let times_ns: Vec<f64> = samples.iter().map(|it| it.host_ns).collect();
            assert!(times_ns.is_sorted(), "{times_ns:?}");
            for sample in &samples {
                let number = u64::from(sample.packet.sequence);
                let error_ns = sample.host_ns - (FIRST_NS + number * period_ns) as f64;
                let most_ns = 1e9 * sample.error_s + 1.0;
                assert!(error_ns.abs() <= most_ns, "{error_ns} ns where {most_ns} are stated");
            }
        },
    );
}

#[test]
fn published_times_rise_and_are_as_true_as_stated() {
    times_rise(Tries::few(100));
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn published_times_rise_and_are_as_true_as_stated_many_times() {
    times_rise(Tries::many(30_000));
}
