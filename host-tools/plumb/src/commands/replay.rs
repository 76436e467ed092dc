//! `plumb replay`: a recorded trial, sent again, or its tables rebuilt.

use std::io::Write as _;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use plumbline::packet::{Deframer, Message, Packet, Start};
use plumbline::seal::Key;
use plumbline_bedside::keys::Store;
use plumbline_files::counting::counted;
use plumbline_files::{BadInput, write_all};
use plumbline_stream::sealed_box::SealedBox;
use plumbline_trial::correction::Replacements;
use plumbline_trial::derived::{self, Changes};
use plumbline_trial::journal::{Content, Entry, Reader};
use plumbline_trial::verdict::{self, Criteria};
use plumbline_trial::{Trial, names};

use crate::ui::stop::stop_on_signals;

/// Somebody must listen within this time.
const MEET_WITHIN: Duration = Duration::from_secs(60);

/// Whoever has missed something asks for it within this time.
const ASKS_WITHIN: Duration = Duration::from_millis(600);

/// The link is looked after this often.
const TURN: Duration = Duration::from_millis(10);

/// Send a recorded trial's packets again, or rebuild its tables and its verdict.
///
/// With --to the packets leave this computer as the box sent them, at their times and sealed by its
/// key: for `plumb receive`, or to try a program of your own without a box. It waits until somebody
/// listens there.
///
/// With --tables the trial's tables and trial.toml are rebuilt from its packets: for a recording
/// that was cut off, or one whose tables or trial.toml are lost or spoiled. The verdict on the trial
/// (good, doubtful or unusable) is found anew.
///
/// What the box was told can be replaced then, because the packets hold the targets' poses:
/// --scene if it did not know which way is forward, or wrongly; --targets if their roles were
/// exchanged, or for another pitch or virtual point of the same grids; --camera for another
/// calibration at the same frame size. What was recorded stays as it is, and --as-recorded goes back
/// to it. Each replacement starts from what was recorded: give all files at once.
#[derive(Debug, Args)]
#[command(group(
    clap::ArgGroup::new("what").required(true).args(["to", "tables", "new_criteria"])
))]
#[command(after_help = "Examples:\n  plumb replay trials/p01 --to 127.0.0.1:4210\n  \
    plumb replay trials/p01 --to 127.0.0.1:4210 --speed 10\n  plumb replay trials/p01 --tables\n  \
    plumb replay trials/p01 --tables --scene scene.toml\n  \
    plumb replay trials/p01 --tables --camera camera.toml --targets targets.toml\n  \
    plumb replay --new-criteria criteria.toml       # to be edited, then:\n  \
    plumb replay trials/p01 --tables --criteria criteria.toml")]
pub struct Arguments {
    /// The trial's folder
    #[arg(required_unless_present = "new_criteria")]
    trial: Option<PathBuf>,

    /// Send its packets to this address
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = crate::arguments::address)]
    to: Option<SocketAddr>,

    /// Whose key seals them, as in `plumb keys list` [default: that of the box that was recorded]
    #[arg(long, value_name = "BOX", requires = "to")]
    box_name: Option<String>,

    /// Send this many times faster
    #[arg(long, default_value_t = 1.0, requires = "to", value_parser = speed)]
    speed: f64,

    /// Rebuild samples.csv, samples.parquet and trial.toml
    #[arg(long)]
    tables: bool,

    /// Which way is forward: the scene that the box should have had
    #[arg(long, value_name = "FILE", requires = "tables")]
    scene: Option<PathBuf>,

    /// The camera that the box should have had, at the same frame size
    #[arg(long, value_name = "FILE", requires = "tables")]
    camera: Option<PathBuf>,

    /// The targets that the box should have had, of the same grids
    #[arg(long, value_name = "FILE", requires = "tables")]
    targets: Option<PathBuf>,

    /// Take back what was replaced
    #[arg(long, requires = "tables", conflicts_with_all = ["scene", "camera", "targets"])]
    as_recorded: bool,

    /// Judge the trial by these criteria from now on
    #[arg(long, value_name = "FILE", requires = "tables")]
    criteria: Option<PathBuf>,

    /// Write the criteria of the verdict into this file, each explained, to be edited
    #[arg(long, value_name = "FILE", conflicts_with = "trial")]
    new_criteria: Option<PathBuf>,

    /// Replace the file of --new-criteria if it exists
    #[arg(long, requires = "new_criteria")]
    force: bool,
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
    if let Some(path) = &arguments.new_criteria {
        write_all(&[(path.clone(), verdict::EXAMPLE.into())], arguments.force)?;
        eprintln!("written to {}; edit it, and give it with --criteria", path.display());
        return Ok(());
    }
    let Some(folder) = &arguments.trial else {
        unreachable!("the command line requires a trial where it does not name --new-criteria");
    };
    if arguments.tables {
        rebuild(folder, arguments)?;
    }
    if let Some(to) = arguments.to {
        let stop = stop_on_signals()?;
        let sent = send(folder, arguments, to, &stop)?;
        // A closed pipe must not hide the result.
        let _ = writeln!(std::io::stdout(), "{} sent to {to}", counted(sent, "packet"));
    }
    Ok(())
}

fn rebuild(folder: &Path, arguments: &Arguments) -> Result<(), BadInput> {
    let Arguments { scene, camera, targets, as_recorded, .. } = arguments;
    let replaced = [scene, camera, targets].into_iter().any(Option::is_some).then(|| {
        Replacements { scene: scene.clone(), camera: camera.clone(), targets: targets.clone() }
    });
    let criteria = arguments.criteria.as_deref().map(Criteria::read).transpose()?;
    let changes = Changes { criteria, replaced, as_recorded: *as_recorded };
    let trial = derived::remake(folder, &changes)?;
    for warning in &trial.warnings {
        eprintln!("warning: {warning}");
    }
    let text = format!(
        "{}: {}, {} and {} were rebuilt\n{}",
        folder.display(),
        names::CSV,
        names::PARQUET,
        names::MANIFEST,
        trial.manifest.verdict().lines()
    );
    // A closed pipe must not hide the result.
    let _ = writeln!(std::io::stdout(), "{text}");
    Ok(())
}

