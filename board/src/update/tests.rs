//! An update from its first part to the program that stays, with slots and chooser in files.

use std::path::PathBuf;
use std::thread::sleep;
use std::time::{Duration, Instant};

use plumbline::packet::{UPDATE_PART_BYTES_MAX, UpdateStep};
use plumbline_update::card::{SECTOR_BYTES, Slot};
use plumbline_update::header::{KeyId, Text, slot_hash};
use plumbline_update::sign::{SigningKey, signed};
use plumbline_update::{chooser, firmware};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

/// The program that updates the box.
pub(super) const HOST: UpdaterId = UpdaterId(1);

/// Blocks in the slot that is sent, and a sector.
const SLOT: usize = 5 * BLOCK_BYTES + SECTOR_BYTES;

/// A card in a directory, and the flag of its firmware.
pub(super) struct Bench {
    folder: tempfile::TempDir,
    pub(super) flag: firmware::Flag,
}

impl Bench {
    fn new() -> Self {
        Self::with_slots_of(2 * SLOT)
    }

    pub(super) fn with_slots_of(bytes: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for slot in ["a", "b"] {
            fs::write(folder.path().join(slot), vec![slot.as_bytes()[0]; bytes]).unwrap();
        }
        fs::write(folder.path().join("chooser"), chooser::sector(Slot::A)).unwrap();
        Self { folder, flag: firmware::Flag::default() }
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The box starts, from the slot that the firmware takes.
    fn start(&mut self) -> Updates {
        self.start_with(true)
    }

    /// It starts, and its key can be read or not.
    pub(super) fn start_with(&mut self, has_key: bool) -> Updates {
        let is_try = self.flag.take();
        let sector = fs::read(self.path("chooser")).unwrap();
        let partition = firmware::partition(&sector, is_try).unwrap();
        let running = Slot::of_partition(partition).unwrap();
        let devices = [self.path("a"), self.path("b")];
        let mut updates = Updates::of_card(Card {
            slots: Slots::in_files(running, is_try, devices, &self.path("chooser")),
            board: "virt",
            keys: vec![key(1).verifying_key()],
            notes: NoteStore::file(&self.path("update.txt")),
        });
        updates.begin_session(has_key);
        updates
    }

    /// It restarts, as its session has ended for.
    fn restart(&mut self, updates: &Updates) -> Updates {
        match updates.leave().expect("it stays") {
            Leave::ToTry => self.flag.ask_for_try(),
            Leave::ToGiveUp => {}
        }
        self.start()
    }

    fn running(&mut self) -> Slot {
        let updates = self.start();
        updates.card.unwrap().slots.running
    }
}

fn key(byte: u8) -> SigningKey {
    SigningKey::from_bytes(&[byte; 32])
}

/// The slot of an update.
fn slot() -> std::vec::Vec<u8> {
    (0..SLOT).map(|at| (at / 100 % 253) as u8).collect()
}

pub(super) fn header() -> Header {
    Header {
        board: Text::new("virt").unwrap(),
        version: "0.2.0".parse().unwrap(),
        oldest_allowed: "0.1.0".parse().unwrap(),
        commit: Text::new("0123456789ab").unwrap(),
        slot_bytes: SLOT as u32,
        slot_hash: slot_hash(&slot()),
        key: KeyId::of(&key(1).verifying_key()),
    }
}

pub(super) fn file(header: &Header, slot: &[u8]) -> std::vec::Vec<u8> {
    [&signed(header, &key(1))[..], slot].concat()
}

pub(super) fn state(updates: &Updates) -> (UpdateState, String) {
    match updates.query() {
        UpdateOutcome::State { state, text } => (state, text.as_str().to_owned()),
        other => panic!("{other:?}"),
    }
}

/// The time limit for the writing of a test's update, on a computer that does much besides.
const WRITTEN_WITHIN: Duration = Duration::from_secs(60);

/// Sends an update as a host does, over a link that loses every tenth part.
fn send(updates: &mut Updates, sender: UpdaterId, file: &[u8]) -> (UpdateState, String) {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let begun = updates.begin(sender, false);
    let empty = UpdateState::Receiving { next: 0 };
    assert!(matches!(begun, UpdateOutcome::State { state, .. } if state == empty));
    assert!(!updates.look_after(0, false), "nothing has come of it yet");
    let mut has_come = false;
    let mut before = 0;
    let give_up = Instant::now() + WRITTEN_WITHIN;
    while Instant::now() < give_up {
        has_come |= updates.look_after(0, false);
        let from = match state(updates) {
            (UpdateState::Receiving { next }, _) => next as usize,
            (UpdateState::Checking, _) => file.len(),
            now => {
                assert!(has_come || now.0 != UpdateState::Ready);
                return now;
            }
        };
        if from == before {
            // A thread of its own writes and checks.
            sleep(Duration::from_millis(1));
        }
        before = from;
        for (index, bytes) in file[from..].chunks(UPDATE_PART_BYTES_MAX).take(500).enumerate() {
            if !random.random_bool(0.1) {
                updates.take(sender, (from + index * UPDATE_PART_BYTES_MAX) as u32, bytes);
            }
        }
    }
    panic!("it is not written and checked in {WRITTEN_WITHIN:?}")
}

#[test]
fn an_update_is_sent_tried_and_stays() {
    let host = HOST;
    let mut bench = Bench::new();
    let mut old = bench.start();
    assert_eq!(state(&old), (UpdateState::None, String::new()));
    let before = fs::read(bench.path("a")).unwrap();
    assert_eq!(send(&mut old, host, &file(&header(), &slot())).0, UpdateState::Ready);
    // The slot that runs, and what chooses, are as they were.
    assert_eq!(fs::read(bench.path("a")).unwrap(), before);
    assert_eq!(fs::read(bench.path("chooser")).unwrap(), chooser::sector(Slot::A));
    assert!(fs::read(bench.path("b")).unwrap().starts_with(&slot()));
    assert!(matches!(old.try_it(), UpdateOutcome::State { state: UpdateState::Restarting, .. }));

    let mut new = bench.restart(&old);
    let (now, text) = state(&new);
    assert!(now == UpdateState::OnTrial && text.contains("0 of 30 frames"), "{text}");
    // Nobody replaces what has yet to show that it works, nor what it would go back to.
    assert!(matches!(
        new.begin(host, false),
        UpdateOutcome::Refused { refusal: UpdateRefusal::Busy, .. }
    ));
    assert!(new.is_unproven() && !old.is_unproven());
    assert!(!new.look_after(29, true));
    assert_eq!(state(&new).0, UpdateState::OnTrial);
    assert!(new.look_after(30, false));
    assert!(!new.is_unproven());
    let installed = (UpdateState::Installed, "version 0.2.0 (0123456789ab)".to_owned());
    assert_eq!((state(&new), new.leave()), (installed.clone(), None));
    assert_eq!(fs::read(bench.path("chooser")).unwrap(), chooser::sector(Slot::B));
    // From then on, and the next update goes to the other slot.
    let mut later = bench.start();
    assert_eq!(state(&later), installed);
    assert_eq!(send(&mut later, host, &file(&header(), &slot())).0, UpdateState::Ready);
    assert!(fs::read(bench.path("a")).unwrap().starts_with(&slot()));
    assert_eq!(bench.running(), Slot::B);
}

#[test]
fn a_trial_that_fails_hangs_or_loses_power_leads_back_and_the_box_says_why() {
    let host = HOST;
    for (fails, words) in [
        (true, "version 0.2.0 (0123456789ab): the camera is broken"),
        (false, "it never came to say that it works"),
    ] {
        let mut bench = Bench::new();
        let mut old = bench.start();
        send(&mut old, host, &file(&header(), &slot()));
        old.try_it();
        let mut new = bench.restart(&old);
        let back = if fails {
            new.give_up("the camera is broken");
            bench.restart(&new)
        } else {
            // The watchdog, or the power: nothing could be written.
            bench.start()
        };
        let (now, text) = state(&back);
        assert!(now == UpdateState::GivenUp && text.contains(words), "{text}");
        assert_eq!(back.card.as_ref().unwrap().slots.running, Slot::A);
        // It is no end: the same update can be sent again.
        assert_eq!(send(&mut bench.start(), host, &file(&header(), &slot())).0, UpdateState::Ready);
    }
}

/// The sectors of an update in the order in which they are written: the idle slot, and at last the one
/// of the chooser. A card writes a sector or does not.
#[test]
fn power_cut_after_any_sector_leaves_a_box_that_starts() {
    let mut bench = Bench::new();
    let is_measuring = |bench: &mut Bench, slot: Slot| {
        let system = fs::read(bench.path(if slot == Slot::A { "a" } else { "b" })).unwrap();
        let whole = if slot == Slot::A { vec![b'a'; 2 * SLOT] } else { slot_of_card() };
        bench.running() == slot && system == whole
    };
    let (mut on_card, update) = (vec![b'b'; 2 * SLOT], slot());
    for (index, sector) in update.chunks(SECTOR_BYTES).enumerate() {
        assert!(is_measuring(&mut bench, Slot::A), "after {index} sectors");
        on_card[index * SECTOR_BYTES..][..sector.len()].copy_from_slice(sector);
        fs::write(bench.path("b"), &on_card).unwrap();
    }
    let note = Note { update: Update::of(&header(), Slot::B), fate: Fate::Trying };
    NoteStore::file(&bench.path("update.txt")).keep(&note).unwrap();
    assert!(is_measuring(&mut bench, Slot::A));
    assert_eq!(state(&bench.start()).0, UpdateState::GivenUp);
    fs::write(bench.path("chooser"), chooser::sector(Slot::B)).unwrap();
    assert!(is_measuring(&mut bench, Slot::B));
    assert_eq!(state(&bench.start()).0, UpdateState::Installed);
}

/// Slot B when the update has been written to it.
fn slot_of_card() -> std::vec::Vec<u8> {
    let mut slot = slot();
    slot.resize(2 * SLOT, b'b');
    slot
}

#[test]
fn a_note_means_what_the_start_after_it_makes_of_it() {
    let given_up = || {
        let why = "it never came to say that it works: it did not start, hung, or lost its power";
        Fate::Failed(why.into())
    };
    let failed = || Fate::Failed("the camera is broken".into());
    for (kept, running, is_on_trial, means) in [
        (Fate::Trying, Slot::B, true, Fate::Trying),
        (Fate::Trying, Slot::B, false, Fate::Installed),
        (Fate::Trying, Slot::A, false, given_up()),
        (Fate::Installed, Slot::B, false, Fate::Installed),
        (Fate::Installed, Slot::A, true, Fate::Installed),
        (failed(), Slot::A, false, failed()),
    ] {
        let note = Note { update: Update::of(&header(), Slot::B), fate: kept };
        let expected = Note { fate: means, ..note.clone() };
        assert_eq!(settled(note, running, is_on_trial), expected, "{running} {is_on_trial}");
    }
}

#[test]
fn power_cut_between_the_chooser_and_the_note_is_an_installed_update() {
    let host = HOST;
    let mut bench = Bench::new();
    let mut old = bench.start();
    send(&mut old, host, &file(&header(), &slot()));
    old.try_it();
    let new = bench.restart(&old);
    new.card.as_ref().unwrap().slots.commit().unwrap();
    assert_eq!(state(&bench.start()).0, UpdateState::Installed);
}

#[test]
fn what_is_not_signed_for_this_box_is_refused_before_anything_is_written() {
    let host = HOST;
    let sound = header();
    let forged = |change: &dyn Fn(&mut std::vec::Vec<u8>)| {
        let mut file = file(&sound, &slot());
        change(&mut file);
        file
    };
    let other = Header { board: Text::new("rpi4").unwrap(), ..sound };
    let (version, oldest_allowed) = ("0.0.9".parse().unwrap(), "0.0.9".parse().unwrap());
    let old = Header { version, oldest_allowed, ..sound };
    let unknown = Header { key: KeyId::of(&key(2).verifying_key()), ..sound };
    for (file, words) in [
        (forged(&|it| it[80] ^= 1), "its signature is wrong"),
        (forged(&|it| it[0] ^= 1), "not an update of a box"),
        (file(&other, &slot()), "it is for the board rpi4"),
        (file(&old, &slot()), "its version is 0.0.9, and the box goes back to 0.1.0 at most"),
        (file(&unknown, &slot()), "which the box does not know"),
    ] {
        let mut bench = Bench::new();
        let mut updates = bench.start();
        let before = fs::read(bench.path("b")).unwrap();
        let (now, text) = send(&mut updates, host, &file);
        assert!(now == UpdateState::Unusable && text.contains(words), "{words}: {text}");
        assert_eq!(fs::read(bench.path("b")).unwrap(), before, "{words}");
        assert!(matches!(updates.try_it(), UpdateOutcome::Refused { .. }));
        assert_eq!(updates.leave(), None);
    }
}

#[test]
fn a_slot_that_is_not_what_was_signed_is_never_tried() {
    let host = HOST;
    let mut damaged = slot();
    damaged[SLOT - 1] ^= 1;
    let mut bench = Bench::new();
    let mut updates = bench.start();
    let (now, text) = send(&mut updates, host, &file(&header(), &damaged));
    assert!(now == UpdateState::Unusable && text.contains("not what was signed"), "{text}");
    assert!(matches!(updates.try_it(), UpdateOutcome::Refused { .. }));
}

#[test]
fn parts_of_two_hosts_are_not_mixed_and_what_was_begun_can_be_begun_again() {
    let (one, other) = (HOST, UpdaterId(2));
    let file = file(&header(), &slot());
    let mut bench = Bench::new();
    let mut updates = bench.start();
    updates.begin(one, false);
    updates.take(other, 0, &file[..100]);
    assert_eq!(state(&updates).0, UpdateState::Receiving { next: 0 });
    updates.take(one, 0, &file[..100]);
    updates.take(one, 101, &file[101..200]);
    updates.take(one, 0, &file[..100]);
    assert_eq!(state(&updates).0, UpdateState::Receiving { next: 100 });
    assert!(matches!(updates.try_it(), UpdateOutcome::Refused { .. }));
    assert_eq!(send(&mut updates, other, &file).0, UpdateState::Ready);
}

#[test]
fn a_computer_that_is_no_box_of_its_own_says_how_it_is_updated() {
    let host = HOST;
    let mut updates = Updates::impossible("use apt");
    for outcome in [updates.begin(host, false), updates.query()] {
        let UpdateOutcome::Refused { refusal, text } = outcome else { panic!("{outcome:?}") };
        assert_eq!((refusal, text.as_str()), (UpdateRefusal::NotSupported, "use apt"));
    }
}

#[test]
fn boards_are_told_by_the_kernels_device_tree() {
    assert_eq!(board(b"raspberrypi,4-model-b\0brcm,bcm2711\0"), Some("rpi4"));
    assert_eq!(board(b"linux,dummy-virt\0"), Some("virt"));
    assert_eq!(board(b"raspberrypi,5-model-b\0brcm,bcm2712\0"), None);
    assert_eq!(board(b""), None);
}

#[test]
fn keys_are_whole_and_there_is_one() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let words = |path: &Path| format!("{:#}", keys(path).unwrap_err());
    assert!(words(file.path()).contains("empty"));
    fs::write(file.path(), [7; 33]).unwrap();
    assert!(words(file.path()).contains("has no keys"));
    assert!(words(Path::new("/nowhere")).contains("--update-key"));
    // A file that is there and cannot be read is no image without a key.
    let folder = tempfile::tempdir().unwrap();
    let said = words(folder.path());
    assert!(said.starts_with(&folder.path().display().to_string()), "{said}");
    fs::write(file.path(), key(1).verifying_key().to_bytes()).unwrap();
    assert_eq!(keys(file.path()).unwrap(), [key(1).verifying_key()]);
}

