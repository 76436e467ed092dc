//! The modem lines of a real serial device, pulled here and watched as `plumb receive --mark-line`
//! does.
//!
//! ```text
//! /dev/ttyGS0 ── g_serial: a modem ── dummy_hcd: a USB cable ── cdc-acm: the host ──▶ /dev/ttyACM0
//! ```
//!
//! All of it is this one kernel's. The modem asserts "data carrier detect" and "data set ready" while
//! its own end is open. Everything is said on the console, in nanoseconds of CLOCK_MONOTONIC, with the
//! name of a part of the test in place of PART:
//!
//! ```text
//! test: pulled PART BEFORE AFTER STOOD  the line was asserted between these times; meanwhile the
//!                                       machine has stood still for this long at most
//! test: asserted PART AT UNCERTAIN      the watch tells of it
//! test: missed PART NUMBER              the watch has not told of these, and counts them
//! test: ended PART                      the watch has ended, with its thread
//! test: gone PART NANOSECONDS           it knows that the device has gone, after this time
//! ```

use std::ffi::CString;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail};
use nix::kmod::{DeleteModuleFlags, delete_module};
use plumbline_modem_line::{Asserted, ModemLine, Watch};

use crate::trigger::now_ns;
use crate::{PATIENCE, load_modules, seccomp};

/// The host's end, whose lines are watched, and the modem's.
const HOST_END: &str = "/dev/ttyACM0";
const MODEM_END: &str = "/dev/ttyGS0";

/// How often a line is asserted, at times of its own.
const PULLS: u32 = 12;

/// How often it is while the watch does not look.
const UNSEEN: u32 = 4;

/// The modem tells of a change within this time.
const SETTLED: Duration = Duration::from_millis(20);

/// For how long the machine has stood still at most, since it was set to 0: its processor is emulated,
/// and has to wait for a real one.
static STOOD_NS: AtomicU64 = AtomicU64::new(0);

/// Finds out for how long the machine stands still.
fn watch_clock() {
    let step = Duration::from_millis(1);
    loop {
        let before = Instant::now();
        sleep(step);
        let stood = before.elapsed().saturating_sub(step);
        STOOD_NS.fetch_max(stood.as_nanos() as u64, Ordering::Relaxed);
    }
}

/// Watches both lines, by both ways, and what becomes of them when the modem is gone.
pub fn run() -> Result<()> {
    thread::spawn(watch_clock);
    load_modules(Path::new("/test/modules.modem"))?;
    for end in [HOST_END, MODEM_END] {
        wait_for(|| Path::new(end).exists()).with_context(|| format!("no {end}"))?;
    }
    // A modem on USB has no such line.
    if let Err(error) = line("cts")?.watch(|_| true) {
        println!("test: refused cts {error}");
    }
    for (part, name, is_asked) in
        [("dcd", "dcd", false), ("dsr", "dsr", false), ("asked", "dcd", true)]
    {
        let watched = Watched::start(part, name, is_asked)?;
        for number in 0..PULLS {
            pull(part, SETTLED + Duration::from_millis(u64::from(7 * number % 10)))?;
        }
        if !is_asked {
            watched.looks_away.store(true, Ordering::Relaxed);
            for _ in 0..UNSEEN {
                pull(part, SETTLED)?;
            }
            watched.looks_away.store(false, Ordering::Relaxed);
            sleep(SETTLED);
        }
        println!("test: missed {part} {}", watched.watch.missed());
        // The next one is one too many for who listens.
        watched.has_ended.store(true, Ordering::Relaxed);
        pull(part, SETTLED)?;
        watched.wait_for_end(part)?;
    }
    let waits = Watched::start("waits", "dcd", false)?;
    let asks = Watched::start("asks", "dsr", true)?;
    pull("waits", SETTLED)?;
    delete_module(&CString::new("g_serial")?, DeleteModuleFlags::empty())
        .context("g_serial stays")?;
    let removed = Instant::now();
    for (part, watched) in [("waits", waits), ("asks", asks)] {
        wait_for(|| watched.watch.is_gone()).context("the device is still there")?;
        println!("test: gone {part} {}", removed.elapsed().as_nanos());
        // It may wait for ever, and be right in what it tells.
        if watched.wait_for_end(part).is_err() {
            println!("test: still waits {part}");
        }
    }
    println!("test: all lines");
    Ok(())
}

fn line(name: &str) -> Result<ModemLine> {
    ModemLine::parse(&format!("{HOST_END}:{name}")).map_err(|words| anyhow!("{name}: {words}"))
}

/// A line that is watched.
struct Watched {
    watch: Watch,
    /// Who listens is busy with what it was told.
    looks_away: Arc<AtomicBool>,
    /// Who listens wants no more.
    has_ended: Arc<AtomicBool>,
    /// Closed once the watch's thread has ended.
    thread: Receiver<()>,
}

impl Watched {
    /// `is_asked`: as with a driver that does not count changes.
    fn start(part: &'static str, name: &str, is_asked: bool) -> Result<Self> {
        let (looks_away, has_ended) = (Arc::<AtomicBool>::default(), Arc::<AtomicBool>::default());
        let (alive, thread) = channel();
        let take = {
            let (looks_away, has_ended) = (Arc::clone(&looks_away), Arc::clone(&has_ended));
            move |Asserted { at, uncertain }: Asserted| {
                let _alive = &alive;
                let at_ns = now_ns() - at.elapsed().as_nanos() as u64;
                println!("test: asserted {part} {at_ns} {}", uncertain.as_nanos());
                while looks_away.load(Ordering::Relaxed) {
                    sleep(Duration::from_millis(1));
                }
                !has_ended.load(Ordering::Relaxed)
            }
        };
        let line = line(name)?;
        // The filter is for the thread that begins the watch, and for the one that this starts.
        let begun = thread::spawn(move || {
            if is_asked {
                seccomp::refuse_counts().context("seccomp")?;
            }
            line.watch(take).context("the line cannot be watched")
        });
        let watch = begun.join().map_err(|_| anyhow!("the watch panics"))??;
        // The device is opened: the kernel listens to the modem now.
        sleep(SETTLED);
        Ok(Self { watch, looks_away, has_ended, thread })
    }

    fn wait_for_end(&self, part: &str) -> Result<()> {
        match self.thread.recv_timeout(Duration::from_secs(2)) {
            Err(RecvTimeoutError::Disconnected) => {
                println!("test: ended {part}");
                Ok(())
            }
            _ => bail!("the watch {part} does not end"),
        }
    }
}

/// Asserts the lines for this time, and releases them for as long.
fn pull(part: &str, lasts: Duration) -> Result<()> {
    STOOD_NS.store(0, Ordering::Relaxed);
    let before_ns = now_ns();
    let end = File::options().read(true).write(true).open(MODEM_END).context(MODEM_END)?;
    let after_ns = now_ns();
    sleep(lasts);
    drop(end);
    sleep(lasts);
    let stood_ns = STOOD_NS.load(Ordering::Relaxed);
    println!("test: pulled {part} {before_ns} {after_ns} {stood_ns}");
    Ok(())
}

fn wait_for(is_so: impl Fn() -> bool) -> Result<()> {
    let until = Instant::now() + PATIENCE;
    while !is_so() {
        if Instant::now() > until {
            bail!("not within {} s", PATIENCE.as_secs());
        }
        sleep(Duration::from_millis(5));
    }
    Ok(())
}
