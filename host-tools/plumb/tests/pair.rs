//! `plumb pair` and a box that is played at the other end of a serial line.

use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plumbline::packet::{
    Action, Command, Deframer, Message, Reply, ReplyOutcome, Start, frame_packet,
};
use plumbline::seal::{
    BoxEnd, BoxState, Heard, Key, Paired, Peer, SEALED_BYTES_MAX, SEALED_FRAME_BYTES_MAX,
};
use plumbline_test_support::serial_lines;
use serialport::{SerialPort, TTYPort};

use crate::common::finished::{Finished, plumb};
use crate::common::keys;

const NAMED: &str = "ward 3 (PL-0001) has no key; no config.plb";

/// What a played box does with a key.
#[derive(Clone, Copy, PartialEq)]
enum Does {
    Store,
    /// It has stored the key, but its first answers are lost.
    StoreUnheard,
    /// Its card takes nothing.
    Fail,
    /// It says that it has stored it, and has another.
    Lie,
}

/// A box at the other end of a line.
struct PlayedBox {
    line: TTYPort,
    end: BoxEnd,
    key: Option<Key>,
    does: Does,
    unheard: u32,
}

impl PlayedBox {
    /// Plays until it is stopped; gives the key that it then has.
    fn play(mut self, stop: Arc<AtomicBool>) -> JoinHandle<Option<Key>> {
        std::thread::spawn(move || {
            let mut deframer = Deframer::<SEALED_FRAME_BYTES_MAX>::new();
            let begun = Instant::now();
            let mut announced: Option<Instant> = None;
            while !stop.load(Ordering::Relaxed) {
                if announced.is_none_or(|then| then.elapsed() > Duration::from_millis(300)) {
                    announced = Some(Instant::now());
                    let packet = self.end.announcement(&mut [0; SEALED_BYTES_MAX]).to_vec();
                    self.send(&packet);
                }
                let mut bytes = [0; 256];
                let length = self.line.read(&mut bytes).unwrap_or(0);
                for byte in &bytes[..length] {
                    let packet = deframer.frame(*byte).and_then(Result::ok).map(<[u8]>::to_vec);
                    if let Some(packet) = packet {
                        self.take(&packet, begun.elapsed().as_nanos() as u64);
                    }
                }
            }
            self.key
        })
    }

    fn take(&mut self, packet: &[u8], now_ns: u64) {
        let mut buffer = [0; SEALED_BYTES_MAX];
        match self.end.receive(Peer::Serial, packet, now_ns, || [3; 32], &mut buffer) {
            Heard::Nothing | Heard::Left | Heard::Update { .. } => {}
            Heard::Answer(answer) => {
                let answer = answer.to_vec();
                self.send(&answer);
            }
            Heard::Pairing(key) => self.pair(key),
            Heard::Message { listener, message, .. } => {
                if let Message::Command(Command {
                    id, action: Action::Ping { host_sent_ns }, ..
                }) = message
                {
                    let outcome = ReplyOutcome::Pong {
                        host_sent_ns,
                        box_received_ns: now_ns,
                        box_sent_ns: now_ns,
                        stream_next: self.end.stream_next(),
                    };
                    let reply = Message::Reply(Reply { id, outcome });
                    let sealed = self.end.seal_to(listener, &reply, &mut buffer).unwrap();
                    let packet = sealed.unwrap().1.to_vec();
                    self.send(&packet);
                }
            }
        }
    }

    fn pair(&mut self, key: Key) {
        let key_id = key.id();
        let is_stored = self.does != Does::Fail;
        if is_stored && self.key.as_ref() != Some(&key) {
            let used = if self.does == Does::Lie { Key::new([1; 32]).unwrap() } else { key };
            self.end = BoxEnd::new(Some(used.clone()), Start::MIN, &[5; 32]);
            self.end.describe(BoxState::Ready, 10, "");
            self.key = Some(used);
        }
        if self.does == Does::StoreUnheard && self.unheard < 1 {
            self.unheard += 1;
            return;
        }
        let paired = Paired { key_id, is_stored }.packet(&mut [0; SEALED_BYTES_MAX]).to_vec();
        self.send(&paired);
    }

    fn send(&mut self, packet: &[u8]) {
        let mut buffer = [0; SEALED_FRAME_BYTES_MAX];
        let _ = self.line.write_all(frame_packet(packet, &mut buffer).unwrap());
    }
}

/// Pairs a box that has a key or none, and says this of itself; gives what `plumb` said and the
/// box's key.
fn pair(
    directory: &Path,
    (key, pairing_s, text): (Option<Key>, u8, &str),
    does: Does,
    more: &[&str],
) -> (Finished, Option<Key>) {
    let (mut line, host) = TTYPort::pair().unwrap();
    line.set_timeout(Duration::from_millis(5)).unwrap();
    let device = host.name().unwrap();
    let mut end = BoxEnd::new(key.clone(), Start::MIN, &[2; 32]);
    let state = if key.is_some() { BoxState::Ready } else { BoxState::Unpaired };
    end.describe(state, pairing_s, text);
    let stop = Arc::new(AtomicBool::new(false));
    let played = PlayedBox { line, end, key, does, unheard: 0 }.play(Arc::clone(&stop));
    let mut arguments = vec!["pair", "--serial", &device];
    // The pair's own end would be a second reader.
    drop(host);
    arguments.extend(more);
    let finished = plumb(directory, &arguments);
    stop.store(true, Ordering::Relaxed);
    (finished, played.join().unwrap())
}

#[track_caller]
fn says(finished: &Finished, code: i32, parts: &[&str]) {
    let said = &finished.stderr;
    assert_eq!(finished.code, Some(code), "{said}");
    assert!(parts.iter().all(|part| said.contains(part)), "not all of {parts:?} in {said}");
}

