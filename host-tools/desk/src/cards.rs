//! New boxes: their keys, and the files for their cards.
//!
//! ```text
//!  settings, targets ─▶ configuration ─┬▶ boxes/ID/config.plb in the desk's folder ─▶ the card
//!              a new key, in the store ─┴─▶ only until the box was heard ───────────▶ the card
//! ```
//!
//! The key is kept where the keys of all boxes are, and nowhere else. It is given to a page as long as
//! its box was never heard: from then on nobody needs it for the card.

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

use plumbline::config::{Config, FILE_NAME};
use plumbline::seal::KEY_FILE_NAME;
use plumbline_bedside::box_settings::{self, BoxSettings};
use plumbline_bedside::keys::{self, KnownBox, Plan, Store};
use plumbline_bedside::setup::{self, Places};
use plumbline_files::BadInput;

use crate::prints;
use crate::settings::{self, PLACE};
use crate::station::Refusal;
use crate::wire::{Card, NewBox, NewBoxForm, Problem};

/// The folder with one for each box that was made here.
const BOXES: &str = "boxes";

/// The size of the frames of the camera that README recommends.
const SIZE_PX: [u16; 2] = [1456, 1088];

/// The most addresses of this computer that are proposed.
const ADDRESSES_MAX: usize = 16;

