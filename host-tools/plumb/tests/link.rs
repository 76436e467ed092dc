//! What a user reads of the sealed link: boxes of which the key is not here, boxes that others
//! record, and packets that are lost or are nobody's.

use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::process::{Child, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plumbline::packet::{
    Action, Command, Message, PROTOCOL_VERSION, Refusal, ReplyOutcome, SCHEMA_HASH,
};
use plumbline::seal::Key;
use plumbline_stream::fixture::{self, OtherRelease, SealedBox};
use plumbline_test_support::{command, free_address};
use plumbline_trial::Trial;

use crate::common::finished::{Finished, interrupt, plumb};
use crate::common::keys;

/// `plumb` in this directory, in a thread; UDP is in its arguments the address.
fn running(directory: &Path, udp: SocketAddr, arguments: &str) -> JoinHandle<Finished> {
    let (directory, udp) = (directory.to_owned(), udp.to_string());
    let arguments: Vec<String> =
        arguments.split_whitespace().map(|it| it.replace("UDP", &udp)).collect();
    std::thread::spawn(move || {
        plumb(&directory, &arguments.iter().map(String::as_str).collect::<Vec<_>>())
    })
}

/// The same, as a process.
fn started(directory: &Path, udp: SocketAddr, arguments: &str) -> Child {
    let mut command = command(env!("CARGO_BIN_EXE_plumb"));
    command.args(arguments.replace("UDP", &udp.to_string()).split_whitespace());
    command.current_dir(directory).env("XDG_DATA_HOME", keys::data(directory));
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

#[track_caller]
fn says(finished: &Finished, code: i32, parts: &[&str]) {
    let said = format!("{}{}", finished.stdout, finished.stderr);
    assert_eq!(finished.code, Some(code), "{said}");
    assert!(parts.iter().all(|part| said.contains(part)), "not all of {parts:?} in {said}");
}

/// What `plumb show` says of a box that plays until it ends.
fn shown(directory: &Path, udp: SocketAddr, sealed: &mut SealedBox) -> Finished {
    let show = running(directory, udp, "show --udp UDP");
    while !show.is_finished() {
        sealed.live(Duration::from_millis(20));
    }
    show.join().unwrap()
}

#[test]
fn without_a_key_it_is_said_how_to_get_one() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in ["show --udp UDP", "doctor --udp UDP", "receive --udp UDP"] {
        let finished = running(folder.path(), free_address(), arguments).join().unwrap();
        says(&finished, 2, &["no key of a box is known here", "plumb provision --new-key"]);
        says(&finished, 2, &["plumb keys import"]);
    }
}

#[test]
fn a_box_whose_key_is_not_here_and_one_without_a_key_are_named() {
    let folder = tempfile::tempdir().unwrap();
    keys::known(folder.path());
    let other = Key::new([9; 32]).unwrap();
    let udp = free_address();
    let mut sealed = SealedBox::with_key(udp, 1, other.clone());
    let why = format!("a box is heard whose key, {}, this computer does not have", other.id());
    says(&shown(folder.path(), udp, &mut sealed), 2, &[&why, "plumb keys import"]);
    let mut sealed = SealedBox::unpaired(udp, 1);
    let said = shown(folder.path(), udp, &mut sealed);
    says(&said, 2, &["a box is heard that has no key", "plumb pair"]);
}

/// A box of a release with these versions and messages is named, and what to do is said.
fn assert_named((versions, schema_hash): ([u8; 2], u32), what: &str, remedy: &str) {
    let folder = tempfile::tempdir().unwrap();
    keys::known(folder.path());
    for (arguments, code, words) in [
        ("receive --udp UDP --out trial", 1, "FAIL  link"),
        ("doctor --udp UDP", 1, "FAIL  link"),
        ("show --udp UDP", 2, "error: UDP 127.0.0.1"),
    ] {
        let udp = free_address();
        let run = running(folder.path(), udp, arguments);
        let box_of_it = OtherRelease::new(udp, versions, schema_hash);
        while !run.is_finished() {
            box_of_it.live(Duration::from_millis(100));
        }
        says(&run.join().unwrap(), code, &[what, remedy, words]);
        assert!(!folder.path().join("trial").exists());
    }
    // While it waits for a box that may come.
    let udp = free_address();
    let child = started(folder.path(), udp, "receive --udp UDP");
    let box_of_it = OtherRelease::new(udp, versions, schema_hash);
    // It announces itself each time, as a box does: the program needs a moment to listen.
    (0..30).for_each(|_| box_of_it.live(Duration::from_millis(100)));
    interrupt(&child);
    let said = String::from_utf8(child.wait_with_output().unwrap().stderr).unwrap();
    assert!(said.contains(what) && said.contains(remedy), "{said}");
}

#[test]
fn a_box_of_another_release_is_named_and_what_to_update() {
    let newer = ([PROTOCOL_VERSION + 1; 2], SCHEMA_HASH);
    let older = ([1, PROTOCOL_VERSION - 1], SCHEMA_HASH);
    let other = ([PROTOCOL_VERSION; 2], 0x0BAD_CAFE);
    let update_here = "this program is the older one: update Plumbline on this computer";
    let update_box = "the box is the older one: give it the release that is on this computer";
    let update = "give both the same release";
    // Most of it is waiting.
    std::thread::scope(|scope| {
        for (release, what, remedy) in [
            (
                newer,
                "\"ward 3\" (PL-0001) speaks version 5 of the link, this program 4",
                update_here,
            ),
            (older, "speaks versions 1 to 3 of the link, this program 4", update_box),
            (other, "is of another release: its messages are 0badcafe", update),
        ] {
            scope.spawn(move || assert_named(release, what, remedy));
        }
    });
}

/// Its end, by itself, by Ctrl-C and by an error, frees the place at once.
#[test]
fn a_program_that_ends_leaves_the_box() {
    let folder = tempfile::tempdir().unwrap();
    keys::known(folder.path());
    for (arguments, stops, code) in [
        ("receive --udp UDP --frames 20", None, 0),
        ("receive --udp UDP --anyway --out trial", Some("trial"), 0),
        // While the box is still checked.
        ("receive --udp UDP --check-seconds 60 --out checked", Some("."), 1),
        // It never says who it is.
        ("show --udp UDP", None, 2),
    ] {
        let udp = free_address();
        let mut child = started(folder.path(), udp, arguments);
        let mut sealed = SealedBox::new(udp, fixture::START);
        sealed.meet();
        if code < 2 {
            sealed.send(&Message::Hello(fixture::hello(&fixture::config())));
        }
        let mut sequence = 0;
        let mut asked_to_stop = false;
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            assert!(sequence < 10_000, "{arguments} never ends");
            sealed.send(&Message::Pose(fixture::pose_packet(sequence)));
            sealed.live(Duration::from_millis(5));
            sequence += 1;
            let is_there = |place: &str| folder.path().join(place).exists();
            if sequence > 100 && stops.is_some_and(is_there) && !asked_to_stop {
                asked_to_stop = true;
                interrupt(&child);
            }
        };
        sealed.live(Duration::from_millis(50));
        assert_eq!(status.code(), Some(code), "{arguments}");
        assert!(!sealed.is_heard(), "{arguments} has said nothing at its end");
    }
    assert!(!folder.path().join("checked").exists(), "nothing was recorded");
}

