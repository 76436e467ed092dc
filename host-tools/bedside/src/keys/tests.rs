use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt as _;

use super::*;

fn key(seed: u8) -> Key {
    Key::new(std::array::from_fn(|at| seed ^ (at as u8 * 7 + 1))).unwrap()
}

fn known(seed: u8, name: &str, serial_number: &str) -> KnownBox {
    let text = |it: &str| Some(it.to_owned()).filter(|it| !it.is_empty());
    KnownBox::new(key(seed), text(name), text(serial_number))
}

struct Place {
    folder: tempfile::TempDir,
    store: Store,
}

fn empty() -> Place {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::at(folder.path().join("plumbline/keys")).unwrap();
    Place { folder, store }
}

fn filled() -> Place {
    let place = empty();
    for it in [
        known(1, "ward 3", "PL-0001"),
        known(2, "ward 4", "PL-0002"),
        known(3, "ward 4", "PL-0003"),
        known(4, "", ""),
    ] {
        place.store.add(&it).unwrap();
    }
    place
}

fn mode(path: &Path) -> u32 {
    std::fs::metadata(path).unwrap().permissions().mode() & 0o777
}

fn set_mode(path: &Path, mode: u32) {
    std::fs::set_permissions(path, Permissions::from_mode(mode)).unwrap();
}

fn file(place: &Place, seed: u8) -> PathBuf {
    place.store.path(key(seed).id())
}

#[test]
fn what_is_kept_comes_back_and_is_for_its_owner_alone() {
    let place = empty();
    assert!(place.store.all().unwrap().known.is_empty());
    assert!(!place.store.folder.exists(), "looking makes nothing");
    let mut new = known(1, "ward 3", "PL-0001");
    new.address = Some("[fe80::1]:4210".parse().unwrap());
    new.start_count = Some(u32::MAX);
    place.store.add(&new).unwrap();
    let boxes = place.store.all().unwrap();
    assert_eq!((&boxes.known[..], boxes.refused.len()), (&[new.clone()][..], 0));
    assert_eq!(place.store.by_id(key(1).id()).unwrap(), Some(new));
    assert_eq!(place.store.by_id(key(2).id()).unwrap(), None);
    assert_eq!(mode(&place.store.folder), 0o700);
    assert_eq!(mode(&file(&place, 1)), 0o600);
    assert_eq!(mode(&place.store.folder.join(LOCK)), 0o600);
}

#[test]
fn a_box_is_found_by_name_number_or_the_digits_of_its_key() {
    let Place { store, folder: _folder } = filled();
    let id = key(4).id().to_string();
    for (called, seed) in [
        ("ward 3", 1),
        ("PL-0002", 2),
        ("PL-0003", 3),
        (&id, 4),
        (&id[..4], 4),
        (&id[..6].to_uppercase(), 4),
    ] {
        assert_eq!(store.find(called).unwrap().key, key(seed), "{called}");
    }
    let several = store.find("ward 4").unwrap_err().to_string();
    for part in ["2 are called so", "PL-0002", "PL-0003", "serial number"] {
        assert!(several.contains(part), "{several}");
    }
    for none in ["ward 5", "", &id[..3]] {
        let none = store.find(none).unwrap_err().to_string();
        assert!(none.contains("not known here") && none.contains("\"ward 3\" (PL-0001)"), "{none}");
    }
    let none = empty().store.find("ward 3").unwrap_err().to_string();
    assert!(none.contains("--new-key") && none.contains("plumb keys import"), "{none}");
}

#[test]
fn a_key_on_the_command_line_is_refused_and_not_repeated() {
    let text = key(1).text();
    let error = filled().store.find(text.as_str()).unwrap_err().to_string();
    assert!(error.contains("command line") && !error.contains(&text.as_str()[16..30]), "{error}");
}

#[test]
fn a_serial_number_has_one_key_unless_it_is_replaced() {
    let Place { store, folder: _folder } = filled();
    let new = known(9, "ward 3", "PL-0001");
    let error = store.add(&new).unwrap_err().to_string();
    assert!(error.contains("PL-0001") && error.contains("--replace"), "{error}");
    assert_eq!(store.find("PL-0001").unwrap().key, key(1));
    store.replace(&new).unwrap();
    assert_eq!(store.find("PL-0001").unwrap(), new);
    assert_eq!(store.by_id(key(1).id()).unwrap(), None);
    assert_eq!(store.all().unwrap().known.len(), 4);
    // And a key one box.
    let error = store.add(&known(9, "ward 9", "PL-0009")).unwrap_err().to_string();
    assert!(error.contains("here already") && error.contains("PL-0001"), "{error}");
    // Boxes without a serial number are not the same box.
    store.add(&known(10, "", "")).unwrap();
    store.replace(&known(11, "", "")).unwrap();
    assert_eq!(store.all().unwrap().known.len(), 6);
}

#[test]
fn a_key_that_gets_another_name_keeps_what_was_noted_of_it() {
    let Place { store, folder: _folder } = filled();
    let id = key(1).id();
    assert!(store.take_start_count(id, 7).unwrap());
    store.replace(&known(1, "ward 5", "PL-0005")).unwrap();
    let it = store.find("ward 5").unwrap();
    assert_eq!((it.serial_number.as_deref(), it.start_count), (Some("PL-0005"), Some(7)));
    assert!(!store.take_start_count(id, 7).unwrap());
}

#[test]
fn what_is_forgotten_is_gone() {
    let place = filled();
    assert!(place.store.forget(key(1).id()).unwrap());
    assert!(!place.store.forget(key(1).id()).unwrap());
    assert!(!file(&place, 1).exists());
    assert_eq!(place.store.all().unwrap().known.len(), 3);
}