/// A file for a card, and its bytes.
pub type File = (&'static str, Vec<u8>);

/// Where the files of a box are: its id has nothing but hexadecimal digits.
fn folder_of(folder: &Path, known: &KnownBox) -> PathBuf {
    folder.join(BOXES).join(known.key.id().to_string())
}

/// Whether a box was made on this desk, and was never heard: its card may have to be written.
#[must_use]
pub fn is_waiting(folder: &Path, known: &KnownBox) -> bool {
    known.address.is_none() && folder_of(folder, known).join(FILE_NAME).exists()
}

/// What a form for a new box begins with; `udp` is where the desk hears boxes.
///
/// # Errors
/// None that a user could mend.
pub fn form(udp: &[SocketAddr]) -> Result<NewBoxForm, BadInput> {
    let settings = box_settings::parse(box_settings::NEW_BOX, PLACE)?;
    Ok(NewBoxForm {
        settings: settings::view(&settings),
        size_px: SIZE_PX,
        addresses: addresses(udp).iter().map(SocketAddr::to_string).collect(),
    })
}

/// Where a box can send to, so that it is heard here.
fn addresses(udp: &[SocketAddr]) -> Vec<SocketAddr> {
    let own = if_addrs::get_if_addrs().into_iter().flatten();
    let own = own.filter(|it| !it.is_loopback()).map(|it| it.ip());
    let own: Vec<IpAddr> = own.filter(IpAddr::is_ipv4).collect();
    let mut all: Vec<SocketAddr> = udp
        .iter()
        .flat_map(|heard| {
            if heard.ip().is_unspecified() {
                own.iter().map(|ip| SocketAddr::new(*ip, heard.port())).collect()
            } else {
                vec![*heard]
            }
        })
        .collect();
    all.truncate(ADDRESSES_MAX);
    all
}

/// Makes a new box, or other files for one that was never heard: it is kept here with its key. Where
/// something fails, everything is as it was.
///
/// # Errors
/// When the settings have a fault, another box has the name or the number, or nothing can be kept.
pub fn make(folder: &Path, asked: &NewBox) -> Result<KnownBox, Refusal> {
    let settings = settings::chosen(&asked.settings)?;
    if settings.device().trim().is_empty() {
        let remedy = "give the box a name by which people know it, such as ward 3";
        return Err(BadInput::new(PLACE, "device", "it has no name", remedy).into());
    }
    let places = Places {
        camera: "the size of the frames".into(),
        targets: "the targets".into(),
        ..Places::all(PLACE)
    };
    let targets = prints::described(folder)?;
    let config = settings::first_config(&settings, asked.size_px, targets, &places)?;
    let blob = setup::blob(&config, &places)?;
    let store = Store::open()?;
    let replaced = asked.replaces.as_deref().map(|id| waiting(folder, &store, id)).transpose()?;
    refuse_taken(&store, &settings, replaced.as_ref())?;
    let write = |known: &KnownBox| {
        let path = folder_of(folder, known).join(FILE_NAME);
        plumbline_files::write_all(&[(path, blob.clone())], true)
    };
    match replaced {
        Some(known) => {
            write(&known)?;
            store.note_name(known.key.id(), settings.device())?;
            Ok(KnownBox { name: Some(settings.device().to_owned()), ..known })
        }
        None => keep(&store, &config, write),
    }
}

/// Keeps a new key, and what belongs to it: both or neither.
fn keep(
    store: &Store,
    config: &Config,
    write: impl FnOnce(&KnownBox) -> Result<(), BadInput>,
) -> Result<KnownBox, Refusal> {
    let plan = Plan::new_key(store, config, PLACE, None, false)?;
    plan.begin(store)?;
    let known = plan.made().cloned();
    let known = known.ok_or_else(|| BadInput::whole(PLACE, "no key was made", "try again"))?;
    write(&known).inspect_err(|_| plan.undo(store, &mut |_| {}))?;
    Ok(known)
}

/// Refuses the name and the number of another box.
fn refuse_taken(
    store: &Store,
    settings: &BoxSettings,
    replaced: Option<&KnownBox>,
) -> Result<(), Refusal> {
    let (name, number) = (settings.device(), settings.serial_number());
    if let Some(replaced) = replaced
        && replaced.serial_number.as_deref() != Some(number)
    {
        let found = format!("{number:?}, and its key is kept as that of {}", replaced.title());
        let remedy = "leave it as it is, or make a new box";
        return Err(BadInput::new(PLACE, "serial_number", found, remedy).into());
    }
    let others = store.all()?.known;
    let mut others =
        others.iter().filter(|it| replaced.is_none_or(|replaced| replaced.key != it.key));
    let taken = others.find_map(|it| match it {
        it if it.serial_number.as_deref() == Some(number) => Some(("serial_number", it)),
        it if it.name.as_deref() == Some(name) => Some(("device", it)),
        _ => None,
    });
    match taken {
        None => Ok(()),
        Some((field, other)) => Err(Refusal::not_now(
            format!("{PLACE}: {field}"),
            format!("the box {} has a key already, {}", other.title(), other.key.id()),
            "give this box another name and number; if it is that very box and its key is lost, \
             `plumb provision --new-key --force` makes another, which every computer needs that \
             hears the box",
        )),
    }
}

/// A box that was made here and was never heard.
fn waiting(folder: &Path, store: &Store, id: &str) -> Result<KnownBox, Refusal> {
    let known = store.all()?.known.into_iter().find(|it| it.key.id().to_string() == id);
    let none = || Refusal {
        status: 404,
        problem: Problem::new(
            "the card",
            "no box of this desk waits for one",
            "make a new box, or take the key of one that is known with `plumb keys export`",
        ),
    };
    let known = known.ok_or_else(none)?;
    if known.address.is_some() {
        return Err(Refusal::not_now(
            known.title(),
            "the box has been heard with its key, which is not given away any more",
            "for another card, `plumb provision --card` writes it, and `plumb keys export` has the \
             key",
        ));
    }
    if is_waiting(folder, &known) { Ok(known) } else { Err(none()) }
}

/// The card of a box that was never heard, to be changed.
///
/// # Errors
/// When there is none.
pub fn card(folder: &Path, id: &str) -> Result<Card, Refusal> {
    let known = waiting(folder, &Store::open()?, id)?;
    let folder = folder_of(folder, &known);
    let config = setup::read_blob(&folder.join(FILE_NAME))?;
    Ok(Card {
        settings: settings::view(&BoxSettings::of(&config)),
        size_px: [config.lens.width_px, config.lens.height_px],
        folder: folder.display().to_string(),
    })
}

/// A file for the card of a box that was never heard, by its name.
///
/// # Errors
/// When there is none, or the box has been heard.
pub fn file(folder: &Path, id: &str, name: &str) -> Result<File, Refusal> {
    let known = waiting(folder, &Store::open()?, id)?;
    match name {
        FILE_NAME => {
            let path = folder_of(folder, &known).join(FILE_NAME);
            let bytes =
                std::fs::read(&path).map_err(|error| BadInput::io(path.display(), &error))?;
            Ok((FILE_NAME, bytes))
        }
        KEY_FILE_NAME => Ok((KEY_FILE_NAME, keys::file(&known.key).to_vec())),
        _ => Err(Refusal {
            status: 404,
            problem: Problem::new(
                "the card",
                "it has no such file",
                format!("it has {FILE_NAME} and {KEY_FILE_NAME}"),
            ),
        }),
    }
}