/// Records this many frames of a box, of which it sends each as `send` says.
fn recorded(
    directory: &Path,
    more: &str,
    mut send: impl FnMut(&mut SealedBox, u32, &Message, SocketAddr),
) -> (Finished, Vec<bool>, bool) {
    const FRAMES: u32 = 200;
    let udp = free_address();
    let receive =
        running(directory, udp, &format!("receive --udp UDP --anyway --out trial {more}"));
    let config = fixture::config();
    let mut sealed = SealedBox::new(udp, fixture::START);
    sealed.meet();
    sealed.send(&Message::Hello(fixture::hello(&config)));
    for sequence in 0..FRAMES {
        send(&mut sealed, sequence, &Message::Pose(fixture::pose_packet(sequence)), udp);
        sealed.live(Duration::from_millis(5));
    }
    let mut told = Vec::new();
    let give_up = Instant::now() + Duration::from_secs(30);
    while !receive.is_finished() && Instant::now() < give_up {
        for (_, message) in sealed.wait() {
            if let Message::Command(Command { action: Action::Record { on }, .. }) = message {
                told.push(on);
            }
        }
    }
    (receive.join().unwrap(), told, sealed.is_heard())
}

#[test]
fn what_is_lost_on_the_way_is_asked_for_and_what_is_no_packet_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    keys::known(folder.path());
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    let (finished, told, is_heard) =
        recorded(folder.path(), "--frames 200", |sealed, sequence, pose, udp| {
            // Every fifth, the last one but one being the last that is lost.
            if sequence % 5 == 3 && sequence < 199 {
                sealed.lose(pose);
            } else {
                sealed.send(pose);
            }
            if sequence % 20 == 0 {
                sealed.send_in_clear(pose, fixture::START);
                stranger.send_to(&[0xAA; 60], udp).unwrap();
            }
        });
    says(&finished, 0, &["recorded in trial: 200 frames"]);
    let trial = Trial::open(&folder.path().join("trial")).unwrap();
    assert_eq!(trial.frames.len(), 200);
    assert!(trial.frames.windows(2).all(|pair| pair[0].time_s < pair[1].time_s));
    assert_eq!(told.first(), Some(&true), "{told:?}");
    assert_eq!(told.last(), Some(&false), "{told:?}");
    // What was missing has come before the goodbye.
    assert!(!is_heard);
}

