//! `plumb manual`: the pages for man and the completions, as the Debian package has them.

use std::fs;
use std::process::Command;

use plumbline_test_support::command;

use crate::common::finished;

#[test]
fn every_subcommand_has_a_page_and_is_completed() {
    let folder = tempfile::tempdir().unwrap();
    let manual = || {
        let mut command = command(env!("CARGO_BIN_EXE_plumb"));
        command.args(["manual", "--out"]).arg(folder.path().join("manual"));
        finished::ended(command)
    };
    let finished = manual();
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    let text = |name: &str| fs::read_to_string(folder.path().join("manual").join(name)).unwrap();
    let own = text("man1/plumb.1");
    let receive = text("man1/plumb-receive.1");
    assert!(own.contains("one camera and two printed targets"), "{own}");
    assert!(receive.contains("\\-\\-duration") && receive.contains("packets.bin"), "{receive}");
    assert!(text("man1/plumb-keys-import.1").contains("standard input"));
    for name in ["plumb.bash", "_plumb", "plumb.fish", "_plumb.ps1"] {
        let completions = text(&format!("completions/{name}"));
        for word in ["calibrate", "receive", "mark-udp"] {
            assert!(completions.contains(word), "{name}: {word}");
        }
    }
    // Whatever shell there is must understand its file.
    let bash = Command::new("bash")
        .args(["-n"])
        .arg(folder.path().join("manual/completions/plumb.bash"))
        .status();
    assert!(bash.is_err() || bash.unwrap().success());

    let again = manual();
    assert_eq!(again.code, Some(2), "{}", again.stderr);
    assert!(again.stderr.contains("--force"), "{}", again.stderr);
}