#[test]
fn what_others_can_read_is_refused_with_the_remedy() {
    let place = filled();
    for shared in [0o640, 0o604, 0o620] {
        set_mode(&file(&place, 1), shared);
        let boxes = place.store.all().unwrap();
        assert_eq!((boxes.known.len(), boxes.refused.len()), (3, 1));
        for error in [
            boxes.refused[0].to_string(),
            place.store.find("ward 3").unwrap_err().to_string(),
            place.store.by_id(key(1).id()).unwrap_err().to_string(),
            place.store.by_serial_number("PL-0001").unwrap_err().to_string(),
        ] {
            assert!(error.contains(&format!("mode {shared:o}")), "{error}");
            assert!(error.contains(&format!("chmod 600 {}", file(&place, 1).display())), "{error}");
        }
        // The others can be used.
        assert_eq!(place.store.find("PL-0002").unwrap().key, key(2));
    }
    set_mode(&file(&place, 1), 0o600);
    assert_eq!(place.store.find("ward 3").unwrap().key, key(1));
    set_mode(&place.store.folder, 0o750);
    let error = Store::at(place.store.folder.clone()).unwrap_err().to_string();
    assert!(error.contains("chmod 700") && error.contains("mode 750"), "{error}");
}

#[test]
fn a_damaged_file_is_refused_by_its_field_and_its_key_is_not_shown() {
    let place = filled();
    let path = file(&place, 1);
    let good = std::fs::read_to_string(&path).unwrap();
    let secret = key(1).text();
    let digits = &secret.as_str()[20..40];
    assert!(good.contains(digits));
    for (from, to, parts) in [
        ("KEY-1:", "KEY-1:0", &["key: ", "90 characters"][..]),
        ("KEY-1", "KEY-2", &["key: ", "another version"]),
        ("made = \"", "made = \"on a ", &["made: ", "no time"]),
        ("name = \"ward 3\"", "colour = \"red\"", &["colour", "unknown field"]),
        ("key = \"", "key = ", &["key"]),
        ("key = ", "kei = ", &["kei"]),
    ] {
        assert!(good.contains(from), "{from}");
        std::fs::write(&path, good.replace(from, to)).unwrap();
        let error = place.store.by_id(key(1).id()).unwrap_err().to_string();
        assert!(!error.contains(digits), "{error}");
        for part in parts.iter().chain(&[&*path.display().to_string()]) {
            assert!(error.contains(part), "{error}: {part}");
        }
    }
    // A file that was copied over another.
    std::fs::copy(file(&place, 2), &path).unwrap();
    let error = place.store.by_id(key(1).id()).unwrap_err().to_string();
    assert!(error.contains(&key(2).id().to_string()), "{error}");
}

#[test]
fn only_a_start_above_all_others_is_taken() {
    let place = filled();
    let (store, id) = (&place.store, key(1).id());
    for (count, is_taken) in [(7, true), (7, false), (6, false), (0, false), (8, true)] {
        assert_eq!(store.take_start_count(id, count).unwrap(), is_taken, "{count}");
    }
    assert_eq!(store.by_id(id).unwrap().unwrap().start_count, Some(8));
    assert!(store.take_start_count(key(2).id(), 0).unwrap(), "the first of a key");
    assert!(!store.take_start_count(key(99).id(), 1).unwrap(), "a key that is not known");
}

#[test]
fn an_address_is_noted_of_a_known_box_only_and_written_once() {
    let place = filled();
    let (store, address) = (&place.store, "192.168.1.30:4210".parse().unwrap());
    store.note_address(key(1).id(), address).unwrap();
    assert_eq!(store.find("ward 3").unwrap().address, Some(address));
    let written = std::fs::metadata(file(&place, 1)).unwrap().modified().unwrap();
    store.note_address(key(1).id(), address).unwrap();
    assert_eq!(std::fs::metadata(file(&place, 1)).unwrap().modified().unwrap(), written);
    store.note_address(key(99).id(), address).unwrap();
    assert!(!file(&place, 99).exists());
}

#[test]
fn nothing_is_lost_where_several_write_at_once() {
    let place = filled();
    let id = key(1).id();
    let at = || Store::at(place.store.folder.clone()).unwrap();
    const EACH: u32 = 25;
    let taken: usize = std::thread::scope(|scope| {
        let takers: Vec<_> = (0..4)
            .map(|_| {
                scope.spawn(|| {
                    (0..EACH).filter(|&it| at().take_start_count(id, it).unwrap()).count()
                })
            })
            .collect();
        scope.spawn(|| {
            for port in 1..=EACH as u16 {
                at().note_address(id, ([10, 0, 0, 1], port).into()).unwrap();
            }
        });
        scope.spawn(|| {
            for seed in 50..75 {
                at().add(&known(seed, "", &format!("PL-1{seed}"))).unwrap();
                assert!(at().all().unwrap().refused.is_empty());
            }
        });
        takers.into_iter().map(|it| it.join().unwrap()).sum()
    });
    // Each number once at most, whoever is the first.
    assert!((1..=EACH as usize).contains(&taken), "{taken}");
    let it = at().by_id(id).unwrap().unwrap();
    assert_eq!((it.start_count, it.address.unwrap().port()), (Some(EACH - 1), EACH as u16));
    assert_eq!(at().all().unwrap().known.len(), 4 + 25);
    let left: Vec<_> = std::fs::read_dir(&place.store.folder).unwrap().collect();
    assert_eq!(left.len(), 4 + 25 + 1, "no temporary file is left");
    drop(place.folder);
}

#[test]
fn two_drawn_keys_differ() {
    assert_ne!(draw().unwrap(), draw().unwrap());
}
