//! `plumb update`: another system for a box, over its link.

use std::path::PathBuf;

use indicatif::{ProgressBar, ProgressStyle};
use plumbline_bedside::update::{self, UpdateFile};

use crate::arguments::LinkArguments;
use crate::ui::waiting;

/// Give a box another system over its link, beside the measurement.
///
/// The file holds everything that a box runs: kernel, programs, drivers. It is written to a slot of the
/// box's card that is not in use, read back, and compared with what its maker has signed. Then the box
/// restarts with it once, and keeps it only if it has shown that it works: that its camera gives frames,
/// that its key can be read, that a known picture is measured right, and that this computer reaches it.
/// Whatever fails, hangs or loses power, the box starts with what it had, and says here why.
///
/// A box takes what was signed with one of the keys that its card was made with, for its own board, and
/// no version older than the oldest that its program allows. Its configuration and its key stay as they
/// are. While somebody records a trial the update waits, and goes on when it is over.
///
/// The box may be of another release than this program, an older one or a newer one.
///
/// An update of 20 MB takes about two minutes over a network, and half an hour over a serial line. A box that
/// is a program on a Debian or Raspberry Pi OS is updated with apt.
///
/// Exit code 0: the box runs the update; 2: it runs what it ran before.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  What is in a file, without any box:
    plumb update plumbline-0.2.0-rpi4.plu --show
  The box that this computer hears:
    plumb update plumbline-0.2.0-rpi4.plu
  One of several:
    plumb update plumbline-0.2.0-rpi4.plu --box-name \"ward 3\"")]
pub struct Arguments {
    /// The update's file
    #[arg(value_name = "FILE.plu")]
    file: PathBuf,

    /// Say what is in the file, and end
    #[arg(long)]
    show: bool,

    #[command(flatten)]
    link: LinkArguments,

    /// Do not wait while somebody records a trial, but spoil it
    #[arg(long)]
    force: bool,
}

/// Runs the subcommand.
///
/// # Errors
/// When the file cannot be used, or the box does not run it afterwards.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let file = UpdateFile::read(&arguments.file)?;
    if arguments.show {
        println!("{}: {file}", arguments.file.display());
        println!("a box with it goes back to version {} at most", file.header.oldest_allowed);
        return Ok(());
    }
    eprintln!("{}: {file}", arguments.file.display());
    let mut link = arguments.link.open_for_update()?;
    let bar = ProgressBar::new(file.bytes() as u64);
    if let Ok(style) = ProgressStyle::with_template(
        "sending {wide_bar} {bytes}/{total_bytes} {bytes_per_sec}, {eta} left",
    ) {
        bar.set_style(style);
    }
    let mut progress = |bytes: usize| {
        bar.set_position(bytes as u64);
        if bytes == file.bytes() {
            bar.finish_and_clear();
        }
    };
    let version =
        update::install(&mut link, &file, arguments.force, &mut progress, &mut waiting::shown())
            .inspect_err(|_| bar.finish_and_clear())?;
    eprintln!("{}: the box runs it from now on ({version})", link.place());
    Ok(())
}
