//! `plumb keys export`: a key, for another computer.

use std::io::IsTerminal as _;
use std::path::PathBuf;

use plumbline_bedside::keys::Store;
use plumbline_files::{BadInput, write_all};
use zeroize::Zeroizing;

use super::qr::Code;
use crate::ui::stdout;

/// Show the key of a box, as text and as a QR code, or write it to a file.
///
/// Whoever sees it can read what the box sends, and command the box. On a terminal the text and a QR
/// code are shown; clear the screen afterwards. Anything else on standard output may end in a log, and
/// needs --anyway; it gets the text alone.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  plumb keys export \"ward 3\"
  plumb keys export PL-0001 --out ward-3.key    # the text, for `plumb keys import`
  plumb keys export PL-0001 --out ward-3.png    # the QR code, as a picture")]
pub struct Arguments {
    /// The box: its name, its serial number, or the first digits of its key's identity.
    #[arg(value_name = "BOX")]
    called: String,
    /// Write it to this file, which its owner alone can read: the QR code if the name ends with .png
    /// or .svg, else the text.
    #[arg(long, value_name = "FILE", conflicts_with = "anyway")]
    out: Option<PathBuf>,
    /// Replace the file of --out if it exists.
    #[arg(long, requires = "out")]
    force: bool,
    /// Write the text to standard output although that is not a terminal.
    #[arg(long)]
    anyway: bool,
}

/// Shows or writes a key.
pub fn run(store: &Store, arguments: &Arguments) -> Result<(), BadInput> {
    let known = store.find(&arguments.called)?;
    let title = known.title();
    let text = known.key.text();
    let line = Zeroizing::new(format!("{}\n", text.as_str()));
    let is_terminal = std::io::stdout().is_terminal();
    if arguments.out.is_none() && !is_terminal && !arguments.anyway {
        return Err(BadInput::whole(
            "standard output",
            format!("is no terminal, and the key of the box {title} may be kept where it goes"),
            "write it to a file that you alone can read with --out FILE, or add --anyway",
        ));
    }
    eprintln!("warning: whoever sees this key can read and command the box {title}");
    let Some(path) = &arguments.out else {
        stdout::print(&line)?;
        if is_terminal {
            let code = Code::of(&text);
            match crossterm::terminal::size() {
                Ok((columns, _)) if usize::from(columns) < code.columns() => eprintln!(
                    "the terminal is too narrow for the QR code, which has {} columns: widen it, or \
                     write a picture with --out FILE.png",
                    code.columns()
                ),
                _ => stdout::print(&code.on_terminal())?,
            }
        }
        return Ok(());
    };
    let ending = path.extension().map(|it| it.to_ascii_lowercase());
    let (bytes, what) = match ending.as_ref().and_then(|it| it.to_str()) {
        Some("png") => (Code::of(&text).png(), "its QR code"),
        Some("svg") => (Code::of(&text).svg().into_bytes(), "its QR code"),
        _ => (line.as_bytes().to_vec(), "its text"),
    };
    let outputs = [(path.clone(), bytes)];
    write_all(&outputs, arguments.force)?;
    eprintln!("{what} is written to {}; remove it when it is no longer needed", path.display());
    Ok(())
}
