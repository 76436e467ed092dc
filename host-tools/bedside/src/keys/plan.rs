//! Which key a box gets with its configuration: the file box.key beside config.plb.
//!
//! A key belongs to a serial number. A new one is made only when it is asked for, and takes the
//! place of another only by force: other computers may know that one.

use std::path::{Path, PathBuf};

use plumbline::config::Config;
use plumbline::seal::{KEY_FILE_NAME, Key, KeyError};
use plumbline_files::BadInput;
use zeroize::Zeroizing;

use super::{KnownBox, Store, draw};
use crate::box_settings;
use crate::told::{Tell, Told};

/// What is beside the configuration that a card has, or will have.
#[derive(Debug, Clone, PartialEq)]
pub enum Found {
    /// No key.
    Nothing,
    /// A file that is no key.
    Unusable(KeyError),
    /// A key.
    Key(Key),
}

impl Found {
    /// What the bytes of a file are.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        // What is not text does not begin as a key does either.
        match Key::from_text(std::str::from_utf8(bytes).unwrap_or_default()) {
            Ok(key) => Self::Key(key),
            Err(error) => Self::Unusable(error),
        }
    }
}

/// The line of a key's file.
#[must_use]
pub fn file(key: &Key) -> Zeroizing<Vec<u8>> {
    Zeroizing::new(format!("{}\n", key.text().as_str()).into_bytes())
}

/// The key's file beside a configuration.
///
/// # Errors
/// When that place has no room for two files, or is the key's own.
pub fn beside(out: &Path) -> Result<PathBuf, BadInput> {
    let path = out.with_file_name(KEY_FILE_NAME);
    if path == out || (out.exists() && !out.is_file()) {
        let remedy = format!("give another file, beside which {KEY_FILE_NAME} is written");
        return Err(BadInput::new("--out", "", out.display(), remedy));
    }
    Ok(path)
}

/// What will happen to the key of a box.
#[derive(Debug, Default, PartialEq)]
pub struct Plan {
    /// The key to be written beside the configuration.
    pub written: Option<Key>,
    /// That key, if it is new and was not kept yet.
    made: Option<KnownBox>,
    /// The one that it replaces.
    replaced: Option<KnownBox>,
    /// The key of a card that was not known here, and will be.
    learnt: Option<KnownBox>,
    /// What is said about it at the end.
    pub words: String,
}

impl Plan {
    /// For a new key.
    ///
    /// # Errors
    /// When the box has no serial number, or has a key already, unless `force`.
    pub fn new_key(
        store: &Store,
        config: &Config,
        place: &str,
        found: Option<&Found>,
        force: bool,
    ) -> Result<Self, BadInput> {
        let Some(number) = serial_number(config) else {
            return Err(BadInput::new(
                place,
                "serial_number",
                "the box has none, by which its key is kept",
                "give it one in its box file",
            ));
        };
        let replaced = store.by_serial_number(number)?;
        if !force {
            if let Some(known) = &replaced {
                let found =
                    format!("the box {} has a key already, {}", known.title(), known.key.id());
                let remedy = format!(
                    "without --new-key, --card writes that one; `plumb keys export {number:?} --out \
                     {KEY_FILE_NAME}` does so beside --out; --force makes another, which every computer \
                     needs that hears the box"
                );
                return Err(BadInput::new("--new-key", "", found, remedy));
            }
            if let Some(Found::Key(key)) = found {
                let found = format!("the card has a key already, {}", key.id());
                let remedy =
                    "without --new-key it stays, and is kept here as well; --force replaces it";
                return Err(BadInput::new("--new-key", "", found, remedy));
            }
        }
        let name = Some(config.device.to_string());
        let made = KnownBox::new(draw()?, name, Some(number.to_owned()));
        let id = made.key.id();
        let words = format!(
            "a new key, {id}, for the box {}: kept in {}, and for other computers see `plumb keys \
             --help`{}",
            made.title(),
            store.folder().display(),
            sudo(|user| format!(
                "\nwarning: with sudo it is kept for root, and {user} does not find it: \
                 `sudo plumb keys export {number:?} --anyway | plumb keys import - --name {:?} \
                 --serial {number:?}`",
                config.device.as_str()
            ))
        );
        Ok(Self {
            written: Some(made.key.clone()),
            made: Some(made),
            replaced,
            learnt: None,
            words,
        })
    }

