//! The keys of boxes that this computer knows.
//!
//! One file for each box, in a folder of this user's data: the folder has the mode 0700 and each file
//! 0600, and what others can read is refused. A file's name is the key's identity, so that one box
//! has one file whatever it is called.
//!
//! Several programs may use the store at once. Each file is renamed atomically, so that a reader
//! sees the old or the new one; who changes something holds a lock from reading it to writing it, so
//! that nothing that another program has noted is lost.

use std::fs::{File, Metadata};
use std::io::ErrorKind;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use plumbline::config::is_visible;
use plumbline::limits::DEVICE_TEXT_BYTES_MAX;
use plumbline::seal::{Key, KeyId};
use plumbline_files::{BadInput, private};
use zeroize::Zeroizing;

use crate::kept;

mod known_box;
mod plan;

pub use known_box::KnownBox;
pub use plan::{Found, Plan, beside, file};

/// The folder of the keys.
const KIND: &str = "keys";

/// The lock's file, beside the keys.
const LOCK: &str = "lock";

/// The fewest digits of a key's identity that name a box.
const ID_DIGITS_MIN: usize = 4;

/// The keys that are kept for this user.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
}

/// The boxes of a store.
#[derive(Debug)]
pub struct Boxes {
    /// Those whose files can be used, in the order of their names and serial numbers.
    pub known: Vec<KnownBox>,
    /// Why the other files cannot.
    pub refused: Vec<BadInput>,
}

impl Store {
    /// The store of this user. It may be empty.
    ///
    /// # Errors
    /// When this user has no home directory, or others can look into the folder.
    pub fn open() -> Result<Self, BadInput> {
        Self::at(kept::folder(KIND)?)
    }

    /// The store in this folder.
    ///
    /// # Errors
    /// When others can look into it.
    pub fn at(folder: PathBuf) -> Result<Self, BadInput> {
        match std::fs::metadata(&folder) {
            Ok(metadata) => refuse_shared(&folder, &metadata, "700")?,
            // It is made with the first key.
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => return Err(BadInput::io(folder.display(), &error)),
        }
        Ok(Self { folder })
    }

