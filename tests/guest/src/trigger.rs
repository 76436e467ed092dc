//! Lines 0 and 1 of the board's GPIO chip (a PL061): line 0 is pulled up and down here, as if a wire
//! did it, and what the box drives at line 1 is recorded by the kernel's tracing.
//!
//! The emulated chip has no wires, but a register in which the level of an input stays as it was left
//! when the line was an output. So a line is made an output, set, and made an input again: the chip
//! sees its input change and interrupts the kernel, whose driver knows nothing of all this. The
//! kernel lets a program at the registers only with `iomem=relaxed` on its command line.
//!
//! Everything is said on the console, in CLOCK_MONOTONIC: `test: edge BEFORE AFTER`, the nanoseconds
//! before and after the line was pulled; as the kernel has traced it, `test: pulse SECONDS` for each
//! time that the box drove its line high, and with `test: seen COUNT` how many edges the kernel itself
//! has seen: two that come before it looks at the line are one to it.

use std::fs::{self, File};
use std::io::{ErrorKind, Read as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use gpiocdev::chip::{Chip, chips};
use nix::mount::{MsFlags, mount};
use nix::sched::{CpuSet, sched_setaffinity};
use nix::time::{ClockId, clock_gettime};
use nix::unistd::Pid;

use crate::PATIENCE;
use crate::kernel::Registers;

/// As the box's configuration calls the chip.
const LABEL: &str = "9030000.pl061";

/// Where its registers are on QEMU's board `virt`.
const REGISTERS: u64 = 0x0903_0000;

/// The register of the levels: the bits that are read or written are those of a mask that is part of
/// its address.
const DATA: usize = 0x000;

/// The register of the directions: 1 for an output.
const DIRECTIONS: usize = 0x400;

/// The line that is pulled, and the one that the box drives.
const LINES: [u32; 2] = [0, 1];

const TRACING: &str = "/sys/kernel/tracing";

/// How often the trace is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Pulses at times that no camera has, and then as many as possible at once.
const PULSES: u32 = 20;
const BURST: u32 = 200;

/// Has the kernel trace what is driven.
pub fn set_up() -> Result<()> {
    mount(Some("tracefs"), TRACING, Some("tracefs"), MsFlags::empty(), None::<&str>)
        .context("tracefs cannot be mounted")?;
    write("trace_clock", "mono")?;
    write("events/gpio/gpio_value/enable", "1")
}

/// Pulls the line once the box listens, and says what was done and what the box did.
pub fn pull() -> Result<()> {
    wait_for_box()?;
    use_processor_of_interrupts()?;
    let mut registers = Registers::map(REGISTERS)?;
    let mut edges = Vec::new();
    let mut pull_to = |is_high: bool| {
        let line = 1_u8 << LINES[0];
        let directions = registers.read(DIRECTIONS);
        registers.write(DIRECTIONS, directions | line);
        registers.write(DATA + (usize::from(line) << 2), if is_high { line } else { 0 });
        // Only as an input is it seen to change.
        let before_ns = now_ns();
        registers.write(DIRECTIONS, directions & !line);
        edges.push((before_ns, now_ns()));
    };
    // The box is tracking by then.
    sleep(Duration::from_secs(2));
    for number in 0..PULSES {
        pull_to(true);
        sleep(Duration::from_millis(5));
        pull_to(false);
        sleep(Duration::from_millis(37 + u64::from(number % 7)));
    }
    for _ in 0..BURST {
        pull_to(true);
        pull_to(false);
    }
    sleep(Duration::from_secs(1));
    let trace = fs::read_to_string(Path::new(TRACING).join("trace")).context("the trace")?;
    let mut said = String::new();
    for (time_s, is_high) in trace.lines().filter_map(driven) {
        if is_high {
            said += &format!("test: pulse {time_s}\n");
        }
    }
    said += &format!("test: seen {}\n", trace.lines().filter(|line| is_looked_at(line)).count());
    for (before_ns, after_ns) in edges {
        said += &format!("test: edge {before_ns} {after_ns}\n");
    }
    println!("{said}test: all edges");
    Ok(())
}

/// Pulls on the processor that the kernel interrupts, the first one. The emulated ones take turns, and
/// one that pulls without end would leave the other no time to see the edges.
fn use_processor_of_interrupts() -> Result<()> {
    let mut processors = CpuSet::new();
    processors.set(0)?;
    sched_setaffinity(Pid::from_raw(0), &processors).context("the first processor")
}

/// Says on the console what the box drives, as the kernel traces it: `test: driven SECONDS high` or
/// `low`.
pub fn tell_output() -> Result<()> {
    let pipe = Path::new(TRACING).join("trace_pipe");
    let mut pipe = File::options().read(true).custom_flags(nix::libc::O_NONBLOCK).open(pipe)?;
    let mut lines = Vec::new();
    loop {
        let mut bytes = [0; 4096];
        match pipe.read(&mut bytes) {
            Ok(read) => lines.extend_from_slice(&bytes[..read]),
            // A reader that waits in the kernel was seen not to get the last line.
            Err(error) if error.kind() == ErrorKind::WouldBlock => sleep(LOOK_EVERY),
            Err(error) => return Err(error).context("trace_pipe"),
        }
        while let Some(end) = lines.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = lines.drain(..=end).collect();
            if let Some((time_s, is_high)) = driven(&String::from_utf8_lossy(&line)) {
                println!("test: driven {time_s} {}", if is_high { "high" } else { "low" });
            }
        }
    }
}

/// When a line was driven, and whether high, in a line of the kernel's trace such as
/// `plumbline-board-71 [001] ..... 4.250311: gpio_value: 513 set 1`.
fn driven(line: &str) -> Option<(&str, bool)> {
    let (before, value) = line.split_once(": gpio_value:")?;
    let is_high = match value.rsplit_once(" set ")?.1.trim() {
        "1" => true,
        "0" => false,
        _ => return None,
    };
    Some((before.split_whitespace().last()?, is_high))
}

/// Whether the kernel has looked at a line's level, in a line of its trace such as
/// `irq/52-plumblin-74 [000] ..... 13.570312: gpio_value: 512 get 1`: it does after each edge.
fn is_looked_at(line: &str) -> bool {
    line.split_once(": gpio_value:").is_some_and(|(_, value)| value.contains(" get "))
}

/// Until both lines are in use.
fn wait_for_box() -> Result<()> {
    let until = Instant::now() + PATIENCE;
    while Instant::now() < until {
        for path in chips()? {
            let chip = Chip::from_path(&path)?;
            if chip.info()?.label == LABEL
                && LINES.iter().all(|line| chip.line_info(*line).is_ok_and(|it| it.used))
            {
                return Ok(());
            }
        }
        sleep(Duration::from_millis(50));
    }
    bail!("the box does not use the chip {LABEL}")
}

pub fn now_ns() -> u64 {
    // This clock always exists, and is never negative.
    clock_gettime(ClockId::CLOCK_MONOTONIC)
        .map_or(0, |now| now.tv_sec() as u64 * 1_000_000_000 + now.tv_nsec() as u64)
}

/// Writes a file of the kernel's tracing.
fn write(name: &str, text: &str) -> Result<()> {
    fs::write(Path::new(TRACING).join(name), text).context(name.to_owned())
}
