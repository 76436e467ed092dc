//! Another system for a box, over its link, with the real `plumb update`.
//!
//! The box is the card of a Raspberry Pi in QEMU's own board, which has a network. What the card's
//! firmware does is played here by its documented rules ([`plumbline_update::firmware`]): it takes the
//! slot that the chooser names, or the other one once, if the kernel was told so when it restarted; and
//! it clears that flag before it starts anything. What hangs is reset by the watchdog.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use plumbline::config::FILE_NAME;
use plumbline_test_support::{evidence, free_port, repetitions, seed};
use plumbline_update::card::{SETTINGS, Slot};
use plumbline_update::firmware::Flag;
use plumbline_update::header::{Header, KeyId, Text, slot_hash};
use plumbline_update::release::{CURRENT, OLDEST_ALLOWED, Version};
use plumbline_update::sign::{self, SigningKey, signed};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::machine::{HOST, Host, Machine, PATIENCE, Parts, VIRT, image, read, wait_for_packet};
use crate::pi::{chosen, place};
use crate::scene::{self, SCENE, file_on, run};
use common::{binary, keys};

/// What the kernel says as its last word, if it was asked for a try.
const ASKED_FOR_TRY: &str = "Restarting system with command '0 tryboot'";

/// Older than any.
const ZERO: Version = Version { major: 0, minor: 0, patch: 0 };

/// A box whose card has slots, and the host in its network.
struct Ward {
    directory: tempfile::TempDir,
    /// Where `plumb` hears the box.
    port: u16,
    card: PathBuf,
    flag: Flag,
    machine: Option<Machine>,
    /// What runs.
    slot: Slot,
    starts: usize,
}

