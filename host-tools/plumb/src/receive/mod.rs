//! `plumb receive`: listens to a box, checks what it says, shows it and records it.

use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;

use crate::error::BadInput;
use crate::files;
use crate::link::LinkArguments;

pub mod accounting;
pub mod bad_packets;
pub mod complaints;
pub mod others;
pub mod receiver;
pub mod recorder;
mod screen;
pub mod transport;

use receiver::Receiver;
use recorder::Recorder;
use screen::Screen;
use transport::Transport;

/// Receive the poses of a box, show them and record them.
///
/// Counts what is lost, repeated, late or corrupt. Every row is in the file as
/// soon as it is received. When the box starts anew the recording goes on: the
/// column `session` is then higher, `frame` begins again, and `time_s` goes
/// on by this computer's clock. Ends with --duration, --frames or Ctrl-C, and a
/// summary.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(after_help = "Examples:\n  plumb receive --udp 0.0.0.0:4210 --out poses.csv\n  \
    plumb receive --serial /dev/ttyUSB0 --baud 115200 --out poses.csv --duration 60")]
pub struct Arguments {
    /// Where the box sends to.
    #[command(flatten)]
    pub link: LinkArguments,

    /// Record into this CSV: the columns of poses.csv, then `session`; without a frame there is
    /// no file
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,

    /// Replace the file of --out if it exists
    #[arg(long, requires = "out")]
    pub force: bool,

    /// End after this many seconds
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub duration: Option<Duration>,

    /// End after this many frames
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u64).range(1..))]
    pub frames: Option<u64>,

    /// Show nothing but errors and the summary
    #[arg(long)]
    pub quiet: bool,
}

/// A time, as an option has it.
///
/// # Errors
/// What to give instead.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let value: f64 = text.parse().map_err(|_| "give a number of seconds".to_owned())?;
    if value > 0.0 {
        Duration::try_from_secs_f64(value).map_err(|_| "too long".to_owned())
    } else {
        Err("give more than 0 seconds".to_owned())
    }
}

/// When a reception ends by itself.
#[derive(Debug, Clone, Copy, Default)]
pub struct Limits {
    /// After this time.
    pub duration: Option<Duration>,
    /// After this many different pose packets.
    pub frames: Option<u64>,
}

/// Receives until a limit is reached or `stop` is set. `show` is called after
/// every packet, and ten times a second when none comes.
///
/// # Errors
/// When the transport or the recording cannot go on. What was received before
/// is in the recording.
pub fn receive<W: std::io::Write>(
    transport: &mut dyn Transport,
    receiver: &mut Receiver<W>,
    limits: Limits,
    stop: &AtomicBool,
    mut show: impl FnMut(&mut Receiver<W>),
) -> Result<(), BadInput> {
    let start = Instant::now();
    let reached = |receiver: &Receiver<W>| {
        limits.frames.is_some_and(|frames| receiver.counts().received >= frames)
    };
    let result = loop {
        let over = limits.duration.is_some_and(|duration| start.elapsed() >= duration);
        if stop.load(Ordering::Relaxed) || over || reached(receiver) {
            break Ok(());
        }
        let mut handled = Ok(());
        let polled = transport.poll(&mut |event| {
            // The rest of one read belongs to the next recording, if any.
            if handled.is_ok() && !reached(receiver) {
                handled = receiver.handle(event, Instant::now());
            }
        });
        let result = handled.and(polled).and_then(|()| receiver.tick(Instant::now()));
        if result.is_err() {
            break result;
        }
        if let Some(request) = receiver.request() {
            transport.send(&request);
        }
        show(receiver);
    };
    // Rows that still wait for the targets' names.
    result.and(receiver.finish())
}

/// Runs the subcommand.
///
/// # Errors
/// When the address, the device or the file cannot be used, or nothing came.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (mut transport, place) = arguments.link.transport()?;
    let recorder = match &arguments.out {
        Some(path) => {
            let file = files::Late::new(path, arguments.force)?;
            Some(Recorder::new(file, path.display().to_string()))
        }
        None => None,
    };
    let stop = stop_on_signals()?;

    let mut receiver = Receiver::new(recorder);
    let mut screen = Screen::new(&place, arguments.quiet);
    let limits = Limits { duration: arguments.duration, frames: arguments.frames };
    let result = receive(&mut *transport, &mut receiver, limits, &stop, |receiver| {
        screen.show(receiver);
    });
    screen.end();
    // A closed pipe must not hide the result.
    let _ = writeln!(std::io::stdout(), "{}", screen::summary(&receiver));
    if let Some(path) = &arguments.out {
        let path = path.display();
        let text = match receiver.counts().received {
            0 => format!("no frame came: {path} is not written"),
            _ => format!("recorded in {path}"),
        };
        let _ = writeln!(std::io::stdout(), "{text}");
    }
    result?;
    if let Some(silence) =
        receiver.unheard(Instant::now()).filter(|_| !stop.load(Ordering::Relaxed))
    {
        return Err(BadInput::whole(
            place,
            format!("nothing was heard from the box in the last {} s", silence.as_secs()),
            "check the box's power and its link",
        )
        .into());
    }
    if receiver.counts().received == 0 && !stop.load(Ordering::Relaxed) {
        return Err(screen::no_pose(&receiver, place, Instant::now()).into());
    }
    Ok(())
}

/// A flag that Ctrl-C, or a request to end, sets.
pub(crate) fn stop_on_signals() -> Result<Arc<AtomicBool>, BadInput> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).map_err(|error| {
        BadInput::whole("Ctrl-C", error, "another part of this program handles it already")
    })?;
    Ok(stop)
}

#[cfg(test)]
mod tests;