fn listed(directory: &Path) -> String {
    let finished = plumb(directory, &["keys", "list"]);
    finished.stdout + &finished.stderr
}

#[test]
fn a_box_without_a_key_gets_one_that_is_kept_here() {
    if !serial_lines() {
        return;
    }
    for does in [Does::Store, Does::StoreUnheard] {
        let folder = tempfile::tempdir().unwrap();
        let (finished, key) = pair(folder.path(), (None, 255, NAMED), does, &[]);
        let id = key.as_ref().unwrap().id().to_string();
        let paired = format!(
            "paired: the box \"ward 3\" (PL-0001) and this computer talk under the key {id}"
        );
        says(&finished, 0, &["is kept in", "the box has stored it", &paired]);
        assert!(!finished.stderr.contains(&key.as_ref().unwrap().text().as_str()[20..40]));
        let list = listed(folder.path());
        assert!(list.contains(&id) && list.contains("PL-0001"), "{list}");
        // Once more, there is nothing to do.
        let again = pair(folder.path(), (key.clone(), 10, ""), does, &[]);
        says(&again.0, 0, &["has the key", "already", "nothing was changed"]);
        assert_eq!(again.1, key);
    }
}

#[test]
fn a_key_of_the_store_is_taken_for_its_box() {
    if !serial_lines() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let kept = Key::new([9; 32]).unwrap();
    keys::know(folder.path(), &kept, "ward 3", "PL-0001");
    let (finished, key) = pair(folder.path(), (None, 255, NAMED), Does::Store, &[]);
    says(&finished, 0, &["paired: the box \"ward 3\" (PL-0001)"]);
    assert_eq!(key, Some(kept));
}

#[test]
fn a_box_that_does_not_say_who_it_is_is_asked_for() {
    if !serial_lines() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let unnamed = || (None, 255, "a box has no key; no config.plb");
    let (finished, key) = pair(folder.path(), unnamed(), Does::Store, &[]);
    says(&finished, 2, &["does not say which one it is", "--serial-number"]);
    assert_eq!(key, None);
    let more = ["--name", "ward 4", "--serial-number", "PL-0004"];
    let (finished, key) = pair(folder.path(), unnamed(), Does::Store, &more);
    says(&finished, 0, &["paired: the box \"ward 4\" (PL-0004)"]);
    assert!(listed(folder.path()).contains(&key.unwrap().id().to_string()));
    // The box on the line says that it is another than was meant.
    let (finished, key) = pair(folder.path(), (None, 255, NAMED), Does::Store, &more);
    says(&finished, 2, &["--serial-number", "says that it is PL-0001"]);
    assert_eq!(key, None);
}

#[test]
fn a_box_keeps_its_key_unless_it_may_and_should_have_another() {
    if !serial_lines() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let old = Key::new([8; 32]).unwrap();
    let with_key = |pairing_s| (Some(old.clone()), pairing_s, "");
    let more = ["--serial-number", "PL-0001", "--replace"];
    let (finished, key) = pair(folder.path(), with_key(60), Does::Store, &more[..2]);
    let id = old.id().to_string();
    says(&finished, 2, &["has a key already", &id, "plumb keys import", "--replace"]);
    assert_eq!(key.as_ref(), Some(&old));
    let (finished, key) = pair(folder.path(), with_key(0), Does::Store, &more);
    says(&finished, 2, &["takes no key now", "off and on", "within a minute"]);
    assert_eq!(key.as_ref(), Some(&old));
    assert!(!listed(folder.path()).contains("PL-0001"), "nothing was made for nothing");
    let (finished, key) = pair(folder.path(), with_key(60), Does::Store, &more);
    says(&finished, 0, &["paired: the box PL-0001"]);
    assert_ne!(key.unwrap(), old);
}

#[test]
fn a_pairing_that_fails_keeps_the_key_for_the_next_time() {
    if !serial_lines() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (finished, key) = pair(folder.path(), (None, 255, NAMED), Does::Fail, &[]);
    says(&finished, 2, &["could not store the key", "check its card", "the same key"]);
    assert_eq!(key, None);
    let kept = listed(folder.path());
    let (finished, key) = pair(folder.path(), (None, 255, NAMED), Does::Store, &[]);
    says(&finished, 0, &["paired: "]);
    assert!(kept.contains(&key.unwrap().id().to_string()), "{kept}");
}

#[test]
fn a_box_that_has_another_key_than_it_says_is_found_out() {
    if !serial_lines() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (finished, _) = pair(folder.path(), (None, 255, NAMED), Does::Lie, &[]);
    says(&finished, 2, &["no session is opened"]);
    assert!(!finished.stderr.contains("paired: "), "{}", finished.stderr);
}

#[test]
fn a_silent_line_and_a_noisy_one_are_told_apart() {
    if !serial_lines() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (noise, said) in [
        (None, ["no box is heard in 10 s", "check that the box is on"]),
        (Some([1, 9, 7, 7, 0]), ["pieces of noise", "--baud"]),
    ] {
        let (mut line, host) = TTYPort::pair().unwrap();
        let device = host.name().unwrap();
        drop(host);
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let noisy = std::thread::spawn(move || {
            while !stopped.load(Ordering::Relaxed) {
                if let Some(noise) = noise {
                    let _ = line.write_all(&noise);
                }
                std::thread::sleep(Duration::from_millis(100));
            }
        });
        let finished = plumb(folder.path(), &["pair", "--serial", &device]);
        stop.store(true, Ordering::Relaxed);
        noisy.join().unwrap();
        says(&finished, 2, &said);
    }
    assert!(!listed(folder.path()).contains("PL-"));
}
