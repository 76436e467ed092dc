//! `plumb receive`: listens to a box, checks what it says, shows it and records it.

use std::io::{IsTerminal as _, Write as _};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_stream::receiver::Receiver;
use plumbline_stream::reception::{Limits, Tap, receive};
use plumbline_stream::recorder::Recorder;
use plumbline_trial::manifest::{Manifest, Zero};
use plumbline_trial::mark::Mark;
use plumbline_trial::recording::Recording;

use crate::arguments::{LinkArguments, seconds};
use crate::ui::stop::stop_on_signals;

mod marks;
mod screen;

use screen::Screen;

/// Receive the poses of a box, show them and record them.
///
/// With --out it makes a folder for the trial: every packet as it came (packets.bin), the poses
/// as tables (samples.csv, samples.parquet), the box's configuration, and trial.toml, which says
/// who was measured and how, how the box's clock relates to this computer's, and which events were
/// marked. However the recording ends, no more than its last second is lost.
///
/// Counts what is lost, repeated, late, corrupt or implausible. When the box restarts, the recording
/// goes on, with a gap. Another box that sends here is left out and counted; once it has taken this
/// one's place, the recording ends with an error and is kept. Press Enter to mark an event; type its name first if it has one. The mark called zero,
/// or else the first mark, is the trial's t = 0. Ends after --duration, after --frames or with
/// Ctrl-C, and prints a summary.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(after_help = "Examples:\n  plumb receive --out trials/p01-control\n  \
    plumb receive --out trials/p01-control --participant P01 --condition control --duration 60\n  \
    plumb receive --serial /dev/ttyUSB0 --out trials/p02 --mark-udp 0.0.0.0:5000\n  \
    echo stands | nc -u -w0 127.0.0.1 5000        # a mark from another program")]
pub struct Arguments {
    /// Where the box sends to.
    #[command(flatten)]
    link: LinkArguments,

    /// Record into this new folder; it is removed again if no frame comes
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,

    /// Who is measured: a code, not a name
    #[arg(long, value_name = "CODE", requires = "out")]
    participant: Option<String>,

    /// Under which condition
    #[arg(long, value_name = "WORD", requires = "out")]
    condition: Option<String>,

    /// Anything else that trial.toml should say
    #[arg(long, value_name = "TEXT", requires = "out")]
    note: Option<String>,

    /// What t = 0 is
    #[arg(long, value_enum, default_value_t, requires = "out")]
    zero: Zero,

    /// Take marks from datagrams to this address: the text of each is its name
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = crate::arguments::address, requires = "out")]
    mark_udp: Option<SocketAddr>,

    /// Take marks from this serial device: each line is a mark
    #[arg(long, value_name = "DEVICE[:BAUD]", requires = "out")]
    mark_serial: Option<String>,

    /// End after this many seconds
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    duration: Option<Duration>,

    /// End after this many frames
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,

    /// Show nothing but errors and the summary
    #[arg(long)]
    quiet: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When the address, the device or the folder cannot be used, or nothing came.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let (mut transport, place) = arguments.link.transport()?;
    let mut recording = arguments.out.as_deref().map(|out| begin(arguments, out)).transpose()?;
    let recorder = match &recording {
        Some(recording) => {
            let csv = recording.csv();
            Some(Recorder::new(plumbline_files::Late::new(&csv, false)?, csv.display().to_string()))
        }
        None => None,
    };
    let stop = stop_on_signals()?;

    let mut receiver = Receiver::new(recorder);
    let mut screen = Screen::new(&place, arguments.quiet);
    let limits = Limits { duration: arguments.duration, frames: arguments.frames };
    let tap: &mut dyn Tap = match &mut recording {
        Some(recording) => recording,
        None => &mut (),
    };
    let result = receive(&mut *transport, &mut receiver, tap, limits, &stop, |receiver| {
        screen.show(receiver);
    });
    screen.end();
    // A closed pipe must not hide the result.
    let _ = writeln!(std::io::stdout(), "{}", screen::summary(&receiver));
    let ended = recording.map(|recording| end(recording, receiver.counts().received));
    // The reason for the end matters more than a fault while closing.
    result?;
    ended.transpose()?;
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

fn begin(arguments: &Arguments, out: &Path) -> Result<Recording, BadInput> {
    let marks = marks::listen(arguments.mark_udp, arguments.mark_serial.as_deref())?;
    let manifest = &Manifest::begin(
        jiff::Timestamp::now().to_string(),
        arguments.participant.clone(),
        arguments.condition.clone(),
        arguments.note.clone(),
        arguments.zero,
    );
    Recording::begin(out, manifest, marks, Instant::now(), Box::new(echo))
}

/// A mark is in the recording.
fn echo(mark: &Mark, since_s: f64) {
    // Overwrites the status line, which is drawn again below.
    let start = if std::io::stderr().is_terminal() { "\r\x1b[K" } else { "" };
    eprintln!("{start}mark \"{}\" after {since_s:.1} s", mark.label);
}

/// Ends a recording, and says what is in it.
fn end(recording: Recording, frames: u64) -> Result<(), BadInput> {
    let folder = recording.folder().display().to_string();
    let dropped = recording.marks_dropped();
    let mut text = format!("no frame came: {folder} was not written");
    if let Some(trial) = recording.end(frames)? {
        let events = counted(trial.manifest.events.len(), "mark");
        text = format!("recorded in {folder}, {events}");
        if dropped > 0 {
            text +=
                &format!("\nwarning: {} came at once and were dropped", counted(dropped, "mark"));
        }
        for warning in &trial.warnings {
            text += &format!("\nwarning: {warning}");
        }
    }
    // A closed pipe must not hide the result.
    let _ = writeln!(std::io::stdout(), "{text}");
    Ok(())
}
