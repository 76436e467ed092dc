//! Box and host start again, in either order: the session is back at once, and nothing is counted
//! twice.

use std::time::{Duration, Instant};

use crate::bench::{Bench, RATE_HZ, assert_whole, sorted, wait_for};
use crate::relay::{ANNOUNCEMENT, CHANNEL, Relay};

/// From the first announcement of a box to the first message of a host that listens: a greeting and
/// an opening, each sent again after 0.2 s if it is lost.
const BACK_WITHIN: Duration = Duration::from_secs(2);

/// When a packet of this kind first came after this instant, in this direction.
fn first(relay: &Relay, since: Instant, kind: u8, is_to_box: bool) -> Option<Instant> {
    let mut seen = relay.seen().into_iter();
    seen.find(|it| it.at >= since && it.is(kind) && it.is_to_box == is_to_box).map(|it| it.at)
}

#[test]
fn the_box_starts_again_three_times_while_it_is_recorded() {
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], 31);
    let mut host = bench.receive(0, "trial", "--quiet");
    let mut sent = Vec::new();
    for start in 0..4 {
        let began = Instant::now();
        let record = format!("sent-{start}.bin");
        let mut the_box = bench.start(&relay, &record);
        wait_for("the session", || {
            first(&relay, began, ANNOUNCEMENT, false).is_some()
                && first(&relay, began, CHANNEL, false).is_some()
        });
        let announced = first(&relay, began, ANNOUNCEMENT, false).unwrap();
        let back = first(&relay, began, CHANNEL, false).unwrap() - announced;
        println!("start {start}: listened to after {back:?}");
        assert!(back < BACK_WITHIN, "{back:?}");
        bench.wait_for_poses("trial", sent.len() + 60);
        if start % 2 == 0 {
            the_box.end();
        } else {
            the_box.running.kill();
        }
        sent.extend(bench.sent(&record));
        if start % 2 == 0 {
            // It ended when all had been sent.
            bench.wait_for_poses("trial", sent.len());
        } else {
            // What it had sent when it was killed; the last of it is perhaps still on its way.
            std::thread::sleep(Duration::from_millis(300));
            sent.truncate(bench.recorded("trial").len());
        }
    }
    host.interrupt();
    let said = host.succeeds();
    assert_eq!(bench.recorded("trial"), sent, "{said}");
    let packets = bench.manifest("trial").packets.unwrap();
    assert_eq!((packets.sessions, packets.repeated, packets.late), (4, 0, 0), "{said}");
    assert_eq!((packets.frames, packets.not_authentic), (sent.len() as u64, 0), "{said}");
}

#[test]
fn the_host_starts_again_three_times_while_the_box_goes_on() {
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], 32);
    let mut the_box = bench.start(&relay, "sent.bin");
    wait_for("an announcement", || relay.the_box().is_some());
    for start in 0..4 {
        let trial = format!("trial-{start}");
        let mut host = bench.receive(0, &trial, "--quiet");
        let began = Instant::now();
        wait_for("the session", || first(&relay, began, CHANNEL, false).is_some());
        let back = first(&relay, began, CHANNEL, false).unwrap() - began;
        println!("start {start}: listens after {back:?}");
        assert!(back < BACK_WITHIN, "{back:?}");
        bench.wait_for_poses(&trial, 60);
        if start % 2 == 0 {
            host.interrupt();
            host.succeeds();
            // With what the box has kept: all from its first pose on.
            assert!(assert_whole(&bench, &trial, "sent.bin") >= 60);
            let packets = bench.manifest(&trial).packets.unwrap();
            assert_eq!((packets.lost, packets.repeated, packets.sessions), (0, 0, 1));
        } else {
            host.kill();
            let recorded = sorted(bench.recorded(&trial));
            assert!(recorded.windows(2).all(|it| it[0].sequence < it[1].sequence));
        }
    }
    the_box.end();
}

/// Longer than a packet is under way, so that what came first and what comes live differ by more.
#[test]
fn a_host_that_comes_late_takes_all_that_the_box_has_kept() {
    const LATE_BY: Duration = Duration::from_secs(15);
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], 33);
    let mut the_box = bench.start(&relay, "sent.bin");
    std::thread::sleep(LATE_BY);
    let mut host = bench.receive(0, "trial", "--quiet");
    bench.wait_for_poses("trial", (LATE_BY.as_secs() * RATE_HZ) as usize);
    the_box.end();
    let last = bench.sent("sent.bin").len();
    bench.wait_for_poses("trial", last);
    host.interrupt();
    let said = host.succeeds();
    assert_eq!(assert_whole(&bench, "trial", "sent.bin"), last);
    let packets = bench.manifest("trial").packets.unwrap();
    assert_eq!((packets.lost, packets.implausible, packets.repeated), (0, 0, 0), "{said}");
    // What came before the first one that was handed on is no loss, but no part of the trial either.
    assert!(packets.frames > 0 && packets.frames <= last as u64, "{said}");
    println!("{} of {last} frames are in the trial", packets.frames);
}
