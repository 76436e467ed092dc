//! The processor's actual clock rate, compared with the one at which it should be held.
//!
//! A Raspberry Pi's firmware lowers the clock rate without telling the kernel, whose
//! `scaling_cur_freq` still shows what the kernel has asked for. So the rate is measured: the
//! processor counts its cycles while the measuring thread runs, the kernel counts that time, and
//! cycles / time is the rate, averaged since the last reading.
//!
//! A lower rate means something only where the kernel does not lower it itself to save power:
//! where only one frequency is available, as with `force_turbo=1` in a Raspberry Pi's
//! `config.txt`, or where a Raspberry Pi's governor is `performance`. Elsewhere nothing is
//! reported. A rate that was lowered for only a small part of the time is not detected.

use std::path::Path;

// Both of its calls that are needed here are safe and do not allocate; it is the smallest of the
// crates for this system call.
use perf_event::events::{Event, Hardware};
use perf_event::{Builder, Counter};

/// Where the kernel describes the processor's clock rates.
const FOLDER: &str = "/sys/devices/system/cpu/cpu0/cpufreq";

/// Measured over tens of milliseconds, a rate that is held is accurate to about one per cent; one
/// that is a tenth lower has been lowered.
const LOWEST_SHARE: f64 = 0.9;

/// Over less time than this the thread's switches, a microsecond each, are not negligible. While
/// it tracks, the thread runs longer than this in each second.
const RAN_MIN_NS: u64 = 20_000_000;

/// What the kernel has counted while the thread ran.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Count {
    cycles: u64,
    ran_ns: u64,
}

/// A counter of the calling thread's cycles.
#[derive(Debug)]
pub struct Clock {
    counter: Counter,
    held_khz: u32,
    /// When it was last judged.
    before: Count,
    throttled: Option<bool>,
}

impl Clock {
    /// Counts the calling thread's cycles. `None` if the clock rate is not held, or if this program
    /// may not count, for which it must be root or `kernel.perf_event_paranoid` be 1 or less.
    pub fn open() -> Option<Self> {
        Self::count(Hardware::CPU_CYCLES, held_khz(Path::new(FOLDER))?).ok()
    }

    fn count(what: impl Into<Event>, held_khz: u32) -> std::io::Result<Self> {
        let mut builder = Builder::new().kind(what);
        // The time includes system calls, so their cycles must be counted too.
        builder.include_kernel().include_hv();
        let mut counter = builder.build()?;
        counter.enable()?;
        let before = read(&mut counter)?;
        Ok(Self { counter, held_khz, before, throttled: None })
    }

    /// Whether the rate was lowered since the last call; the previous answer if the thread has run
    /// for too short a time since.
    pub fn is_throttled(&mut self) -> Option<bool> {
        let now = read(&mut self.counter).ok()?;
        let since = Count {
            cycles: now.cycles.saturating_sub(self.before.cycles),
            ran_ns: now.ran_ns.saturating_sub(self.before.ran_ns),
        };
        if let Some(throttled) = is_below(since, self.held_khz) {
            self.throttled = Some(throttled);
            self.before = now;
        }
        self.throttled
    }
}

fn read(counter: &mut Counter) -> std::io::Result<Count> {
    let read = counter.read_count_and_time()?;
    Ok(Count { cycles: read.count, ran_ns: read.time_running })
}

/// Whether the rate was clearly lower than it should be; `None` after too short a time.
fn is_below(Count { cycles, ran_ns }: Count, held_khz: u32) -> Option<bool> {
    let clock_khz = 1e6 * cycles as f64 / ran_ns as f64;
    (ran_ns >= RAN_MIN_NS).then(|| clock_khz < LOWEST_SHARE * f64::from(held_khz))
}

