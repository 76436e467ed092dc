//! `plumb replay`: a recorded trial, sent again.

use std::io::Write as _;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use plumbline::packet::{Deframer, Message, PACKET_BYTES_MAX, Packet, encode_datagram};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_stream::transport::Raw;
use plumbline_trial::journal::{Content, Entry, Reader};
use plumbline_trial::{Trial, names, recording};

use crate::ui::stop::stop_on_signals;

/// Send a recorded trial's packets again, or rebuild its tables.
///
/// With --to the packets leave this computer as the box sent them, byte by byte and at their
/// times: for `plumb receive`, or to try a program of your own without a box.
///
/// With --tables the trial's tables and trial.toml are rebuilt from its packets: for a recording
/// that was cut off, or one whose tables are lost.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["to", "tables"])))]
#[command(after_help = "Examples:\n  plumb replay trials/p01 --to 127.0.0.1:4210\n  \
    plumb replay trials/p01 --to 127.0.0.1:4210 --speed 10\n  plumb replay trials/p01 --tables")]
pub struct Arguments {
    /// The trial's folder
    trial: PathBuf,

    /// Send its packets to this address
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = crate::arguments::address)]
    to: Option<SocketAddr>,

    /// Send this many times faster
    #[arg(long, default_value_t = 1.0, requires = "to", value_parser = speed)]
    speed: f64,

    /// Rebuild samples.csv, samples.parquet and trial.toml
    #[arg(long)]
    tables: bool,
}

fn speed(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|speed| (0.01..=1000.0).contains(speed))
        .ok_or_else(|| "give a number from 0.01 to 1000".to_owned())
}

/// Runs the subcommand.
///
/// # Errors
/// When the trial cannot be read, or the packets cannot be sent.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let trial = Trial::open(&arguments.trial)?;
    for warning in &trial.warnings {
        eprintln!("warning: {warning}");
    }
    if arguments.tables {
        recording::remake(&arguments.trial)?;
        println!(
            "{}: {}, {} and {} were rebuilt",
            arguments.trial.display(),
            names::CSV,
            names::PARQUET,
            names::MANIFEST
        );
    }
    if let Some(to) = arguments.to {
        let stop = stop_on_signals()?;
        let sent = send(arguments, to, &stop)?;
        // A closed pipe must not hide the result.
        let _ = writeln!(std::io::stdout(), "{} sent to {to}", counted(sent, "packet"));
    }
    Ok(())
}

fn send(arguments: &Arguments, to: SocketAddr, stop: &AtomicBool) -> Result<u64, BadInput> {
    let path = arguments.trial.join(names::JOURNAL);
    let last_ns = last(&path)?;
    let mut journal = Reader::open(&path)?;
    let failed = |error| BadInput::io(format!("UDP {to}"), &error);
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).map_err(failed)?;
    let bar = ProgressBar::new(last_ns / 1_000_000).with_style(
        ProgressStyle::with_template("replaying {wide_bar} {msg}").expect("a constant template"),
    );
    let start = Instant::now();
    let mut deframer = Deframer::new();
    let mut sent = 0;
    while let Some(Entry { host_ns, content }) = journal.next_entry()? {
        let at = start + Duration::from_nanos(host_ns).div_f64(arguments.speed);
        while let Some(wait) = at.checked_duration_since(Instant::now()) {
            if stop.load(Ordering::Relaxed) {
                return Ok(sent);
            }
            std::thread::sleep(wait.min(Duration::from_millis(100)));
        }
        if stop.load(Ordering::Relaxed) {
            break;
        }
        bar.set_position(host_ns / 1_000_000);
        let seconds = |ns: u64| ns / 1_000_000_000;
        bar.set_message(format!("{} of {} s", seconds(host_ns), seconds(last_ns)));
        match content {
            Content::Mark(mark) => {
                bar.suspend(|| eprintln!("{:8.2} s  {}", 1e-9 * host_ns as f64, mark.label));
            }
            Content::Raw(raw) => sent += u64::from(forward(&socket, to, &raw, &mut deframer)),
        }
    }
    bar.finish_and_clear();
    Ok(sent)
}

/// A frame of a serial line leaves as the datagram that it would have been. Answers do not: they
/// were given to whoever asked, by a clock that is not theirs who hear it now.
fn forward(socket: &UdpSocket, to: SocketAddr, raw: &Raw, deframer: &mut Deframer) -> bool {
    let mut buffer = [0; PACKET_BYTES_MAX];
    let packet = raw.decode(deframer);
    let datagram = match (raw, &packet) {
        (_, Ok(Packet { message: Message::Reply(_), .. })) => return false,
        (Raw::Datagram(bytes), _) => &bytes[..],
        (Raw::Frame(_), Ok(packet)) => {
            match encode_datagram(packet.start, &packet.message, &mut buffer) {
                Ok(datagram) => datagram,
                Err(_) => return false,
            }
        }
        (Raw::Frame(_), Err(_)) => return false,
    };
    // Nobody may be listening yet; the box does not know either.
    socket.send_to(datagram, to).is_ok()
}

/// The time of the last entry.
fn last(path: &std::path::Path) -> Result<u64, BadInput> {
    let mut journal = Reader::open(path)?;
    let mut last_ns = 0;
    while let Some(entry) = journal.next_entry()? {
        last_ns = entry.host_ns;
    }
    Ok(last_ns)
}