impl Ward {
    fn new() -> Self {
        let directory = tempfile::tempdir().expect("a temporary directory");
        let port = free_port();
        let card = directory.path().join("card.img");
        let names = [image("rpi4.img"), card.clone()];
        let names = names.each_ref().map(|path| path.to_str().expect("a plain path"));
        run("cp", &["--sparse=always", names[0], names[1]]);
        let blob = scene::blob(&scene::config((HOST, port).into()));
        scene::copy(&card, SETTINGS.start_bytes, FILE_NAME, &blob);
        scene::copy_key(&card, SETTINGS.start_bytes);
        let ward = Self {
            directory,
            port,
            card,
            flag: Flag::default(),
            machine: None,
            slot: Slot::A,
            starts: 0,
        };
        std::fs::write(ward.path("box.key"), scene::key_file(&scene::key())).expect("a key");
        ward.plumb("keys import box.key --name box");
        ward
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn plumb(&self, arguments: &str) -> String {
        binary::plumb_in(self.directory.path(), arguments)
    }

    /// The firmware starts what its rules say.
    fn start(&mut self) {
        let is_try = self.flag.take();
        self.slot = chosen(&self.card, is_try);
        self.starts += 1;
        println!("start {}: {}{}", self.starts, self.slot, if is_try { ", a try" } else { "" });
        let partition = place(&self.card, &self.slot.partition());
        let file = |name: &str| file_on(&partition, name).expect("it is in the slot");
        for name in ["vmlinuz", "initramfs"] {
            std::fs::write(self.path(name), file(name)).expect("there is room");
        }
        let words = String::from_utf8(file("cmdline.txt")).expect("it is text");
        // The card's own consoles are a Pi's.
        let words = words.split_whitespace().filter(|word| !word.starts_with("console="));
        let words: Vec<&str> = words.collect();
        let tree = self.tree(is_try);
        let parts = Parts {
            kernel: self.path("vmlinuz"),
            initramfs: vec![self.path("initramfs"), image("overlay.cpio")],
            command_line: &format!("rdinit=/test/start {}", words.join(" ")),
            boot_disk: &self.card,
            boot_disk_options: "",
            frames_disk: Some(&SCENE.frames_disk),
            device_tree: Some(&tree),
        };
        self.machine = Some(Machine::start(&parts, &Host::new()));
    }

    /// The device tree with what the firmware says in it.
    fn tree(&self, is_try: bool) -> PathBuf {
        let tree = self.path("tree.dtb");
        let name = tree.to_str().expect("a plain path");
        let machine = VIRT.replace("-machine virt", &format!("-machine virt,dumpdtb={name}"));
        let arguments: Vec<&str> =
            machine.split(' ').chain(["-nodefaults", "-display", "none"]).collect();
        run("qemu-system-aarch64", &arguments);
        let loader = "/chosen/bootloader";
        let number = format!("{:x}", self.slot.partition().number);
        run("fdtput", &["-p", "-t", "x", name, loader, "partition", &number]);
        run("fdtput", &["-p", "-t", "x", name, loader, "tryboot", if is_try { "1" } else { "0" }]);
        tree
    }

    fn machine(&mut self) -> &mut Machine {
        self.machine.as_mut().expect("it is on")
    }

    /// The plug is pulled.
    fn cut_power(&mut self) {
        self.machine = None;
        self.flag.lose_power();
    }

    /// Does what the firmware does, until `done`.
    fn keep(&mut self, done: impl Fn() -> bool) {
        let give_up = Instant::now() + 3 * PATIENCE;
        while !done() {
            assert!(Instant::now() < give_up, "it is never done");
            thread::sleep(Duration::from_millis(50));
            if self.machine().has_ended() {
                self.restart();
            }
        }
    }

    /// The machine was reset.
    fn restart(&mut self) {
        // Its last words are on their way from a process that has ended.
        thread::sleep(Duration::from_millis(200));
        if self.machine().look(|seen| seen.console.contains(ASKED_FOR_TRY)) {
            self.flag.ask_for_try();
        }
        self.machine = None;
        self.start();
    }

    /// Has `plumb update` send this file, while the firmware does its part; its exit code, and what it
    /// says.
    fn update(&mut self, file: &str) -> (Option<i32>, String) {
        let arguments = format!("update {file} --udp 127.0.0.1:{}", self.port);
        let directory = self.directory.path().to_owned();
        let plumb = thread::spawn(move || binary::plumb_judges_in(&directory, &arguments));
        self.keep(|| plumb.is_finished());
        plumb.join().expect("plumb was run")
    }

    /// Starts `plumb update`, which is then ended by whoever wants it to end.
    fn spawn_update(&self, file: &str) -> Child {
        let arguments = format!("update {file} --udp 127.0.0.1:{}", self.port);
        let mut command = binary::plumb();
        command.args(arguments.split(' ')).current_dir(self.directory.path());
        command.env("XDG_DATA_HOME", keys::data(self.directory.path()));
        command.stderr(Stdio::null()).spawn().expect("plumb runs")
    }

    /// Writes an update of what the card has, with these words added to what its kernel is told, and
    /// with a changed head.
    fn make(&self, name: &str, words: &str, change: impl Fn(&mut Header), key: &SigningKey) {
        let slot = slot_with(self.directory.path(), words);
        let slot = sign::used(&slot).expect("a FAT32");
        let mut header = Header {
            board: Text::new("virt").expect("a name"),
            version: next_version(),
            oldest_allowed: OLDEST_ALLOWED,
            commit: Text::new("0123456789ab").expect("a commit"),
            slot_bytes: slot.len() as u32,
            slot_hash: slot_hash(slot),
            key: KeyId::of(&key.verifying_key()),
        };
        change(&mut header);
        let file = [&signed(&header, key)[..], slot].concat();
        std::fs::write(self.path(name), file).expect("there is room");
    }
}

/// The key with whose public one the card was made.
fn key() -> SigningKey {
    SigningKey::from_bytes(&read(&image("update.key")).try_into().expect("32 bytes"))
}

fn next_version() -> Version {
    Version { patch: CURRENT.patch + 1, ..CURRENT }
}

/// The slot of a new card, with these words added to what the kernel is told, and without what only a
/// Pi needs.
fn slot_with(directory: &Path, words: &str) -> Vec<u8> {
    let mut card = std::fs::File::open(image("rpi4.img")).expect("the card");
    let partition = Slot::A.partition();
    std::io::Seek::seek(&mut card, std::io::SeekFrom::Start(partition.start_bytes)).expect("it is");
    let mut slot = vec![0; partition.bytes as usize];
    card.read_exact(&mut slot).expect("it has a slot");
    let file = directory.join("slot.img");
    std::fs::write(&file, slot).expect("there is room");
    let name = file.to_str().expect("a plain path");
    let told = file_on(name, "cmdline.txt").expect("it is there");
    let told = format!("{} {words}\n", String::from_utf8(told).expect("it is text").trim());
    scene::copy(&file, 0, "cmdline.txt", told.as_bytes());
    read(&file)
}

#[test]
fn a_box_takes_what_is_signed_for_it_and_stays_with_what_has_shown_that_it_works() {
    let mut ward = Ward::new();
    ward.start();
    wait_for_packet(ward.port);
    assert_refused(&mut ward);
    assert_leads_back(&mut ward, "hangs.plu", "plumbline.hang_after=10", NEVER_CAME);
    ward.make("good.plu", "", |_| {}, &key());
    let shown = ward.plumb("update good.plu --show");
    assert!(shown.contains(&format!("version {} for virt", next_version())), "{shown}");
    let starts = ward.starts;
    let (code, said) = ward.update("good.plu");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("runs it from now on"), "{said}");
    assert_eq!((ward.slot, ward.starts - starts), (Slot::B, 1));
    // It is the one that starts from now on.
    ward.cut_power();
    ward.start();
    assert_eq!(ward.slot, Slot::B);
    wait_for_packet(ward.port);
}