/// The one rate at which the processor should run, if there is one.
fn held_khz(folder: &Path) -> Option<u32> {
    let text = |name: &str| std::fs::read_to_string(folder.join(name)).ok();
    let khz = |name: &str| text(name)?.trim().parse::<u32>().ok();
    let is = |name: &str, word: &str| text(name).is_some_and(|text| text.trim() == word);
    let (lowest, highest) = (khz("cpuinfo_min_freq")?, khz("cpuinfo_max_freq")?);
    // With other drivers the highest rate is one that few cores reach at once, and not for long.
    let performs = is("scaling_driver", "cpufreq-dt") && is("scaling_governor", "performance");
    (highest > 0 && (lowest == highest || performs)).then_some(highest)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use nix::time::ClockId;
    use perf_event::events::Software;
    use plumbline_test_support::{Absent, skip};

    use super::*;

    #[test]
    fn a_clock_a_tenth_below_the_held_one_is_throttled() {
        let table = [
            // cycles, ns, held kHz
            (1_500_000_000, 1_000_000_000, 1_500_000, Some(false)),
            (1_510_000_000, 1_000_000_000, 1_500_000, Some(false)),
            (1_351_000_000, 1_000_000_000, 1_500_000, Some(false)),
            (1_349_000_000, 1_000_000_000, 1_500_000, Some(true)),
            (600_000_000, 1_000_000_000, 1_500_000, Some(true)),
            (0, 1_000_000_000, 1_500_000, Some(true)),
            (30_000_000, 20_000_000, 1_500_000, Some(false)),
            (12_000_000, 20_000_000, 1_500_000, Some(true)),
            (12_000_000, 19_999_999, 1_500_000, None),
            (0, 0, 1_500_000, None),
            // A week at 1.5 GHz, read for the first time.
            (907_200_000_000_000, 604_800_000_000_000, 1_500_000, Some(false)),
            (907_200_000_000_000, 604_800_000_000_000, 1_800_000, Some(true)),
        ];
        for (cycles, ran_ns, held_khz, wanted) in table {
            let count = Count { cycles, ran_ns };
            assert_eq!(is_below(count, held_khz), wanted, "{count:?} of {held_khz} kHz");
        }
    }

    #[test]
    fn only_a_rate_that_is_held_is_compared() {
        let folder = tempfile::tempdir().unwrap();
        let held = |lowest: &str, highest: &str, driver: &str, governor: &str| {
            for (name, text) in [
                ("cpuinfo_min_freq", lowest),
                ("cpuinfo_max_freq", highest),
                ("scaling_driver", driver),
                ("scaling_governor", governor),
            ] {
                std::fs::write(folder.path().join(name), format!("{text}\n")).unwrap();
            }
            held_khz(folder.path())
        };
        assert_eq!(held("1500000", "1500000", "cpufreq-dt", "schedutil"), Some(1_500_000));
        assert_eq!(held("600000", "1800000", "cpufreq-dt", "performance"), Some(1_800_000));
        assert_eq!(held("600000", "1800000", "cpufreq-dt", "schedutil"), None);
        assert_eq!(held("400000", "4700000", "intel_pstate", "performance"), None);
        assert_eq!(held("0", "0", "cpufreq-dt", "performance"), None);
        assert_eq!(held("<unknown>", "1500000", "cpufreq-dt", "performance"), None);
        assert_eq!(held_khz(&folder.path().join("absent")), None);
    }

    /// Runs for long enough to be judged, by the thread's own time: other programs run too.
    fn work() {
        let ran = || Duration::from(ClockId::CLOCK_THREAD_CPUTIME_ID.now().unwrap());
        let end = ran() + Duration::from_nanos(2 * RAN_MIN_NS);
        while ran() < end {}
    }

    /// `None`, and skipped, where the computer has no such counter or does not allow it.
    fn counting(what: impl Into<Event>, held_khz: u32) -> Option<Clock> {
        let clock = Clock::count(what, held_khz);
        let refused =
            |error: &_| skip(Absent::Machine, &format!("nothing can be counted: {error}"));
        clock.inspect_err(refused).ok()
    }

    #[test]
    fn the_cycles_of_this_thread_give_a_sensible_clock() {
        let Some(mut clock) = counting(Hardware::CPU_CYCLES, 200_000) else { return };
        assert_eq!(clock.is_throttled(), None, "it has not run yet");
        work();
        // No processor in use runs at less than 200 MHz, and none at 20 GHz.
        assert_eq!(clock.is_throttled(), Some(false));
        clock.held_khz = 20_000_000;
        assert_eq!(clock.is_throttled(), Some(false), "judged too soon after");
        work();
        assert_eq!(clock.is_throttled(), Some(true));
    }

    /// The kernel's own count of nanoseconds is a clock of exactly 1 GHz, and there is one
    /// where the processor has no counters, as in many virtual machines.
    #[test]
    fn a_clock_of_one_gigahertz_is_measured_as_such() {
        for (held_khz, wanted) in [(1_000_000, false), (1_090_000, false), (1_130_000, true)] {
            let Some(mut clock) = counting(Software::TASK_CLOCK, held_khz) else { return };
            work();
            assert_eq!(clock.is_throttled(), Some(wanted), "{held_khz} kHz");
        }
    }
}