    /// For a card, without a new key.
    ///
    /// # Errors
    /// When the card has the key of another box, or not the one that is known here, unless `force`.
    pub fn for_card(
        store: &Store,
        config: &Config,
        card: &str,
        found: &Found,
        force: bool,
    ) -> Result<Self, BadInput> {
        let said = |words: String| Self { words, ..Self::default() };
        let Some(number) = serial_number(config) else {
            let has = match found {
                Found::Key(key) => format!("the card's {KEY_FILE_NAME} stays, {}", key.id()),
                _ => "warning: without a serial number the box gets no key, and is unpaired"
                    .to_owned(),
            };
            return Ok(said(has));
        };
        let name = config.device.to_string();
        match (store.by_serial_number(number)?, found) {
            (Some(known), Found::Key(key)) if known.key != *key && !force => Err(BadInput::new(
                card,
                KEY_FILE_NAME,
                format!(
                    "the key {}, where that of the box {} is {} here",
                    key.id(),
                    known.title(),
                    known.key.id()
                ),
                format!(
                    "--force writes the one that is known here; or mount the card, and import its \
                     own: `plumb keys import PLACE/{KEY_FILE_NAME} --serial {number:?} --replace`"
                ),
            )),
            (Some(known), _) => {
                let renamed = KnownBox { name: Some(name), ..known.clone() };
                let is_there = *found == Found::Key(known.key.clone());
                let stays = if is_there { ", as before" } else { "" };
                let (id, title) = (known.key.id(), renamed.title());
                Ok(Self {
                    words: format!(
                        "{card}: {KEY_FILE_NAME} is the key {id} of the box {title}{stays}"
                    ),
                    learnt: Some(renamed).filter(|it| it.name != known.name),
                    written: Some(known.key).filter(|_| !is_there),
                    ..Self::default()
                })
            }
            (None, Found::Key(key)) => {
                let other = store.by_id(key.id())?.filter(|it| it.serial_number.is_some());
                if let Some(other) = other.filter(|_| !force) {
                    let found =
                        format!("the key {} is that of the box {}", key.id(), other.title());
                    let remedy = "two boxes never have the same key: check which card this is; \
                                  --force if it is that box, which gets another serial number; \
                                  --new-key --force if it is another";
                    return Err(BadInput::new(card, KEY_FILE_NAME, found, remedy));
                }
                let learnt = KnownBox::new(key.clone(), Some(name), Some(number.to_owned()));
                let words = format!(
                    "{card}: its {KEY_FILE_NAME}, {}, stays, and is now kept here as that of the box {}",
                    key.id(),
                    learnt.title()
                );
                Ok(Self { learnt: Some(learnt), ..said(words) })
            }
            (None, Found::Unusable(error)) => Ok(said(format!(
                "warning: {card}: {KEY_FILE_NAME} is no key: {error}; the box will not be heard until \
                 it has one: {}",
                unpaired(number)
            ))),
            (None, Found::Nothing) => {
                Ok(said(format!("warning: the box will be unpaired: {}", unpaired(number))))
            }
        }
    }

    /// For a file, without a new key: what is beside it is left as it is, whatever it is.
    #[must_use]
    pub fn for_file(config: &Config, out: &Path) -> Self {
        let words = || {
            let number = serial_number(config)?;
            config.capture.as_ref()?;
            let path = beside(out).ok()?;
            let known = Store::open().and_then(|store| store.by_serial_number(number)).ok()?;
            let found = std::fs::read(&path).map(|bytes| Found::of(&Zeroizing::new(bytes))).ok();
            match (known, found) {
                (Some(known), Some(Found::Key(key))) if known.key == key => None,
                (Some(known), _) => Some(format!(
                    "the key {} of the box {} is not beside it, and belongs on the box's card as \
                     {KEY_FILE_NAME}: `plumb keys export {number:?} --out {}`",
                    known.key.id(),
                    known.title(),
                    path.display()
                )),
                (None, Some(Found::Key(_))) => None,
                (None, _) => {
                    Some(format!("no key of this box is known here: {}", unpaired(number)))
                }
            }
        };
        Self { words: words().unwrap_or_default(), ..Self::default() }
    }

