//! `plumb update` and boxes of another release than this program. The box's own side, and the whole
//! way with a booted box, are tested elsewhere.

use std::fs;
use std::net::SocketAddr;
use std::path::Path;
use std::time::{Duration, Instant};

use plumbline::packet::UpdateRefusal;
use plumbline_stream::fixture::{Cable, Fate, UpdatedBox};
use plumbline_test_support::{free_address, serial_lines};
use plumbline_update::header::{HEADER_BYTES, Header, KeyId, Text, slot_hash};
use plumbline_update::sign::{SigningKey, signed};

use crate::common::finished::{Finished, plumb};
use crate::common::keys;
use crate::live_box::{Bench, PAIR, board, recording};
use crate::pair_live::TheBox;

/// The slot of an update: 100 sectors, 230 parts.
fn slot() -> Vec<u8> {
    (0..100 * 512).map(|at| (at / 7 % 251) as u8).collect()
}

/// An update's file.
fn file() -> Vec<u8> {
    let (slot, key) = (slot(), SigningKey::from_bytes(&[1; 32]));
    let header = Header {
        board: Text::new("rpi4").unwrap(),
        version: "0.2.0".parse().unwrap(),
        oldest_allowed: "0.1.0".parse().unwrap(),
        commit: Text::new("0123456789ab").unwrap(),
        slot_bytes: slot.len() as u32,
        slot_hash: slot_hash(&slot),
        key: KeyId::of(&key.verifying_key()),
    };
    [&signed(&header, &key)[..], &slot].concat()
}

/// What `plumb update` makes of a box.
fn updated(
    directory: &Path,
    make: impl FnOnce(SocketAddr) -> UpdatedBox,
) -> (Finished, UpdatedBox) {
    keys::known(directory);
    fs::write(directory.join("new.plu"), file()).unwrap();
    let udp = free_address();
    let arguments = format!("update new.plu --udp {udp}");
    let directory = directory.to_owned();
    let program =
        std::thread::spawn(move || plumb(&directory, &arguments.split(' ').collect::<Vec<_>>()));
    let mut updated_box = make(udp);
    let give_up = Instant::now() + Duration::from_secs(120);
    while !program.is_finished() {
        assert!(Instant::now() < give_up, "it does not end");
        updated_box.live(Duration::from_millis(20));
    }
    (program.join().unwrap(), updated_box)
}

#[track_caller]
fn says(finished: &Finished, code: i32, parts: &[&str]) {
    assert_eq!(finished.code, Some(code), "{}", finished.stderr);
    for part in parts {
        assert!(finished.stderr.contains(part), "no {part:?} in {}", finished.stderr);
    }
}

#[test]
fn a_box_of_another_release_is_updated_over_a_network_that_loses_packets() {
    let folder = tempfile::tempdir().unwrap();
    let make = |udp| UpdatedBox::new(udp, file().len(), Fate::Stays).losing(0.05);
    let (finished, updated_box) = updated(folder.path(), make);
    says(&finished, 0, &["the box runs 0.1.0+other", "runs it from now on (0.2.0+other)"]);
    assert!(updated_box.received == file());
    assert_eq!(updated_box.starts(), 2);
}

#[test]
fn while_a_trial_is_recorded_the_update_waits() {
    let folder = tempfile::tempdir().unwrap();
    let make = |udp| UpdatedBox::new(udp, file().len(), Fate::Stays).recorded(3);
    let (finished, updated_box) = updated(folder.path(), make);
    says(&finished, 0, &["runs it from now on"]);
    assert!(updated_box.received == file());
}

#[test]
fn what_a_box_refuses_or_gives_up_is_said_with_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    for (fate, starts, parts) in [
        (
            Fate::IsRefused(UpdateRefusal::NotSupported, "use apt"),
            1,
            ["refuses the update: use apt", "the box is as it was"],
        ),
        (
            Fate::IsUnusable("it is for the board virt"),
            1,
            ["does not take it: it is for the board virt", "the box is as it was"],
        ),
        (
            Fate::IsGivenUp("the camera has given 0 of 30 frames"),
            2,
            ["gone back to what it had: the camera has given 0", "the box measures as before"],
        ),
    ] {
        let make = |udp| UpdatedBox::new(udp, file().len(), fate);
        let (finished, updated_box) = updated(folder.path(), make);
        says(&finished, 2, &parts);
        assert_eq!(updated_box.starts(), starts);
    }
}

/// The box's real program, over a cable.
#[test]
fn a_box_that_is_a_program_among_others_refuses_an_update_and_says_what_to_do() {
    if !serial_lines() {
        return;
    }
    let Some(board) = board() else { return };
    let bench = Bench::new(PAIR);
    bench.provision("--box box.toml --out box.plb").exits(0);
    fs::write(bench.path("new.plu"), file()).unwrap();
    fs::write(bench.path("trial.y4m"), recording(0.0)).unwrap();
    let cable = Cable::new();
    let _the_box = TheBox::start(&board, bench.folder.path(), &cable);
    let arguments = ["update", "new.plu", "--serial", &cable.at_host];
    let refused = plumb(bench.folder.path(), &arguments);
    let version = concat!("the box runs ", env!("CARGO_PKG_VERSION"), "+");
    says(&refused, 2, &[version, "updated as these are, with apt", "the box is as it was"]);
}

#[test]
fn a_file_that_is_no_update_is_refused_before_a_box_is_looked_for() {
    let folder = tempfile::tempdir().unwrap();
    let whole = file();
    let with = |at: usize| {
        let mut bytes = whole.clone();
        bytes[at] ^= 1;
        bytes
    };
    for (bytes, part) in [
        (Vec::new(), "too short for an update"),
        (whole[..HEADER_BYTES - 1].to_vec(), "too short for an update"),
        (with(0), "new.plu"),
        (whole[..whole.len() - 512].to_vec(), "bytes and says that it has"),
        ([&whole[..], &[0]].concat(), "bytes and says that it has"),
        (with(whole.len() - 1), "damaged: its SHA-256 is not the one that it names"),
    ] {
        fs::write(folder.path().join("new.plu"), &bytes).unwrap();
        let finished = plumb(folder.path(), &["update", "new.plu"]);
        says(&finished, 2, &[part]);
    }
    says(&plumb(folder.path(), &["update", "absent.plu"]), 2, &["absent.plu"]);
}