/// A card that is busy may disturb a trial: whoever sends an update waits until it is over.
#[test]
fn while_a_trial_is_recorded_an_update_waits_unless_it_is_forced() {
    let mut bench = Bench::new();
    let mut updates = bench.start();
    let file = file(&header(), &slot());
    let part = |at: usize| UpdateStep::Part {
        offset: at as u32,
        bytes: file[at..at + 100].iter().copied().collect(),
    };
    let is_refused = |outcome: Option<UpdateOutcome>| {
        let Some(UpdateOutcome::Refused { refusal, text }) = outcome else { return false };
        refusal == UpdateRefusal::Recording && text.contains("desk of ward 3")
    };
    let recorder = Some("desk of ward 3");
    let [begin, by_force] = [false, true].map(|is_forced| UpdateStep::Begin { is_forced });
    assert!(is_refused(updates.answer(HOST, begin.clone(), recorder)));
    assert_eq!(state(&updates).0, UpdateState::None);
    // What has become of the last one may be asked.
    assert!(!is_refused(updates.answer(HOST, UpdateStep::Query, recorder)));

    updates.answer(HOST, begin, None);
    assert_eq!(updates.answer(HOST, part(0), None), None);
    // Somebody begins to record: nothing more is taken, and the host is told to wait.
    assert_eq!(updates.answer(HOST, part(100), recorder), None);
    assert!(is_refused(updates.answer(HOST, UpdateStep::Query, recorder)));
    assert_eq!(state(&updates).0, UpdateState::Receiving { next: 100 });
    // Afterwards it goes on from where it was.
    assert_eq!(updates.answer(HOST, part(100), None), None);
    assert_eq!(state(&updates).0, UpdateState::Receiving { next: 200 });

    updates.answer(HOST, by_force, recorder);
    assert_eq!(updates.answer(HOST, part(0), recorder), None);
    assert_eq!(state(&updates).0, UpdateState::Receiving { next: 100 });
    assert_eq!(send(&mut updates, HOST, &file).0, UpdateState::Ready);
    assert!(is_refused(updates.answer(HOST, UpdateStep::Try { is_forced: false }, recorder)));
    assert_eq!(updates.leave(), None);
    updates.answer(HOST, UpdateStep::Try { is_forced: true }, recorder);
    assert_eq!(updates.leave(), Some(Leave::ToTry));
}