    /// Where it is.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Every box that is known here.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn all(&self) -> Result<Boxes, BadInput> {
        // While a key is replaced, there are both for a moment.
        let path = self.folder.join(LOCK);
        let lock = File::open(&path).and_then(|file| file.lock_shared().map(|()| file));
        match lock {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                Err(BadInput::io(path.display(), &error))
            }
            _ => self.boxes(),
        }
    }

    /// The one box of this name, this serial number, or a key whose identity begins so.
    ///
    /// # Errors
    /// When there is none, or there are several.
    pub fn find(&self, called: &str) -> Result<KnownBox, BadInput> {
        refuse_key_as_argument(called)?;
        let mut boxes = self.all()?;
        let place = format!("the box {called:?}");
        let is = |name: &Option<String>| name.as_deref() == Some(called);
        let digits = called.to_ascii_lowercase();
        let is_id = |it: &KnownBox| {
            digits.len() >= ID_DIGITS_MIN && it.key.id().to_string().starts_with(&digits)
        };
        let mut found: Vec<KnownBox> =
            boxes.known.extract_if(.., |it| is(&it.name) || is(&it.serial_number)).collect();
        if found.is_empty() {
            found = boxes.known.extract_if(.., |it| is_id(it)).collect();
        }
        match (found.pop(), found.is_empty()) {
            (Some(only), true) => Ok(only),
            (Some(last), false) => {
                found.push(last);
                let each = found.iter().map(|it| format!("{}: {}", it.key.id(), it.title()));
                let each = each.collect::<Vec<_>>().join("; ");
                let remedy = "name it by its serial number, or by the first digits of its key";
                Err(BadInput::whole(
                    place,
                    format!("{} are called so: {each}", found.len()),
                    remedy,
                ))
            }
            // It may be the one that cannot be read.
            (None, _) if !boxes.refused.is_empty() => Err(boxes.refused.swap_remove(0)),
            (None, _) => Err(BadInput::whole(
                place,
                "its key is not known here",
                match &boxes.known[..] {
                    [] => {
                        "no key is: make one with `plumb provision --new-key`, or bring one from \
                           another computer with `plumb keys import`"
                            .to_owned()
                    }
                    known => {
                        let known = known.iter().map(KnownBox::title).collect::<Vec<_>>();
                        format!("known are: {}; see `plumb keys list`", known.join(", "))
                    }
                },
            )),
        }
    }

    /// The box of this key, if it is known here.
    ///
    /// # Errors
    /// When its file cannot be used.
    pub fn by_id(&self, id: KeyId) -> Result<Option<KnownBox>, BadInput> {
        let path = self.path(id);
        if !path.exists() {
            return Ok(None);
        }
        read(&path).map(Some)
    }

    /// The box of this serial number, if its key is known here.
    ///
    /// # Errors
    /// When it may be that of a file that cannot be used.
    pub fn by_serial_number(&self, serial_number: &str) -> Result<Option<KnownBox>, BadInput> {
        let mut boxes = self.all()?;
        let is = |it: &KnownBox| it.serial_number.as_deref() == Some(serial_number);
        match boxes.known.into_iter().find(is) {
            None if !boxes.refused.is_empty() => Err(boxes.refused.swap_remove(0)),
            found => Ok(found),
        }
    }

    /// Keeps the key of another box.
    ///
    /// # Errors
    /// When the key or the serial number is that of a box here, or the file cannot be written.
    pub fn add(&self, new: &KnownBox) -> Result<(), BadInput> {
        let _lock = self.lock()?;
        let place = self.folder.display();
        if let Some(old) = self.by_id(new.key.id())? {
            let found =
                format!("the key {} is here already, of the box {}", old.key.id(), old.title());
            return Err(BadInput::whole(place, found, "forget it first: `plumb keys forget`"));
        }
        if let Some(old) = self.of_the_same_box(new)?.first() {
            let found = format!("the box {} has another key here, {}", old.title(), old.key.id());
            return Err(BadInput::whole(place, found, "--replace forgets that one"));
        }
        self.write(new)
    }

    /// Keeps a key in place of all others of the same serial number. Of one that is here already,
    /// name and serial number are replaced, and what was noted of it stays.
    ///
    /// # Errors
    /// When the files cannot be written.
    pub fn replace(&self, new: &KnownBox) -> Result<(), BadInput> {
        let _lock = self.lock()?;
        let old = self.of_the_same_box(new)?;
        let mut new = new.clone();
        // A file that cannot be used is replaced.
        if let Ok(Some(known)) = self.by_id(new.key.id()) {
            new.made = known.made;
            new.address = known.address;
            new.start_count = known.start_count;
        }
        // First the new one: whatever happens in between, the box has a key.
        self.write(&new)?;
        old.iter().try_for_each(|old| self.remove(old.key.id()))
    }

    /// Forgets a key; false if it was not known.
    ///
    /// # Errors
    /// When its file cannot be removed.
    pub fn forget(&self, id: KeyId) -> Result<bool, BadInput> {
        let _lock = self.lock()?;
        let is_known = self.path(id).exists();
        self.remove(id)?;
        Ok(is_known)
    }

    /// Notes where a box was heard. What is noted already costs no writing.
    ///
    /// # Errors
    /// When its file cannot be read or written.
    pub fn note_address(&self, id: KeyId, address: SocketAddr) -> Result<(), BadInput> {
        if self.by_id(id)?.is_none_or(|it| it.address == Some(address)) {
            return Ok(());
        }
        self.change(id, |it| it.address = Some(address))
    }

    /// Notes what a box is called now. What is noted already costs no writing.
    ///
    /// # Errors
    /// When its file cannot be read or written.
    pub fn note_name(&self, id: KeyId, name: &str) -> Result<(), BadInput> {
        if self.by_id(id)?.is_none_or(|it| it.name.as_deref() == Some(name)) {
            return Ok(());
        }
        self.change(id, |it| it.name = Some(name.to_owned()))
    }

    /// Takes the number of a start on a line without a way back: true, and noted on the disk, if it
    /// is above all that were taken for this key. Otherwise packets of an earlier start may have been
    /// played again, and it is not taken; nor is that of a key which is not known.
    ///
    /// # Errors
    /// When its file cannot be read or written; it is then not taken.
    pub fn take_start_count(&self, id: KeyId, start_count: u32) -> Result<bool, BadInput> {
        let mut is_new = false;
        self.change(id, |it| {
            is_new = it.start_count.is_none_or(|highest| start_count > highest);
            if is_new {
                it.start_count = Some(start_count);
            }
        })?;
        Ok(is_new)
    }

    /// Changes what is noted of a box, if it is known.
    fn change(&self, id: KeyId, change: impl FnOnce(&mut KnownBox)) -> Result<(), BadInput> {
        let _lock = self.lock()?;
        let Some(old) = self.by_id(id)? else { return Ok(()) };
        let mut new = old.clone();
        change(&mut new);
        if new != old {
            self.write(&new)?;
        }
        Ok(())
    }

    /// The keys other than `new` that are of its serial number.
    fn of_the_same_box(&self, new: &KnownBox) -> Result<Vec<KnownBox>, BadInput> {
        let is_same = |it: &KnownBox| {
            it.key != new.key
                && new.serial_number.is_some()
                && it.serial_number == new.serial_number
        };
        Ok(self.boxes()?.known.into_iter().filter(is_same).collect())
    }

    fn boxes(&self) -> Result<Boxes, BadInput> {
        let mut boxes = Boxes { known: Vec::new(), refused: Vec::new() };
        let failed = |error: std::io::Error| BadInput::io(self.folder.display(), &error);
        let listed = match std::fs::read_dir(&self.folder) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(boxes),
            listed => listed.map_err(failed)?,
        };
        for entry in listed {
            let path = entry.map_err(failed)?.path();
            if path.extension().is_none_or(|it| it != "toml") {
                continue;
            }
            match read(&path) {
                Ok(known) => boxes.known.push(known),
                // Another program has just forgotten it.
                Err(_) if !path.exists() => {}
                Err(error) => boxes.refused.push(error),
            }
        }
        let place = |it: &KnownBox| (it.name.clone(), it.serial_number.clone(), it.key.id());
        boxes.known.sort_by_key(place);
        boxes.refused.sort_by(|one, other| one.place.cmp(&other.place));
        Ok(boxes)
    }

    /// Until the file is dropped, no other program changes anything.
    fn lock(&self) -> Result<File, BadInput> {
        plumbline_files::make_directory(&self.folder)?;
        let path = self.folder.join(LOCK);
        let mut options = private::options();
        let file = options.create(true).truncate(false).write(true).open(&path);
        file.and_then(|file| file.lock().map(|()| file))
            .map_err(|error| BadInput::io(path.display(), &error))
    }

    fn write(&self, known: &KnownBox) -> Result<(), BadInput> {
        plumbline_files::replace(&self.path(known.key.id()), known.to_toml().as_bytes())
    }

    fn remove(&self, id: KeyId) -> Result<(), BadInput> {
        let path = self.path(id);
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                Err(BadInput::io(path.display(), &error))
            }
            _ => {
                plumbline_files::sync_directory(&self.folder);
                Ok(())
            }
        }
    }

    fn path(&self, id: KeyId) -> PathBuf {
        self.folder.join(format!("{id}.toml"))
    }
}

