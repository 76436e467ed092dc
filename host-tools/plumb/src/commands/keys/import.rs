//! `plumb keys import`: a key from another computer, or from a card.

use std::io::{IsTerminal as _, Read as _, stdin};
use std::path::{Path, PathBuf};

use plumbline::seal::Key;
use plumbline_bedside::keys::{KnownBox, Store, device_text, refuse_key_as_argument};
use plumbline_files::{BadInput, private};
use zeroize::Zeroizing;

/// Far more than the text of a key.
const TEXT_BYTES_MAX: u64 = 4096;

/// Keep the key of a box here: from a file, from standard input, or as it is typed.
///
/// The text is the one that `plumb keys export` shows, which a card has as box.key, and which a QR
/// code holds. Its checksum finds slips. Name and serial number are those of the box file, by which
/// other commands find the key; both can be given later, by importing the same key again.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  plumb keys import ward-3.key --name \"ward 3\" --serial PL-0001
  plumb keys import --serial PL-0001    # asks for the text; a scanner of QR codes types it as well
  plumb keys import - < ward-3.key")]
pub struct Arguments {
    /// The file with the key's text, never the key itself; - reads standard input. Without it the text
    /// is asked for.
    #[arg(value_name = "FILE|-")]
    file: Option<PathBuf>,
    /// The box's name.
    #[arg(long, value_name = "NAME", value_parser = device_text)]
    name: Option<String>,
    /// The box's serial number.
    #[arg(long, value_name = "NUMBER", value_parser = device_text)]
    serial: Option<String>,
    /// Forget another key of the same serial number, or give a known key another serial number.
    #[arg(long)]
    replace: bool,
}

/// Keeps a key.
pub fn run(store: &Store, arguments: &Arguments) -> Result<(), BadInput> {
    let key = match &arguments.file {
        None => typed()?,
        Some(path) if path == Path::new("-") => from_standard_input()?,
        Some(path) => from_file(path)?,
    };
    let known = keep(store, key, arguments)?;
    eprintln!("the key {} of the box {} is kept here", known.key.id(), known.title());
    if known.serial_number.is_none() {
        eprintln!(
            "its serial number is not known: `plumb provision` finds the key by it; import the key \
             again with --serial"
        );
    }
    Ok(())
}

fn keep(store: &Store, key: Key, arguments: &Arguments) -> Result<KnownBox, BadInput> {
    let Some(old) = store.by_id(key.id())? else {
        let new = KnownBox::new(key, arguments.name.clone(), arguments.serial.clone());
        if arguments.replace {
            store.replace(&new)?;
        } else {
            store.add(&new)?;
        }
        return Ok(new);
    };
    let mut new = old.clone();
    new.name = arguments.name.clone().or(new.name);
    new.serial_number = arguments.serial.clone().or(new.serial_number);
    if !arguments.replace && new.serial_number != old.serial_number {
        let other =
            new.serial_number.as_deref().map(|it| store.by_serial_number(it)).transpose()?;
        if old.serial_number.is_some() || other.flatten().is_some() {
            let found = format!("the key {} is that of the box {} here", key.id(), old.title());
            return Err(BadInput::new(
                "--serial",
                arguments.serial.as_deref().unwrap_or_default(),
                found,
                "check which box it is of; two boxes never have the same key, nor one box two; \
                 --replace gives it this serial number",
            ));
        }
    }
    store.replace(&new)?;
    Ok(new)
}

fn from_file(path: &Path) -> Result<Key, BadInput> {
    refuse_key_as_argument(&path.to_string_lossy())?;
    let place = path.display().to_string();
    let text = Zeroizing::new(plumbline_files::read_text(path)?);
    let key = of(&text, &place)?;
    if std::fs::metadata(path).is_ok_and(|it| private::shared_mode(&it).is_some()) {
        eprintln!("warning: {place}: others on this computer can read it: remove it, or chmod 600");
    }
    Ok(key)
}

fn from_standard_input() -> Result<Key, BadInput> {
    let place = "standard input";
    let mut bytes = Zeroizing::new(Vec::new());
    let read = stdin().lock().take(TEXT_BYTES_MAX).read_to_end(&mut bytes);
    read.map_err(|error| BadInput::io(place, &error))?;
    of(&String::from_utf8_lossy(&bytes), place)
}

fn typed() -> Result<Key, BadInput> {
    if !stdin().is_terminal() {
        let remedy = "give the file with its text, or - to read it from standard input";
        return Err(BadInput::whole("the key", "there is no terminal to ask for it", remedy));
    }
    eprint!("the key's text, PLUMBLINE-KEY-1:... ");
    let mut line = Zeroizing::new(String::new());
    stdin().read_line(&mut line).map_err(|error| BadInput::io("standard input", &error))?;
    of(&line, "the key")
}

fn of(text: &str, place: &str) -> Result<Key, BadInput> {
    Key::from_text(text).map_err(|error| {
        BadInput::whole(
            place,
            error,
            "give the whole text as `plumb keys export` shows it, and nothing else; a box's card has \
             it as box.key",
        )
    })
}
