//! Edges at a GPIO line of the booted box, and the line that it drives: against the kernel's own
//! times. In the same machine, before its box starts, the modem lines of a serial device.
//!
//! The chip is the emulated board's own, with the kernel's driver for it. Debian's kernel has no
//! gpio-sim; `tests/guest` says how a line without a wire is pulled.

use plumbline::config::{Edges, Marked, TriggerInput, TriggerLines, TriggerOutput};
use plumbline::packet::{Edge, Health, Message, PosePacket, Trigger, TriggerState};

use crate::machine::{Host, Seen, healths, in_order, poses};
use crate::{modem_line, scene};

/// An edge's time is the truth's to within this.
const ERROR_NS_MAX: u64 = 200_000;

/// As `tests/guest` has them: pulses by themselves, and as many as possible at once.
const PULSES: usize = 20;
const BURST: usize = 200;

/// The nanoseconds before and after the line was pulled, for each edge, once all are there.
fn pulled(seen: &Seen) -> Option<Vec<(u64, u64)>> {
    seen.console.contains("test: all edges").then(|| {
        let edges = seen.console.lines().filter_map(|line| line.trim().strip_prefix("test: edge "));
        let edge = |text: &str| {
            let (before, after) = text.split_once(' ')?;
            Some((before.parse().ok()?, after.parse().ok()?))
        };
        edges.map(|text| edge(text).expect("two times")).collect()
    })
}

/// How many edges the kernel of the box has seen.
fn seen_by_kernel(console: &str) -> usize {
    let count = console.lines().find_map(|line| line.trim().strip_prefix("test: seen "));
    count.and_then(|text| text.parse().ok()).expect("a count")
}

fn triggers(messages: &[Message]) -> Vec<Trigger> {
    let trigger = |message: &Message| match message {
        Message::Trigger(trigger) => Some(*trigger),
        _ => None,
    };
    let mut all: Vec<Trigger> = messages.iter().filter_map(trigger).collect();
    all.sort_by_key(|trigger| trigger.sequence);
    all
}

#[test]
fn edges_have_their_times_to_a_fifth_of_a_millisecond_and_each_frame_its_pulse() {
    let host = Host::new();
    let directory = tempfile::tempdir().unwrap();
    let mut config = scene::config(host.address());
    config.trigger = Some(TriggerLines {
        chip: "9030000.pl061".try_into().unwrap(),
        input: Some(TriggerInput { line: 0, edges: Edges::Both, debounce_us: 0 }),
        output: Some(TriggerOutput { line: 1, marks: Marked::Exposures }),
    });
    let disk = scene::boot_disk(directory.path(), &scene::blob(&config));
    let machine =
        crate::boot_with_camera(&host, &disk, "test.trigger test.modem_line iomem=relaxed");
    let edges = machine.wait_for("the edges that were pulled", pulled);
    assert_eq!(edges.len(), 2 * (PULSES + BURST));
    let seen_by_kernel = machine.look(|seen| seen_by_kernel(&seen.console));
    println!("the kernel has seen {seen_by_kernel} of {} edges", edges.len());
    // What was sent before the Health that tells of all that the kernel has seen. Some that it has not
    // seen, the box knows from two of the same kind in a row.
    let health: Health = machine.wait_for("a Health that tells of all edges", |seen| {
        let is_whole =
            |it: &&Health| (it.trigger.sent + it.trigger.dropped) as usize >= seen_by_kernel;
        healths(&seen.udp).find(is_whole).cloned()
    });
    machine.wait_for("all triggers", |seen| {
        (triggers(&seen.udp).len() >= health.trigger.sent as usize).then_some(())
    });
    let (udp, console) = machine.look(|seen| (in_order(&seen.udp), seen.console.clone()));
    drop(machine);

    println!("{health:?}");
    let lines = health.trigger;
    assert_eq!((lines.input, lines.output), (TriggerState::Ready, TriggerState::Ready));
    assert_eq!((lines.bounces, health.heap_allocations), (0, Some(0)));

    // Those by themselves are all there, each with its time; of those that came all at once, the kernel
    // has seen more than it keeps, and any that it has seen and that are missing are counted.
    let triggers = triggers(&udp);
    assert!(triggers.iter().zip(0..).all(|(it, number)| it.sequence == number));
    let told = triggers.len() + lines.dropped as usize;
    assert!((seen_by_kernel..=edges.len()).contains(&told), "{told} of {seen_by_kernel}");
    assert!(lines.dropped > 0, "the kernel kept all: no burst");
    // It has seen all of them in every run so far; half of the burst is what makes it one.
    assert!(seen_by_kernel >= 2 * PULSES + BURST, "{seen_by_kernel}: hardly a burst");
    let mut errors_ns = Vec::new();
    for (number, (trigger, &(before_ns, after_ns))) in
        triggers.iter().zip(&edges).take(2 * PULSES).enumerate()
    {
        let edge = if number % 2 == 0 { Edge::Rising } else { Edge::Falling };
        assert_eq!(trigger.edge, edge, "{trigger:?} is not edge {number}");
        let may_be = before_ns..=after_ns + ERROR_NS_MAX;
        assert!(may_be.contains(&trigger.time_ns), "{trigger:?} is not in {may_be:?}");
        assert!(u64::from(trigger.uncertain_ns) <= ERROR_NS_MAX);
        // Who pulls may be interrupted in between, and then does not know it better than that.
        if after_ns - before_ns <= ERROR_NS_MAX {
            errors_ns.push(trigger.time_ns - before_ns);
        }
    }
    assert!(errors_ns.len() >= 30, "the time of only {} edges is known", errors_ns.len());
    errors_ns.sort_unstable();
    let (median_ns, worst_ns) = (errors_ns[errors_ns.len() / 2], errors_ns[errors_ns.len() - 1]);
    println!(
        "booted_trigger_error_us\tmedian {:.1}, worst {:.1} of {}, {} dropped",
        median_ns as f64 * 1e-3,
        worst_ns as f64 * 1e-3,
        errors_ns.len(),
        lines.dropped
    );
    assert!(worst_ns <= ERROR_NS_MAX, "{worst_ns}");

    assert_eq!(lines.pulses, health.frames, "not one pulse for each frame");
    assert_pulses(&console, poses(&udp));
    modem_line::assert_watched(&console);
}

/// The kernel has traced one pulse for each frame, at the time that its packet tells.
fn assert_pulses<'a>(console: &str, poses: impl Iterator<Item = &'a PosePacket>) {
    let times = console.lines().filter_map(|line| line.trim().strip_prefix("test: pulse "));
    let pulses_s: Vec<f64> = times.map(|time| time.parse().expect("a time")).collect();
    let told_s: Vec<f64> = poses
        .map(|pose| 1e-9 * pose.capture_time_ns as f64 + 1e-6 * f64::from(pose.latency_us))
        .collect();
    // A host hears those before it was there, too, as far as the box has kept them.
    assert!(pulses_s.len() > 24 && told_s.len() >= pulses_s.len(), "{}", pulses_s.len());
    let mut worst_s: f64 = 0.0;
    for (pulse_s, told_s) in pulses_s.iter().zip(&told_s) {
        worst_s = worst_s.max((pulse_s - told_s).abs());
    }
    println!("booted_pulse_error_us\t{:.1} of {} pulses", 1e6 * worst_s, pulses_s.len());
    assert!(worst_s < 1e-3, "a pulse is {worst_s} s from where its packet has it");
}