/// A new key, of the operating system's random numbers.
///
/// # Errors
/// When it has none to give.
pub fn draw() -> Result<Key, BadInput> {
    let failed = |found: String| {
        BadInput::whole("a new key", found, "the operating system gives no random numbers")
    };
    let mut bytes = Zeroizing::new([0; 32]);
    getrandom::fill(bytes.as_mut_slice()).map_err(|error| failed(error.to_string()))?;
    Key::new(*bytes).map_err(|error| failed(error.to_string()))
}

/// A name or a serial number, as a box can have it, of an option.
///
/// # Errors
/// The text says what to give instead.
pub fn device_text(text: &str) -> Result<String, String> {
    if text.is_empty() || text.len() > DEVICE_TEXT_BYTES_MAX || !text.chars().all(is_visible) {
        return Err(format!("give 1 to {DEVICE_TEXT_BYTES_MAX} bytes of letters that can be seen"));
    }
    Ok(text.to_owned())
}

/// Refuses the text of a key in place of a file's or a box's name, without repeating it.
///
/// # Errors
/// When it is one.
pub fn refuse_key_as_argument(argument: &str) -> Result<(), BadInput> {
    if !argument.trim_start().to_ascii_uppercase().starts_with("PLUMBLINE-KEY-") {
        return Ok(());
    }
    Err(BadInput::whole(
        "the command line",
        "a key, which every program of this computer can read there, and the shell remembers",
        "give it in a file, or on standard input with -; if others use this computer, give the box \
         a new one: `plumb provision --new-key`",
    ))
}

fn read(path: &Path) -> Result<KnownBox, BadInput> {
    let place = path.display().to_string();
    let metadata = std::fs::metadata(path).map_err(|error| BadInput::io(&place, &error))?;
    refuse_shared(path, &metadata, "600")?;
    let text = Zeroizing::new(plumbline_files::read_text(path)?);
    let known = KnownBox::parse(&text, &place)?;
    if path.file_stem().and_then(|it| it.to_str()) != Some(&known.key.id().to_string()) {
        let found = format!("another key than its name says, {}", known.key.id());
        return Err(BadInput::new(
            place,
            "key",
            found,
            "remove the file, and import the key again",
        ));
    }
    Ok(known)
}

/// Refuses a file or a folder that others can use.
fn refuse_shared(path: &Path, metadata: &Metadata, wanted: &str) -> Result<(), BadInput> {
    let Some(mode) = private::shared_mode(metadata) else { return Ok(()) };
    let found = format!("others on this computer can use it (mode {mode:03o})");
    let remedy = format!(
        "chmod {wanted} {}; if somebody may have read it, give the box a new key: \
         `plumb provision --new-key`",
        path.display()
    );
    Err(BadInput::whole(path.display(), found, remedy))
}

#[cfg(test)]
mod tests;
