//! `plumb aim`: what the camera of a box sees, for framing, focus and exposure, and whole
//! frames to calibrate it with.
//!
//! ```text
//!  a session in set-up mode ─┬▶ live: terminal
//!                            ├▶ plain: lines, a PNG, stills
//!                            └▶ the search for an exposure
//! ```

use std::io::Write as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use image::RgbImage;
use plumbline::packet::LinkKind;
use plumbline_bedside::aim::{
    BestFocus, Follower, Reading, Session, Stills, Taken, Wanted, find_exposure, store_exposure,
};
use plumbline_bedside::draw;
use plumbline_files::BadInput;
use plumbline_files::targets;

use crate::arguments::{LinkArguments, seconds};
use crate::ui::stop::stop_on_signals;
use crate::ui::waiting;

mod ability;
mod blocks;
mod live;
mod plain;
mod terminal;

use terminal::Graphics;

/// Aim, focus and expose the camera of a box, by its picture.
///
/// Shows the picture with the targets that are found in it, and for each its focus (100: as
/// sharp as it gets), contrast, saturation, size and distance, the precision that they promise,
/// and what to do about it. In a terminal the picture is a sixel or made of half blocks;
/// elsewhere, or with --png, the numbers come as lines.
///
/// The box is in set-up mode meanwhile: only then do pictures leave it. The mode ends with this
/// program, or by itself soon after this program has gone.
///
/// Keys: q or Ctrl-C ends it, s takes a still: into the current directory without --stills.
/// Exit code 0: done; 2: an input or the box could not be used, or the box is no longer heard.
#[derive(Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:
  A box that sends to this computer's port 4210:
    plumb aim
  Over a serial line, in a terminal without sixels:
    plumb aim --serial /dev/ttyUSB0 --graphics blocks
  Exposure and gain, by the targets, into the box's configuration:
    plumb aim --expose --store
  Photographs for plumb calibrate:
    plumb aim --stills photos --count 15 --every 5 --board 9x6
  A picture for a report:
    plumb aim --png view.png --reduction 1 --once"
)]
pub struct Arguments {
    /// Where the box sends to.
    #[command(flatten)]
    link: LinkArguments,

    /// How the picture is shown in a terminal
    #[arg(long, value_enum, default_value_t = Graphics::Auto)]
    graphics: Graphics,

    /// Pixels of the frame per pixel of the picture, either way, 1 to 16 [default: 2; 4 over a
    /// serial line]
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u8).range(1..=16))]
    reduction: Option<u8>,

    /// Write the picture, with the targets drawn into it, to this file again and again, and the
    /// numbers as lines
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,

    /// Show one picture and its numbers, then end
    #[arg(long, conflicts_with_all = ["stills", "count", "expose"])]
    once: bool,

    /// Take stills, whole frames without loss, into this directory: still-01.png and so on
    #[arg(long, value_name = "DIR")]
    stills: Option<PathBuf>,

    /// Take this many stills automatically, then end
    #[arg(long, value_name = "NUMBER", requires = "stills", value_parser = clap::value_parser!(u32).range(1..=999))]
    count: Option<u32>,

    /// Time from one still to the next, to move the board
    #[arg(long, value_name = "SECONDS", requires = "count", default_value = "3", value_parser = seconds)]
    every: Duration,

    /// Say after each still whether this board is found in it: columns x rows of INNER corners
    #[arg(long, value_name = "COLUMNSxROWS", requires = "stills", value_parser = targets::grid_size)]
    board: Option<[u8; 2]>,

    /// Replace stills that exist; and aim, or --store, even while somebody records a trial, which that
    /// spoils
    #[arg(long)]
    force: bool,

    /// Find the exposure and the gain at which the targets are well exposed, and end
    #[arg(long, conflicts_with_all = ["stills", "png"])]
    expose: bool,

    /// Put what --expose finds into the box's configuration
    #[arg(long, requires = "expose")]
    store: bool,

    /// End after this many seconds; the box allows 1800
    #[arg(long, value_name = "SECONDS", default_value = "600", value_parser = duration)]
    duration: Duration,
}

/// The box ends set-up mode after this, so that no terminal left open keeps a ward in view.
const DURATION_MAX: Duration = Duration::from_secs(30 * 60);

