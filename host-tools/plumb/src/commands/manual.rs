//! `plumb manual`: pages for man, and completions for shells, from the command line's own definition.

use std::path::{Path, PathBuf};

use clap::Command;
use clap_complete::Shell;
use clap_mangen::Man;
use plumbline_files::{BadInput, write_all};

/// Write pages for man and completions for shells, as the Debian package installs them.
///
/// The folder gets man1/ with a page for plumb and one for each subcommand, and completions/ with a
/// file each for bash, zsh, fish and PowerShell.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  plumb manual --out ~/.local/share/plumb                      # then `man -l ~/.local/share/plumb/man1/plumb.1`
  . ~/.local/share/plumb/completions/plumb.bash                # in ~/.bashrc
  . $HOME/plumb/completions/_plumb.ps1                         # in PowerShell's $PROFILE")]
pub struct Arguments {
    /// The folder to write to; made when absent.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Replace files that are there.
    #[arg(long)]
    force: bool,
}

/// The shells, each with its usual name for a file of completions.
const SHELLS: [(Shell, &str); 4] = [
    (Shell::Bash, "plumb.bash"),
    (Shell::Zsh, "_plumb"),
    (Shell::Fish, "plumb.fish"),
    (Shell::PowerShell, "_plumb.ps1"),
];

/// Writes the files for this command.
pub fn run(arguments: &Arguments, mut command: Command) -> anyhow::Result<()> {
    let mut files = Vec::new();
    for (shell, name) in SHELLS {
        let mut text = Vec::new();
        clap_complete::generate(shell, &mut command, "plumb", &mut text);
        files.push((Path::new("completions").join(name), text));
    }
    // The pages of a release are the same whichever of its programs has written them.
    command = command.version(env!("CARGO_PKG_VERSION"));
    command.build();
    pages(&command, &mut files)?;
    for (name, _) in &mut files {
        *name = arguments.out.join(&name);
    }
    Ok(write_all(&files, arguments.force)?)
}

/// A page for a command, and one for each of its subcommands.
fn pages(command: &Command, files: &mut Vec<(PathBuf, Vec<u8>)>) -> Result<(), BadInput> {
    let page = Man::new(command.clone());
    let name = Path::new("man1").join(page.get_filename());
    let mut text = Vec::new();
    page.render(&mut text).map_err(|error| BadInput::io(name.display(), &error))?;
    files.push((name, text));
    let own = command.get_subcommands().filter(|it| !it.is_hide_set() && it.get_name() != "help");
    own.cloned().try_for_each(|it| pages(&it, files))
}