#[test]
#[ignore = "waits for minutes: cargo xtask test endurance"]
fn a_system_that_does_not_work_leads_back_to_the_one_before() {
    let mut ward = Ward::new();
    ward.start();
    wait_for_packet(ward.port);
    // It has no camera: the program that plays one is not started.
    let blind = "the camera has given 0 of 30 frames";
    assert_leads_back(&mut ward, "blind.plu", "rdinit=/init", blind);
    assert_leads_back(&mut ward, "no-program.plu", "rdinit=/nothing", NEVER_CAME);
    assert_leads_back(&mut ward, "stuck.plu", "plumbline.hang_at_start=20", NEVER_CAME);
    evidence(
        "updates of an emulated box that are blind, have no program, or hang",
        "3 updates",
        "each led back to the system before, which said why",
    );
}

/// What the system that is back says of one that could say nothing.
const NEVER_CAME: &str = "it never came to say that it works";

/// What is not signed for this box is refused before it restarts.
fn assert_refused(ward: &mut Ward) {
    let stranger = SigningKey::from_bytes(&[1; 32]);
    let other = |header: &mut Header| header.board = Text::new("rpi4").expect("a name");
    let older = |header: &mut Header| {
        (header.version, header.oldest_allowed) = (Version { patch: 9, ..ZERO }, ZERO);
    };
    let pretended = |header: &mut Header| header.key = KeyId::of(&key().verifying_key());
    ward.make("other.plu", "", other, &key());
    ward.make("older.plu", "", older, &key());
    ward.make("stranger.plu", "", |_| {}, &stranger);
    ward.make("pretended.plu", "", pretended, &stranger);
    let before = (ward.slot, ward.starts);
    for (file, words) in [
        ("other.plu", "it is for the board rpi4"),
        ("older.plu", "its version is 0.0.9, and the box goes back to"),
        ("stranger.plu", "which the box does not know"),
        ("pretended.plu", "its signature is wrong"),
    ] {
        let (code, said) = ward.update(file);
        assert!(code == Some(2) && said.contains(words), "{file}: {said}");
    }
    assert_eq!((ward.slot, ward.starts), before);
}

/// An update whose kernel is told these words is tried and given up, and the box says why.
fn assert_leads_back(ward: &mut Ward, name: &str, words: &str, why: &str) {
    ward.make(name, words, |_| {}, &key());
    let (slot, starts) = (ward.slot, ward.starts);
    let (code, said) = ward.update(name);
    assert!(code == Some(2) && said.contains(why), "{name}: {said}");
    // Once for the try, and once for the way back.
    assert_eq!((ward.slot, ward.starts - starts), (slot, 2), "{name}");
    wait_for_packet(ward.port);
}

/// How often the power is cut.
const CUTS: usize = 100;

#[test]
#[ignore = "takes two hours: cargo xtask test endurance"]
fn a_hundred_power_cuts_while_a_box_is_updated_leave_a_box_that_measures() {
    let (seed, cuts) = (seed(), repetitions(CUTS));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut ward = Ward::new();
    ward.make("good.plu", "", |_| {}, &key());
    ward.start();
    wait_for_packet(ward.port);
    // How long the whole takes says when to cut.
    let begun = Instant::now();
    let (code, said) = ward.update("good.plu");
    assert_eq!(code, Some(0), "{said}");
    let whole = begun.elapsed();
    println!("an update takes {:.0} s here", whole.as_secs_f64());
    let mut stayed = 0;
    for cut in 1..=cuts {
        let (before, begun) = (ward.slot, Instant::now());
        let moment = whole.mul_f64(random.random_range(0.0..1.0));
        let mut plumb = ward.spawn_update("good.plu");
        ward.keep(|| begun.elapsed() >= moment);
        ward.cut_power();
        let _ = plumb.kill();
        let _ = plumb.wait();
        ward.start();
        wait_for_packet(ward.port);
        stayed += usize::from(ward.slot == before);
        println!("cut {cut} after {:.1} s: {}", moment.as_secs_f64(), ward.slot);
    }
    evidence(
        &format!("the power of an emulated box cut at a random moment of an update, seed {seed}"),
        &format!("{cuts} cuts"),
        &format!(
            "it measured after each: {stayed} times with what it had, {} with the update",
            cuts - stayed
        ),
    );
}
