//! `plumb pair` and the box's real program, at the two ends of a serial cable.

use std::fs::File;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

use plumbline::seal::{KEY_FILE_NAME, Key};
use plumbline_stream::fixture::Cable;
use plumbline_test_support::{command, serial_lines};

use crate::common::finished::{Finished, plumb};
use crate::common::keys;
use crate::live_box::{Bench, PAIR, board, recording};

/// The box's program, at one end of a cable.
pub struct TheBox(Child);

impl TheBox {
    pub fn start(board: &Path, folder: &Path, cable: &Cable) -> Self {
        let said = File::options().create(true).append(true).open(folder.join("box.txt")).unwrap();
        let mut command = command(board);
        command.args(["--config", "box.plb", "--replay", "trial.y4m"]);
        command.args(["--serial", &cable.at_box]);
        command.current_dir(folder).stdin(Stdio::null());
        command.stdout(said.try_clone().unwrap()).stderr(said);
        Self(command.spawn().unwrap())
    }
}

impl Drop for TheBox {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[track_caller]
fn says(finished: &Finished, code: i32, parts: &[&str]) {
    let said = format!("{}{}", finished.stdout, finished.stderr);
    assert_eq!(finished.code, Some(code), "{said}");
    assert!(parts.iter().all(|part| said.contains(part)), "not all of {parts:?} in {said}");
}

fn mode(path: &Path) -> u32 {
    std::fs::metadata(path).unwrap().permissions().mode() & 0o777
}

/// The file of the only key in the store of this user.
fn only_key(user: &Path) -> PathBuf {
    let folder = keys::data(user).join("plumbline/keys");
    let entries = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files = entries.filter(|path| path.extension().is_some_and(|it| it == "toml"));
    let only = files.next().unwrap();
    assert_eq!(files.next(), None);
    only
}

#[test]
fn a_box_gets_its_key_over_the_cable_is_heard_with_it_and_takes_no_other() {
    if !serial_lines() {
        return;
    }
    let Some(board) = board() else { return };
    let bench = Bench::new(PAIR);
    let folder = bench.folder.path();
    std::fs::remove_dir_all(keys::data(folder)).unwrap();
    std::fs::remove_file(bench.path(KEY_FILE_NAME)).unwrap();
    bench.provision("--box box.toml --out box.plb").exits(0);
    std::fs::write(bench.path("trial.y4m"), recording(0.0)).unwrap();

    let cable = Cable::new();
    let the_box = TheBox::start(&board, folder, &cable);
    let at_cable = |user: &Path, arguments: &[&str]| {
        plumb(user, &[arguments, &["--serial", &cable.at_host]].concat())
    };
    let paired = at_cable(folder, &["pair"]);
    says(&paired, 0, &["the box has stored it", "paired: the box \"ward 3\" (PL-0001)"]);
    let key = Key::from_text(&std::fs::read_to_string(bench.path(KEY_FILE_NAME)).unwrap()).unwrap();
    says(&paired, 0, &[&key.id().to_string()]);
    // Both have it, and nobody else can read it.
    let own = only_key(folder);
    assert!(std::fs::read_to_string(&own).unwrap().contains(key.text().as_str()));
    for path in [&own, &bench.path(KEY_FILE_NAME)] {
        assert_eq!(mode(path), 0o600, "{}", path.display());
    }
    assert_eq!(mode(own.parent().unwrap()), 0o700);

    // The box is heard with it at once, and after its next start.
    let shown = at_cable(folder, &["show"]);
    says(&shown, 0, &[concat!("ward 3 (PL-0001), program ", env!("CARGO_PKG_VERSION"), "+")]);
    drop(the_box);
    let _the_box = TheBox::start(&board, folder, &cable);
    let again = at_cable(folder, &["show"]);
    says(&again, 0, &[concat!("ward 3 (PL-0001), program ", env!("CARGO_PKG_VERSION"), "+")]);

    // Somebody else with the cable, when the box was not just switched on by hand: its program was
    // started again.
    let other = tempfile::tempdir().unwrap();
    let number = ["--serial-number", "PL-0001"];
    let kept = at_cable(other.path(), &[&["pair"], &number[..]].concat());
    says(&kept, 2, &["the box has a key already", &key.id().to_string(), "--replace"]);
    let replaced = at_cable(other.path(), &[&["pair"], &number[..], &["--replace"]].concat());
    says(&replaced, 2, &["the box takes no key now", "off and on", "within a minute"]);
    let on_box = std::fs::read_to_string(bench.path(KEY_FILE_NAME)).unwrap();
    assert_eq!(Key::from_text(&on_box), Ok(key.clone()));

    let box_said = std::fs::read_to_string(bench.path("box.txt")).unwrap();
    assert!(box_said.contains("has come over the serial line"), "{box_said}");
    let text = key.text();
    let digits = &text.as_str()[16..80];
    for finished in [&paired, &shown, &again, &kept, &replaced] {
        for said in [&finished.stdout, &finished.stderr, &box_said] {
            let said = said.to_ascii_uppercase();
            let is_said = digits
                .as_bytes()
                .windows(12)
                .any(|part| said.as_bytes().windows(part.len()).any(|it| it == part));
            assert!(!is_said, "{said}");
        }
    }
}
