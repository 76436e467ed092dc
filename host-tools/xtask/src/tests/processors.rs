//! What the machine's processors did during a run: whether the run took so long because of its work, or because
//! somebody else's machine had the processors.

use std::fmt;
use std::fs;
use std::time::{Duration, Instant};

/// Linux counts in such steps, on every processor that this program can be compiled for.
const TICKS_IN_A_SECOND: f64 = 100.0;

/// The counters at the beginning of a run.
pub struct Processors {
    begun: Instant,
    before: Option<Ticks>,
}

impl Processors {
    /// From now on.
    pub fn watch() -> Self {
        Self { begun: Instant::now(), before: Ticks::read() }
    }

    /// What they have done since.
    pub fn spent(&self) -> Spent {
        let ticks = self.before.as_ref().zip(Ticks::read()).map(|(before, now)| now.since(before));
        Spent { clock: self.begun.elapsed(), ticks }
    }
}

/// What processors did, in words: `2280 s by the clock; processors: 4100 s at work, 400 s idle, 60 s stolen`.
pub struct Spent {
    clock: Duration,
    ticks: Option<Ticks>,
}

impl fmt::Display for Spent {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{:.0} s by the clock", self.clock.as_secs_f64())?;
        let Some(Ticks { work, idle, stolen }) = self.ticks else { return Ok(()) };
        let [work, idle, stolen] = [work, idle, stolen].map(|it| it as f64 / TICKS_IN_A_SECOND);
        write!(
            formatter,
            "; processors: {work:.0} s at work, {idle:.0} s idle, {stolen:.0} s stolen"
        )
    }
}

/// Times of all processors together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Ticks {
    work: u64,
    /// Nothing to do, or waiting for a disk.
    idle: u64,
    /// Ready to work, while another virtual machine had the processor.
    stolen: u64,
}

impl Ticks {
    /// `None` where the kernel tells nothing.
    fn read() -> Option<Self> {
        Self::parse(&fs::read_to_string("/proc/stat").ok()?)
    }

    /// From the kernel's `/proc/stat`, whose first line has the times in user programs, in nice ones, in the
    /// kernel, idle, waiting for a disk, in two kinds of interrupts, and stolen.
    fn parse(text: &str) -> Option<Self> {
        let times = text.lines().next()?.strip_prefix("cpu ")?.split_whitespace();
        let times: Vec<u64> = times.map(str::parse).collect::<Result<_, _>>().ok()?;
        let [user, nice, kernel, idle, disk, hard, soft, stolen] = *times.first_chunk()?;
        Some(Self { work: user + nice + kernel + hard + soft, idle: idle + disk, stolen })
    }

    fn since(self, before: &Self) -> Self {
        Self {
            work: self.work.saturating_sub(before.work),
            idle: self.idle.saturating_sub(before.idle),
            stolen: self.stolen.saturating_sub(before.stolen),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_processors_did_is_told_in_seconds() {
        let before = Ticks::parse("cpu  100 200 300 400 50 6 7 80 0 0\ncpu0 1 2\n").unwrap();
        assert_eq!(before, Ticks { work: 613, idle: 450, stolen: 80 });
        let now = Ticks::parse("cpu  300 200 300 1400 50 6 7 380 0 0\n").unwrap();
        let spent = Spent { clock: Duration::from_millis(12_345), ticks: Some(now.since(&before)) };
        let words = "12 s by the clock; processors: 2 s at work, 10 s idle, 3 s stolen";
        assert_eq!(spent.to_string(), words);
        let spent = Spent { ticks: None, ..spent };
        assert_eq!(spent.to_string(), "12 s by the clock");
        for wrong in ["", "cpu 1 2 3", "cpu a b c d e f g h", "intr 1 2 3 4 5 6 7 8"] {
            assert_eq!(Ticks::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn the_kernel_tells_what_processors_did() {
        let processors = Processors::watch();
        while processors.begun.elapsed() < Duration::from_millis(100) {
            std::hint::spin_loop();
        }
        let ticks = processors.spent().ticks.expect("Linux has it");
        assert!(ticks.work + ticks.stolen >= 5, "{ticks:?}");
    }
}
