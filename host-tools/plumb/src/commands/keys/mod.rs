//! `plumb keys`: the keys of boxes that this computer knows.

use clap::Subcommand;
use plumbline_bedside::keys::Store;

mod export;
mod forget;
mod import;
mod list;
mod qr;

/// See, take to another computer, and forget the keys by which this computer knows its boxes.
///
/// Each box has a key of 32 random bytes. Only a computer that has it can read what the box sends,
/// and command the box; the box sends nothing to others. `plumb provision --new-key` makes the key,
/// and puts it on the box's card as box.key beside config.plb; `plumb desk` makes one for a new box, and
/// gives it to its page on this computer. Another computer gets it with `export` here and `import` there.
/// Plumbline never sends it over a network, and no box gives it back.
///
/// A box is named by its name, its serial number, or the first digits of its key's identity, which
/// `list` shows. The identity gives nothing away; the key itself is shown by `export` alone.
///
/// No key is ever given on the command line: every program of a computer can read the command lines
/// of the others, and the shell remembers its own. It is read from a file, from standard input, or as
/// it is typed.
#[derive(clap::Args)]
#[command(
    arg_required_else_help = true,
    after_help = "\
Examples:
  plumb keys list
  To a second computer, with a file on a stick (remove it from there afterwards):
    plumb keys export \"ward 3\" --out /media/stick/ward-3.key
    plumb keys import /media/stick/ward-3.key --name \"ward 3\" --serial PL-0001
  Through a pipe, so that it is in no file:
    plumb keys export PL-0001 --anyway | ssh desk plumb keys import - --serial PL-0001
  From a card, whose box.key a computer finds beside config.plb:
    plumb keys import /media/PLUMBLINE/box.key --name \"ward 3\" --serial PL-0001
  A box that was given away:
    plumb keys forget PL-0001

The keys are in the folder plumbline/keys of this user's data (~/.local/share, or XDG_DATA_HOME),
one file for each box. They belong in the backup of this computer: a box whose key is lost needs
a new one on its card."
)]
pub struct Arguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// List the boxes whose keys are known here; no key is shown.
    List,
    Export(export::Arguments),
    Import(import::Arguments),
    Forget(forget::Arguments),
}

/// Runs the subcommand.
///
/// # Errors
/// When a box is not known, a key cannot be used, or a file cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let store = Store::open()?;
    match &arguments.action {
        Action::List => list::run(&store),
        Action::Export(arguments) => export::run(&store, arguments),
        Action::Import(arguments) => import::run(&store, arguments),
        Action::Forget(arguments) => forget::run(&store, arguments),
    }?;
    Ok(())
}