/// A box that somebody records refuses set-up mode, unless it is forced.
#[test]
fn a_box_that_records_is_aimed_by_force_alone() {
    let folder = tempfile::tempdir().unwrap();
    keys::known(folder.path());
    const WHO: &str = "receive on desk records a trial, which it would disturb";
    for (more, is_forced) in [("", false), ("--force", true)] {
        let udp = free_address();
        let aim = running(folder.path(), udp, &format!("aim --udp UDP --once {more}"));
        let config = fixture::config();
        let mut blob = vec![0; plumbline::config::BLOB_BYTES_MAX];
        let blob = config.encode(&mut blob).unwrap().to_vec();
        let mut sealed = SealedBox::new(udp, fixture::START);
        let mut was_forced = None;
        while !aim.is_finished() && was_forced.is_none() {
            for (listener, message) in sealed.wait() {
                let Message::Command(Command { id, action, is_forced }) = message else { continue };
                let refused = |refusal, reason: &str| ReplyOutcome::Refused {
                    refusal,
                    reason: reason.try_into().unwrap(),
                };
                let outcome = match action {
                    Action::SendHello => {
                        sealed.send(&Message::Hello(fixture::hello(&config)));
                        ReplyOutcome::Accepted
                    }
                    Action::QueryConfig => ReplyOutcome::Config {
                        crc: config.crc(),
                        bytes: blob.len() as u32,
                        next_crc: config.crc(),
                    },
                    Action::SendParts { document, .. } => {
                        for (index, bytes) in
                            blob.chunks(plumbline::packet::PART_BYTES_MAX).enumerate()
                        {
                            let offset = (index * plumbline::packet::PART_BYTES_MAX) as u32;
                            let bytes = bytes.try_into().unwrap();
                            let part = plumbline::packet::Part { document, offset, bytes };
                            sealed.send_to(listener, &Message::Part(part));
                        }
                        ReplyOutcome::Accepted
                    }
                    Action::Aim { .. } => {
                        was_forced = Some(is_forced);
                        // It need not aim: what was asked is known.
                        refused(if is_forced { Refusal::Busy } else { Refusal::Recording }, WHO)
                    }
                    _ => refused(Refusal::NotSupported, ""),
                };
                sealed.answer(listener, id, outcome);
            }
            sealed.send(&Message::Health(fixture::health()));
        }
        sealed.live(Duration::from_secs(1));
        let finished = aim.join().unwrap();
        assert_eq!(was_forced, Some(is_forced), "{}", finished.stderr);
        let remedy = if is_forced { "try again" } else { "--force does it all the same" };
        says(&finished, 2, &["the box refuses set-up mode", WHO, remedy]);
    }
}

/// A program that listens until this is dropped.
struct Listening(std::process::Child);

impl Drop for Listening {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_second_program_on_a_port_is_told_which_one_it_is_and_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    keys::known(folder.path());
    for (name, text) in [("camera.toml", CAMERA), ("targets.toml", TARGETS)] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let [udp, marks] = [free_address(), free_address()];
    let mut first = plumbline_test_support::command(env!("CARGO_BIN_EXE_plumb"));
    first.args(["receive", "--anyway", "--out", "first", "--udp", &udp.to_string()]);
    first.args(["--mark-udp", &marks.to_string()]).current_dir(folder.path());
    first.env("XDG_DATA_HOME", keys::data(folder.path())).stdin(std::process::Stdio::null());
    first.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null());
    let _first = Listening(first.spawn().unwrap());
    let give_up = Instant::now() + Duration::from_secs(30);
    while [udp, marks].iter().any(|port| UdpSocket::bind(port).is_ok()) {
        assert!(Instant::now() < give_up, "it never listened");
        std::thread::sleep(Duration::from_millis(10));
    }
    let which = format!("UDP {udp}: another program listens there, perhaps another plumb receive");
    for arguments in [
        "receive --udp UDP",
        "receive --udp UDP --anyway --out second",
        "show --udp UDP",
        "doctor --udp UDP",
        "aim --udp UDP --once",
        "scene --udp UDP --out scene.toml",
        "provision --camera camera.toml --targets targets.toml --send --via-udp UDP",
    ] {
        let finished = running(folder.path(), udp, arguments).join().unwrap();
        let remedy = "stop that program, or choose another port here and on the box";
        says(&finished, 2, &[&which, remedy]);
    }
    let second = format!("receive --udp UDP --anyway --out second --mark-udp {marks}");
    let finished = running(folder.path(), free_address(), &second).join().unwrap();
    let which = format!("--mark-udp {marks}: another program listens there");
    says(
        &finished,
        2,
        &[&which, "stop that program, or choose another port, here and where marks"],
    );
    assert!(!folder.path().join("second").exists());
}

const CAMERA: &str = "width_px = 320\nheight_px = 240\nfx_px = 400.0\nfy_px = 400.0\ncx_px = 159.5\n\
                      cy_px = 119.5\nmodel = \"radial2\"\ndistortion = [0.0, 0.0]\n";

const TARGETS: &str = "[[target]]\nname = \"lumbar\"\nrole = \"lower\"\ncolumns = 6\nrows = 5\n\
                       pitch_mm = 12.0\n";