fn send(
    folder: &Path,
    arguments: &Arguments,
    to: SocketAddr,
    stop: &AtomicBool,
) -> Result<u64, BadInput> {
    let trial = Trial::open(folder)?;
    for warning in &trial.warnings {
        eprintln!("warning: {warning}");
    }
    let mut played = Played { to, key: key_of(&trial, arguments)?, start: None };
    let path = folder.join(names::JOURNAL);
    let last_ns = last(&path)?;
    let mut journal = Reader::open(&path)?;
    let bar = ProgressBar::new(last_ns / 1_000_000).with_style(
        ProgressStyle::with_template("replaying {wide_bar} {msg}").expect("a constant template"),
    );
    let mut begun = None;
    let mut deframer = Deframer::new();
    let mut sent = 0;
    while let Some(Entry { host_ns, content }) = journal.next_entry()? {
        if let Some(start) = begun {
            let at: Instant = start + Duration::from_nanos(host_ns).div_f64(arguments.speed);
            played.live_until(at, stop);
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
            Content::About(_) | Content::Check(_) | Content::NotAuthentic(_) => {}
            Content::Raw(raw) => {
                let Ok(packet) = raw.decode(&mut deframer) else { continue };
                let is_sent = played.send(&packet, stop)?;
                sent += u64::from(is_sent);
                if is_sent && begun.is_none() {
                    let now = Instant::now();
                    let before = Duration::from_nanos(host_ns).div_f64(arguments.speed);
                    begun = Some(now.checked_sub(before).unwrap_or(now));
                }
            }
        }
    }
    played.finish(stop);
    bar.finish_and_clear();
    Ok(sent)
}

/// The key of the box that was recorded, or of the one that was chosen.
fn key_of(trial: &Trial, arguments: &Arguments) -> Result<Key, BadInput> {
    let store = Store::open()?;
    if let Some(called) = &arguments.box_name {
        return Ok(store.find(called)?.key);
    }
    let serial_number = trial.manifest.the_box.as_ref().map(|it| it.serial_number.as_str());
    let known = serial_number.map(|it| store.by_serial_number(it)).transpose()?.flatten();
    known.map(|it| it.key).ok_or_else(|| {
        let number = serial_number.unwrap_or("an unknown number");
        BadInput::whole(
            trial.folder.display(),
            format!("it is of the box {number}, whose key this computer does not have"),
            "seal it by another key: --box-name (see `plumb keys list`)",
        )
    })
}

/// The box that is played.
struct Played {
    to: SocketAddr,
    key: Key,
    /// The start that is being played.
    start: Option<(Start, SealedBox)>,
}

impl Played {
    /// Sends a packet, once somebody listens. Answers are left out: they were given to whoever asked,
    /// by a clock that is not theirs who hear it now.
    fn send(&mut self, packet: &Packet, stop: &AtomicBool) -> Result<bool, BadInput> {
        let (Some(start), false) = (packet.start, matches!(packet.message, Message::Reply(_)))
        else {
            return Ok(false);
        };
        if self.start.as_ref().is_none_or(|(of, _)| *of != start) {
            self.finish(stop);
            let failed = |error| BadInput::io(format!("UDP {}", self.to), &error);
            let played =
                SealedBox::start(self.to, start, Some(self.key.clone())).map_err(failed)?;
            self.start = Some((start, played));
            self.meet(stop)?;
        }
        if let Some((_, played)) = &mut self.start {
            played.send(&packet.message);
        }
        Ok(!stop.load(Ordering::Relaxed))
    }

    /// Waits until somebody listens.
    fn meet(&mut self, stop: &AtomicBool) -> Result<(), BadInput> {
        let Some((_, played)) = &mut self.start else { return Ok(()) };
        let give_up = Instant::now() + MEET_WITHIN;
        while !played.is_heard() && !stop.load(Ordering::Relaxed) {
            if Instant::now() >= give_up {
                return Err(BadInput::whole(
                    format!("UDP {}", self.to),
                    format!("nobody has listened there for {} s", MEET_WITHIN.as_secs()),
                    "start `plumb receive` there, on a computer that has the box's key",
                ));
            }
            played.live(TURN);
        }
        Ok(())
    }

    fn live_until(&mut self, at: Instant, stop: &AtomicBool) {
        while let Some(wait) = at.checked_duration_since(Instant::now())
            && !stop.load(Ordering::Relaxed)
        {
            match &mut self.start {
                Some((_, played)) => played.live(wait.min(TURN)),
                None => std::thread::sleep(wait.min(TURN)),
            }
        }
    }

    /// Sends again what was lost, for as long as it is asked for.
    fn finish(&mut self, stop: &AtomicBool) {
        let Some((_, mut played)) = self.start.take() else { return };
        let mut quiet_since = Instant::now();
        while quiet_since.elapsed() < ASKS_WITHIN && !stop.load(Ordering::Relaxed) {
            played.live(TURN);
            if played.since_asked().is_some_and(|since| since < TURN) {
                quiet_since = Instant::now();
            }
        }
    }
}

/// The time of the last entry.
fn last(path: &Path) -> Result<u64, BadInput> {
    let mut journal = Reader::open(path)?;
    let mut last_ns = 0;
    while let Some(entry) = journal.next_entry()? {
        last_ns = entry.host_ns;
    }
    Ok(last_ns)
}