fn duration(text: &str) -> Result<Duration, String> {
    let duration = seconds(text)?;
    if duration > DURATION_MAX {
        return Err(format!("give {} seconds at most", DURATION_MAX.as_secs()));
    }
    Ok(duration)
}

/// Reduction of the pictures over a network, and over a serial line.
const REDUCTION_UDP: u8 = 2;
const REDUCTION_SERIAL: u8 = 4;

/// Runs the subcommand.
///
/// # Errors
/// When an option, the box or an output cannot be used.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let is_live = !arguments.expose && live::is_possible(arguments);
    if arguments.stills.is_some() && arguments.count.is_none() && !is_live {
        let found = "without a terminal there is no key to take stills with";
        let remedy = "say how many to take with --count";
        return Err(BadInput::whole("--stills", found, remedy).into());
    }
    if let Some(path) = &arguments.png {
        plain::check(path)?;
    }
    let mut stills = Stills::new(Wanted {
        directory: arguments.stills.clone().unwrap_or_else(|| PathBuf::from(".")),
        force: arguments.force,
        count: arguments.count,
        every: arguments.every,
        board: arguments.board,
    })?;
    let stop = stop_on_signals()?;
    let mut session = {
        let link = arguments.link.open()?;
        Session::begin(link, arguments.force, &mut waiting::shown())?
    };
    let config = session.config();
    eprintln!(
        "the box \"{}\" ({}) is in set-up mode: only in it do pictures leave the box",
        config.device, config.serial_number
    );
    let until = Until { stop: &stop, at: Instant::now() + arguments.duration };
    let mut watch = Watch::new(arguments, session.kind());
    let mut exposed = None;
    let outcome = if arguments.expose {
        find_exposure(&mut session, &mut Followed(until)).map(|found| exposed = found)
    } else if is_live {
        live::run(arguments, &mut session, &mut stills, &mut watch, until)
    } else {
        plain::run(arguments, &mut session, &mut stills, &mut watch, until)
    };
    let met = session.hello().clone();
    let ended = session.end();
    match &ended {
        Ok(_) => eprintln!("the box has left set-up mode: pictures no longer leave it"),
        Err(error) => eprintln!("warning: {error}"),
    }
    match outcome {
        // The reader has seen enough, as `head` does.
        Err(error) if error.is_closed_pipe() => return Ok(()),
        outcome => outcome?,
    }
    match exposed {
        Some(setting) if arguments.store => {
            Ok(store_exposure(&mut ended?, &met, setting, &mut waiting::shown())?)
        }
        _ => Ok(()),
    }
}

/// When the program ends by itself.
#[derive(Clone, Copy)]
struct Until<'a> {
    stop: &'a std::sync::atomic::AtomicBool,
    at: Instant,
}

impl Until<'_> {
    fn is_over(&self) -> bool {
        self.stop.load(std::sync::atomic::Ordering::Relaxed) || Instant::now() >= self.at
    }
}

/// A search for an exposure, on standard output.
struct Followed<'a>(Until<'a>);

impl Follower for Followed<'_> {
    fn say(&mut self, text: &str) -> Result<(), BadInput> {
        say(text)
    }

    fn is_over(&mut self) -> bool {
        self.0.is_over()
    }
}

/// What is remembered of earlier numbers.
struct Watch {
    best: BestFocus,
    /// Of the pictures that are shown.
    reduction: u8,
}

impl Watch {
    fn new(arguments: &Arguments, kind: LinkKind) -> Self {
        let usual = if kind == LinkKind::Serial { REDUCTION_SERIAL } else { REDUCTION_UDP };
        Self { best: BestFocus::default(), reduction: arguments.reduction.unwrap_or(usual) }
    }

    /// The latest numbers, if there are any.
    fn reading(&mut self, session: &Session) -> Option<Reading> {
        session.reading(&mut self.best)
    }
}

/// A picture with what was found in its frame drawn in.
fn annotated(picture: RgbImage, taken: &Taken, session: &Session) -> RgbImage {
    match &taken.pose {
        Some(pose) => {
            let config = session.config();
            draw::annotate(picture, config, draw::drawn(pose, config))
        }
        None => picture,
    }
}

/// A line on standard output.
fn say(text: &str) -> Result<(), BadInput> {
    writeln!(std::io::stdout(), "{text}").map_err(|error| BadInput::io("standard output", &error))
}
