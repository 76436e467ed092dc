//! `plumb keys`, and the keys that `plumb provision` makes, with the folder of one user.

use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use plumbline::seal::Key;
use tempfile::TempDir;

use crate::common::finished::{Finished, ended};

const CAMERA: &str = "width_px = 320\nheight_px = 240\nfx_px = 400.0\nfy_px = 400.0\ncx_px = 159.5\n\
                      cy_px = 119.5\nmodel = \"radial2\"\ndistortion = [0.0, 0.0]\n";

const TARGETS: &str = "[[target]]\nname = \"lumbar\"\nrole = \"lower\"\ncolumns = 6\nrows = 5\n\
                       pitch_mm = 12.0\n";

const SETTINGS: &str = "device = \"ward 3\"\nserial_number = \"PL-0001\"\n[capture]\n\
                        driver = \"v4l2\"\npixel_format = \"grey\"\nrate_hz = 60.0\n[links]\n\
                        udp = \"192.168.1.20:4210\"\n";

/// A user's own data, and a folder to work in.
struct User(TempDir);

impl User {
    fn new() -> Self {
        let user = Self(tempfile::tempdir().unwrap());
        for (name, text) in
            [("camera.toml", CAMERA), ("targets.toml", TARGETS), ("box.toml", SETTINGS)]
        {
            std::fs::write(user.path(name), text).unwrap();
        }
        user
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs `plumb` with this on standard input, which is no terminal.
    fn plumb_with(&self, input: &str, arguments: &[&str]) -> Finished {
        let mut command = plumbline_test_support::command(env!("CARGO_BIN_EXE_plumb"));
        command.args(arguments).current_dir(self.0.path()).env_remove("SUDO_USER");
        command.env("XDG_DATA_HOME", self.path("data"));
        let path = self.path("input");
        std::fs::File::create(&path).unwrap().write_all(input.as_bytes()).unwrap();
        command.stdin(Stdio::from(std::fs::File::open(path).unwrap()));
        ended(command)
    }

    fn plumb(&self, arguments: &[&str]) -> Finished {
        self.plumb_with("", arguments)
    }

    fn provision(&self, arguments: &[&str]) -> Finished {
        let files = ["--camera", "camera.toml", "--targets", "targets.toml", "--box", "box.toml"];
        self.plumb(&[&["provision"], &files[..], arguments].concat())
    }

    fn key(&self, name: &str) -> Key {
        Key::from_text(&std::fs::read_to_string(self.path(name)).unwrap()).unwrap()
    }
}

#[track_caller]
fn done(finished: Finished) -> Finished {
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    finished
}

#[track_caller]
fn refused(finished: &Finished, parts: &[&str]) {
    assert_eq!(finished.code, Some(2), "{}", finished.stderr);
    for part in parts {
        assert!(finished.stderr.contains(part), "{part}: {}", finished.stderr);
    }
}

fn mode(path: &Path) -> u32 {
    std::fs::metadata(path).unwrap().permissions().mode() & 0o777
}

#[test]
fn a_key_goes_from_one_computer_to_another_and_is_never_shown_on_the_way() {
    let [ours, theirs] = [User::new(), User::new()];
    let mut said = Vec::new();
    said.push(done(ours.provision(&["--new-key", "--out", "card/config.plb"])));
    assert_eq!(mode(&ours.path("card/box.key")), 0o600);
    let key = ours.key("card/box.key");

    // The list is for everyone's eyes.
    let list = done(ours.plumb(&["keys", "list"]));
    for part in ["ward 3", "PL-0001", &key.id().to_string()] {
        assert!(list.stdout.contains(part), "{}", list.stdout);
    }
    said.push(list);

    // By a pipe.
    let piped = ours.plumb(&["keys", "export", "ward 3"]);
    refused(&piped, &["standard output", "--out FILE", "--anyway"]);
    assert!(piped.stdout.is_empty());
    said.push(piped);
    let text = done(ours.plumb(&["keys", "export", "PL-0001", "--anyway"])).stdout;
    assert_eq!(text.lines().count(), 1, "the text alone");
    assert_eq!(Key::from_text(&text), Ok(key.clone()));
    said.push(done(theirs.plumb_with(&text, &["keys", "import", "-", "--serial", "PL-0001"])));
    said.push(done(theirs.plumb(&["keys", "list"])));
    let id = key.id().to_string();
    assert!(said.last().unwrap().stdout.contains(&id));

    // By a file.
    said.push(done(theirs.plumb(&["keys", "forget", &id[..4], "--yes"])));
    said.push(done(ours.plumb(&["keys", "export", "ward 3", "--out", "stick/ward-3.key"])));
    assert!(said.last().unwrap().stderr.contains("warning: whoever sees this key"));
    assert_eq!(mode(&ours.path("stick/ward-3.key")), 0o600);
    let file = ours.path("stick/ward-3.key").display().to_string();
    said.push(done(theirs.plumb(&["keys", "import", &file, "--name", "ward 3"])));
    said.push(theirs.plumb(&["keys", "export", "ward 3"]));
    let text = text.trim_end();
    for finished in &said {
        for digits in [&text[16..32], &text[32..48], &text[48..64], &text[64..80]] {
            let Finished { stdout, stderr, .. } = finished;
            assert!(!stdout.contains(digits) && !stderr.contains(digits), "{stdout}{stderr}");
        }
    }
}

#[test]
fn a_qr_code_is_written_where_the_ending_says_so() {
    let user = User::new();
    done(user.provision(&["--new-key", "--out", "card/config.plb"]));
    for name in ["key.png", "key.SVG"] {
        done(user.plumb(&["keys", "export", "ward 3", "--out", name]));
        assert_eq!(mode(&user.path(name)), 0o600);
        let again = user.plumb(&["keys", "export", "ward 3", "--out", name]);
        refused(&again, &[name, "exists already", "--force"]);
    }
    assert!(image::open(user.path("key.png")).is_ok());
    assert!(std::fs::read_to_string(user.path("key.SVG")).unwrap().starts_with("<svg"));
}

#[test]
fn what_is_no_key_is_refused_and_a_key_on_the_command_line_too() {
    let user = User::new();
    done(user.provision(&["--new-key", "--out", "card/config.plb"]));
    let text = std::fs::read_to_string(user.path("card/box.key")).unwrap();
    let text = text.trim_end();
    let swapped = text.replace("KEY-1", "KEY-2");
    for (input, words) in [
        ("", "does not begin with PLUMBLINE-KEY-1:"),
        (&text[..70], "it has 70 characters, where a key has 89"),
        (&swapped, "another version"),
        (&format!("{text}\n{text}"), "179 characters"),
    ] {
        let import = user.plumb_with(input, &["keys", "import", "-"]);
        refused(&import, &["standard input: ", words, "plumb keys export"]);
    }
    refused(&user.plumb(&["keys", "import", "card/config.plb"]), &["card/config.plb: "]);
    refused(&user.plumb(&["keys", "import", "none.key"]), &["none.key: ", "check the path"]);
    refused(&user.plumb(&["keys", "import"]), &["no terminal", "standard input"]);
    refused(&user.plumb(&["keys", "forget", "ward 3"]), &["\"ward 3\" (PL-0001)", "--yes"]);
    for action in ["import", "export", "forget"] {
        let finished = user.plumb(&["keys", action, text]);
        refused(&finished, &["the command line: a key", "plumb provision --new-key"]);
        assert!(!finished.stderr.contains(&text[16..40]), "{}", finished.stderr);
    }
    let help = done(user.plumb(&["keys", "--help"])).stdout;
    assert!(help.contains("No key is ever given on the command line"), "{help}");
}

#[test]
fn a_serial_number_gets_another_key_only_by_replace() {
    let user = User::new();
    done(user.provision(&["--new-key", "--out", "card/config.plb"]));
    let ours = user.key("card/box.key");
    let other = Key::new([0x5a; 32]).unwrap();
    std::fs::write(user.path("other.key"), other.text().as_str()).unwrap();
    let import = ["keys", "import", "other.key", "--serial", "PL-0001"];
    refused(&user.plumb(&import), &[&ours.id().to_string(), "PL-0001", "--replace"]);
    let imported = done(user.plumb(&[&import[..], &["--replace"]].concat()));
    assert!(imported.stderr.contains("chmod 600"), "{}", imported.stderr);
    let list = done(user.plumb(&["keys", "list"])).stdout;
    assert!(list.contains(&other.id().to_string()) && !list.contains(&ours.id().to_string()));
    // One key is not of two boxes.
    let import = ["keys", "import", "other.key", "--serial", "PL-0002"];
    refused(&user.plumb(&import), &["--serial", "PL-0001", "two boxes"]);
}

#[test]
fn a_box_gets_a_new_key_once_and_its_file_beside_the_configuration() {
    let user = User::new();
    // Not asked for: said, and nothing is made.
    let without = done(user.provision(&["--out", "card/config.plb"]));
    assert!(without.stderr.contains("no key of this box is known here"), "{}", without.stderr);
    assert!(!user.path("card/box.key").exists() && !user.path("data").exists());
    // The configuration is in the way: neither file is written, and no key is kept.
    let blocked = user.provision(&["--new-key", "--out", "card/config.plb"]);
    refused(&blocked, &["card/config.plb", "exists already"]);
    let list = done(user.plumb(&["keys", "list"]));
    assert!(list.stderr.contains("no key of a box is known here"), "{}", list.stderr);
    done(user.provision(&["--new-key", "--out", "new/config.plb"]));
    let first = user.key("new/box.key");
    let again = user.provision(&["--new-key", "--out", "newer/config.plb"]);
    refused(&again, &["--new-key: ", "has a key already", &first.id().to_string(), "--force"]);
    assert!(!user.path("newer").exists());
    // Elsewhere: it is said how the key comes there.
    let elsewhere = done(user.provision(&["--out", "newer/config.plb"]));
    assert!(elsewhere.stderr.contains("plumb keys export \"PL-0001\" --out newer/box.key"));
    done(user.plumb(&["keys", "export", "PL-0001", "--out", "newer/box.key"]));
    assert_eq!(user.key("newer/box.key"), first);
    let there = done(user.provision(&["--out", "newer/config.plb", "--force"]));
    assert!(!there.stderr.contains("key"), "{}", there.stderr);
    done(user.provision(&["--new-key", "--out", "new/config.plb", "--force"]));
    assert_ne!(user.key("new/box.key"), first);
    // A key belongs to a serial number, and is not sent.
    std::fs::write(user.path("box.toml"), SETTINGS.replace("PL-0001", "0")).unwrap();
    let unnamed = user.provision(&["--new-key", "--out", "unnamed/config.plb"]);
    refused(&unnamed, &["box.toml: serial_number: "]);
    refused(&user.provision(&["--new-key", "--send"]), &["--send"]);
    // What shows a configuration shows no key.
    let show = done(user.plumb(&["show", "new/config.plb"]));
    let digits = user.key("new/box.key").text().as_str()[16..40].to_owned();
    assert!(!show.stdout.contains(&digits) && !show.stderr.contains(&digits));
}