    /// Keeps a new key, before anything is written: no box has a key that nobody knows.
    ///
    /// # Errors
    /// When it cannot be kept.
    pub fn begin(&self, store: &Store) -> Result<(), BadInput> {
        match (&self.made, &self.replaced) {
            (Some(made), Some(_)) => store.replace(made),
            (Some(made), None) => store.add(made),
            (None, _) => Ok(()),
        }
    }

    /// As it was before, where nothing could be written.
    pub fn undo(&self, store: &Store, tell: &mut Tell<'_>) {
        let Some(made) = &self.made else { return };
        let undone = match &self.replaced {
            Some(replaced) => store.replace(replaced),
            None => store.forget(made.key.id()).map(|_| ()),
        };
        if let Err(error) = undone {
            let id = made.key.id();
            tell(Told::Warning(format!(
                "the new key {id} is kept although no box has it: {error}"
            )));
        }
    }

    /// Once everything is written: keeps the key of the card.
    ///
    /// # Errors
    /// When it cannot be kept.
    pub fn end(&self, store: &Store) -> Result<(), BadInput> {
        self.learnt.as_ref().map_or(Ok(()), |learnt| store.replace(learnt))
    }

    /// The box of a new key.
    #[must_use]
    pub fn made(&self) -> Option<&KnownBox> {
        self.made.as_ref()
    }
}

/// The number by which a box's key is kept.
fn serial_number(config: &Config) -> Option<&str> {
    Some(config.serial_number.as_str()).filter(|it| box_settings::is_serial_number(it))
}

/// What can be done for a box without a key.
fn unpaired(number: &str) -> String {
    format!(
        "--new-key makes a key; `plumb keys import` brings one from another computer{}",
        sudo(|user| format!(
            " (with sudo only the keys of root are known; {user} gives one to root: `plumb keys \
             export {number:?} --anyway | sudo plumb keys import - --serial {number:?}`)"
        ))
    )
}

