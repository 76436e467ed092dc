//! `plumb keys forget`: a box that this computer shall no longer know.

use std::io::{IsTerminal as _, stderr, stdin};

use plumbline_bedside::keys::Store;
use plumbline_files::BadInput;

/// Forget the key of a box.
///
/// This computer can then neither read what the box sends nor command it, until the key is imported
/// again: from another computer that knows it, or from the box's card. The box keeps its key.
///
/// To take a box away from a computer that others use, give the box a new key instead (`plumb
/// provision --new-key --force`): they may have copied this one.
#[derive(clap::Args)]
pub struct Arguments {
    /// The box: its name, its serial number, or the first digits of its key's identity.
    #[arg(value_name = "BOX")]
    called: String,
    /// Do not ask; needed where there is no terminal.
    #[arg(long)]
    yes: bool,
}

/// Forgets a key, once that is confirmed.
pub fn run(store: &Store, arguments: &Arguments) -> Result<(), BadInput> {
    let known = store.find(&arguments.called)?;
    let (id, title) = (known.key.id(), known.title());
    if !arguments.yes {
        if !(stdin().is_terminal() && stderr().is_terminal()) {
            let found = format!("there is no terminal to ask whether to forget the key {id}");
            return Err(BadInput::whole(format!("the box {title}"), found, "add --yes"));
        }
        eprint!(
            "forget the key {id} of the box {title}? Without it this computer can neither read nor \
             command the box. [y/N] "
        );
        let mut answer = String::new();
        stdin().read_line(&mut answer).map_err(|error| BadInput::io("standard input", &error))?;
        if !["y", "yes"].contains(&answer.trim().to_ascii_lowercase().as_str()) {
            eprintln!("nothing is forgotten");
            return Ok(());
        }
    }
    store.forget(id)?;
    eprintln!("the key {id} of the box {title} is forgotten");
    Ok(())
}