/// Words about the user who runs this as root, if one does.
fn sudo(words: impl Fn(&str) -> String) -> String {
    let user = std::env::var("SUDO_USER").ok().filter(|it| it != "root");
    user.map(|user| words(&user)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use plumbline_render::simulate::{Simulation, SimulationSettings};

    use super::*;

    static SCENE: LazyLock<Config> =
        LazyLock::new(|| Simulation::new(&SimulationSettings::default()).unwrap().config());

    fn config(device: &str, number: &str) -> Config {
        let mut config = SCENE.clone();
        config.device = device.try_into().unwrap();
        config.serial_number = number.try_into().unwrap();
        config
    }

    fn store() -> (tempfile::TempDir, Store) {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::at(folder.path().join("keys")).unwrap();
        (folder, store)
    }

    fn key(seed: u8) -> Key {
        Key::new([seed; 32]).unwrap()
    }

    fn known(seed: u8, number: &str) -> KnownBox {
        KnownBox::new(key(seed), Some("ward".into()), Some(number.into()))
    }

    #[test]
    fn a_new_key_is_kept_first_and_forgotten_where_nothing_was_written() {
        let (_folder, store) = store();
        let config = config("ward 3", "PL-0001");
        let plan =
            Plan::new_key(&store, &config, "box.toml", Some(&Found::Nothing), false).unwrap();
        assert!(store.all().unwrap().known.is_empty(), "a plan changes nothing");
        plan.begin(&store).unwrap();
        let kept = store.by_serial_number("PL-0001").unwrap().unwrap();
        assert_eq!(
            (Some(&kept.key), kept.name.as_deref()),
            (plan.written.as_ref(), Some("ward 3"))
        );
        assert!(plan.words.contains(&kept.key.id().to_string()), "{}", plan.words);
        plan.undo(&store, &mut |told| panic!("{told:?}"));
        assert!(store.all().unwrap().known.is_empty());
        // Where it replaces another, that one comes back.
        store.add(&known(1, "PL-0001")).unwrap();
        let plan = Plan::new_key(&store, &config, "", None, true).unwrap();
        plan.begin(&store).unwrap();
        assert_ne!(store.find("PL-0001").unwrap().key, key(1));
        plan.undo(&store, &mut |told| panic!("{told:?}"));
        assert_eq!(store.all().unwrap().known, [store.find("PL-0001").unwrap()]);
        assert_eq!(store.find("PL-0001").unwrap().key, key(1));
    }

    #[test]
    fn a_key_is_made_for_a_box_that_has_a_number_and_no_key() {
        let (_folder, store) = store();
        let refused = |config: &Config, found: &Found| {
            Plan::new_key(&store, config, "box.toml", Some(found), false).unwrap_err().to_string()
        };
        let text = refused(&config("plumbline", "0"), &Found::Nothing);
        assert!(text.starts_with("box.toml: serial_number: "), "{text}");
        let config = config("ward 3", "PL-0001");
        let text = refused(&config, &Found::Key(key(2)));
        assert!(text.contains("the card has a key") && text.contains("--force"), "{text}");
        assert!(Plan::new_key(&store, &config, "", Some(&Found::Key(key(2))), true).is_ok());
        let unusable = Found::Unusable(KeyError::Checksum);
        assert!(Plan::new_key(&store, &config, "", Some(&unusable), false).is_ok());
        store.add(&known(1, "PL-0001")).unwrap();
        let text = refused(&config, &Found::Nothing);
        assert!(text.contains(&key(1).id().to_string()) && text.contains("--force"), "{text}");
    }

    #[test]
    fn a_card_gets_the_key_that_is_known_here_or_keeps_its_own() {
        let (_folder, store) = store();
        store.add(&known(1, "PL-0001")).unwrap();
        store.add(&known(2, "PL-0002")).unwrap();
        let [unusable, ours, theirs, strange] = [
            Found::Unusable(KeyError::Prefix),
            Found::Key(key(1)),
            Found::Key(key(2)),
            Found::Key(key(3)),
        ];
        let nothing = Found::Nothing;
        // The box, what its card has, by force; the key that is written, or words of the refusal.
        type Expected = Result<Option<u8>, &'static str>;
        let cases: [(&str, &Found, bool, Expected); 12] = [
            ("PL-0001", &nothing, false, Ok(Some(1))),
            ("PL-0001", &unusable, false, Ok(Some(1))),
            ("PL-0001", &ours, false, Ok(None)),
            ("PL-0001", &strange, false, Err("--replace")),
            ("PL-0001", &strange, true, Ok(Some(1))),
            ("PL-0001", &theirs, false, Err("--force")),
            ("PL-0009", &nothing, false, Ok(None)),
            ("PL-0009", &unusable, false, Ok(None)),
            ("PL-0009", &strange, false, Ok(None)),
            ("PL-0009", &theirs, false, Err("two boxes never have the same key")),
            ("PL-0009", &theirs, true, Ok(None)),
            ("0", &strange, false, Ok(None)),
        ];
        for (number, found, force, expected) in cases {
            let plan = Plan::for_card(&store, &config("ward", number), "card", found, force);
            match (plan, expected) {
                (Ok(plan), Ok(seed)) => {
                    assert_eq!(plan.written, seed.map(key), "{number} {found:?}");
                    assert_eq!(plan.made, None);
                    // A key that is not known under this number is, from then on.
                    let learnt = match found {
                        Found::Key(key) if number == "PL-0009" => Some(key),
                        _ => None,
                    };
                    assert_eq!(plan.learnt.as_ref().map(|it| &it.key), learnt);
                    let is_unpaired = number == "PL-0009" && learnt.is_none();
                    assert_eq!(plan.words.contains("--new-key"), is_unpaired, "{}", plan.words);
                    plan.begin(&store).unwrap();
                }
                (Err(error), Err(words)) => {
                    let text = error.to_string();
                    assert!(text.starts_with("card: box.key: ") && text.contains(words), "{text}");
                }
                (plan, _) => panic!("{number} {found:?}: {plan:?}"),
            }
        }
        let plan =
            Plan::for_card(&store, &config("ward 9", "PL-0009"), "", &strange, false).unwrap();
        plan.end(&store).unwrap();
        assert_eq!(store.find("ward 9").unwrap().key, key(3));
        // A box that gets another name is found by it.
        let plan = Plan::for_card(&store, &config("ward 1", "PL-0001"), "", &ours, false).unwrap();
        plan.end(&store).unwrap();
        assert_eq!(store.find("ward 1").unwrap().key, key(1));
    }

    #[test]
    fn a_key_has_its_place_beside_a_configuration() {
        assert_eq!(beside(Path::new("files/ward-3.plb")).unwrap(), Path::new("files/box.key"));
        for out in ["box.key", "/dev/null", "/dev"] {
            let text = beside(Path::new(out)).unwrap_err().to_string();
            assert!(text.contains("--out") && text.contains(out), "{text}");
        }
    }
}
