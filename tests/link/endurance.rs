//! What happens to a recording, a hundred times each: minutes, which nobody waits for every day. `cargo
//! xtask test endurance` runs these, with the programs as people have them.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use nix::errno::Errno;
use nix::mount::{MntFlags, MsFlags, mount, umount2};
use plumbline::packet::PosePacket;
use plumbline_test_support::{Absent, evidence, repetitions, seed, skip};
use plumbline_trial::journal::{Entry, Reader};
use plumbline_trial::{Trial, names};
use rand::{Rng as _, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::bench::{Bench, assert_whole, sorted, wait_for};
use crate::relay::{Faults, Relay};

/// An entry of the journal is not longer, stuffed.
const ENTRY_BYTES_MAX: u64 = 2_100;

/// What a disk may have at the end of a file after a loss of power: nothing, zeros, or anything, up to
/// the end of its block.
const BLOCK_BYTES: usize = 4_096;

fn random_ms(random: &mut ChaCha8Rng, ms: std::ops::Range<u64>) -> Duration {
    Duration::from_millis(random.random_range(ms))
}

/// All of these are as the box has sent them, each once.
fn assert_sent(recorded: &[PosePacket], sent: &[PosePacket]) {
    let sorted = sorted(recorded.to_vec());
    assert!(sorted.windows(2).all(|it| it[0].sequence < it[1].sequence), "a pose came twice");
    for pose in recorded {
        assert_eq!(sent.get(pose.sequence as usize), Some(pose), "it was never sent");
    }
}

/// Without a hole between the first and the last of them.
fn is_without_holes(recorded: &[PosePacket]) -> bool {
    let sorted = sorted(recorded.to_vec());
    sorted.windows(2).all(|it| it[0].sequence + 1 == it[1].sequence)
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_recording_that_is_killed_at_any_moment_is_there_until_then() {
    let (seed, times) = (seed(), repetitions(100));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], seed);
    let mut the_box = bench.start(&relay, "sent.bin");
    wait_for("an announcement", || relay.the_box().is_some());
    let (mut empty, mut all, mut cut_files) = (0, 0, 0);
    let mut trials = Vec::new();
    for time in 0..times {
        let trial = format!("trial-{time}");
        // Each second one also takes what the box has kept, as fast as it can.
        let past = if time % 2 == 1 { "--past" } else { "" };
        let mut host = bench.host(0, &format!("receive --anyway {past} --quiet --out {trial}"));
        sleep(random_ms(&mut random, 0..2_500));
        host.kill();
        let folder = bench.path(&trial);
        let recorded = bench.recorded(&trial);
        if folder.exists() {
            assert_readable(&folder, recorded.len());
        }
        assert!(time % 2 == 1 || is_without_holes(&recorded), "{trial} has a hole");
        empty += usize::from(recorded.is_empty());
        all += recorded.len();
        cut_files += cut(&bench, &trial, &mut random);
        trials.push(recorded);
        if (time + 1).is_multiple_of(10) {
            println!("{} of {times} killed: {all} poses, {empty} without any", time + 1);
        }
    }
    the_box.end();
    let sent = bench.sent("sent.bin");
    trials.iter().for_each(|recorded| assert_sent(recorded, &sent));
    // Whoever analyses one is told.
    if let Some(long) = trials.iter().position(|it| it.len() > 60) {
        let said = bench.done(&format!("replay trial-{long} --tables"));
        assert!(said.contains("was cut off"), "{said}");
    }
    assert!(empty < times / 2 || times < 10, "{empty} of {times} had not begun");
    evidence(
        "`plumb receive` killed (SIGKILL) at random moments of a recording",
        &format!("{times} recordings"),
        &format!(
            "{times} of {times} are readable until then ({all} poses, all as the box sent them; {empty} \
             had none yet)"
        ),
    );
    evidence(
        "their journals cut at a random byte, with nothing, zeros or noise behind it to the end of the \
         block, as after a power cut",
        &format!("{cut_files} journals"),
        "each reads as what was written before the cut, and nothing of what lies behind is taken",
    );
}

/// A trial that was cut off can be opened, and says so.
fn assert_readable(folder: &Path, poses: usize) {
    let has = |name: &str| folder.join(name).exists();
    match Trial::open(folder) {
        Ok(trial) => {
            let warnings = &trial.warnings;
            assert!(warnings.iter().any(|it| it.contains("was cut off")), "{warnings:?}");
            assert_eq!(trial.frames.len(), poses, "{}", folder.display());
        }
        // Killed before it had begun: there is nothing to lose.
        Err(error) => {
            assert!(poses == 0 && !has(names::MANIFEST), "{}: {error}", folder.display());
        }
    }
}

fn entries_of(journal: &Path) -> Result<Vec<Entry>, String> {
    let mut reader = Reader::open(journal).map_err(|error| error.to_string())?;
    let mut entries = Vec::new();
    while let Some(entry) = reader.next_entry().map_err(|error| error.to_string())? {
        entries.push(entry);
    }
    let damaged = reader.damaged_bytes();
    assert!(damaged < ENTRY_BYTES_MAX + BLOCK_BYTES as u64, "{damaged} bytes belong to no entry");
    Ok(entries)
}

/// Cuts the journal of a trial where a loss of power could have; what is read of it must be what lies
/// before the cut. The number of journals that were cut.
fn cut(bench: &Bench, trial: &str, random: &mut ChaCha8Rng) -> usize {
    let (folder, copy) = (bench.path(trial), bench.path("cut"));
    let journal = folder.join(names::JOURNAL);
    let Ok(bytes) = fs::read(&journal) else { return 0 };
    let Ok(whole) = entries_of(&journal) else { return 0 };
    let mut cuts = 0;
    for tail in 0..3 {
        let at = random.random_range(0..=bytes.len());
        let mut cut = bytes[..at].to_vec();
        let mut behind = vec![0; (BLOCK_BYTES - at % BLOCK_BYTES) * usize::from(tail > 0)];
        if tail == 2 {
            random.fill_bytes(&mut behind);
        }
        cut.extend(behind);
        fs::create_dir(&copy).unwrap();
        for entry in fs::read_dir(&folder).unwrap() {
            let entry = entry.unwrap();
            fs::copy(entry.path(), copy.join(entry.file_name())).unwrap();
        }
        let journal = copy.join(names::JOURNAL);
        fs::write(&journal, cut).unwrap();
        match entries_of(&journal) {
            Ok(entries) => {
                assert!(whole.starts_with(&entries), "{trial} cut at {at}: not a beginning");
                // What lies behind may have a border, which makes an entry whole that lacked no more.
                let least = whole_before(&bytes[..at]).len();
                assert!((least..=least + 1).contains(&entries.len()), "{trial} cut at {at}");
                if copy.join(names::MANIFEST).exists() {
                    let trial = Trial::open(&copy).expect("it can be opened");
                    assert!(trial.warnings.iter().any(|it| it.contains("was cut off")));
                }
            }
            // Its first line is missing.
            Err(error) => assert!(error.contains("not a Plumbline journal") && at < 20, "{error}"),
        }
        fs::remove_dir_all(&copy).unwrap();
        cuts += 1;
    }
    cuts
}

/// The entries of the beginning of a journal.
fn whole_before(bytes: &[u8]) -> Vec<Entry> {
    let mut entries = Vec::new();
    if let Ok(mut reader) = Reader::new(bytes, "a beginning".to_owned()) {
        while let Ok(Some(entry)) = reader.next_entry() {
            entries.push(entry);
        }
    }
    entries
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_link_that_dies_again_and_again_loses_nothing() {
    let (seed, times) = (seed(), repetitions(100));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], seed);
    let mut host = bench.receive(0, "trial", "--quiet");
    let mut the_box = bench.start(&relay, "sent.bin");
    bench.wait_for_poses("trial", 30);
    let mut dead = Duration::ZERO;
    for time in 1..=times {
        sleep(random_ms(&mut random, 100..1_500));
        let lasts = random_ms(&mut random, 50..4_000);
        relay.set(0, Faults::cut());
        sleep(lasts);
        relay.set(0, Faults::default());
        dead += lasts;
        if time.is_multiple_of(10) {
            println!("{time} of {times}: dead for {:.0} s so far", dead.as_secs_f64());
        }
    }
    wait_for("what was missed", || {
        bench.recorded("trial").len() + 60 > bench.sent("sent.bin").len()
    });
    the_box.end();
    let last = bench.sent("sent.bin").len();
    wait_for("all poses", || bench.recorded("trial").len() >= last);
    host.interrupt();
    let said = host.succeeds();
    assert_eq!(assert_whole(&bench, "trial", "sent.bin"), last);
    let packets = bench.manifest("trial").packets.unwrap();
    let wrong = packets.lost + packets.repeated + packets.implausible + packets.conflicting;
    assert_eq!((packets.frames as usize, wrong, packets.sessions), (last, 0, 1), "{said}");
    evidence(
        "the link between box and host dead at random, for 0.05 to 4 s, during one recording",
        &format!("{times} times, {:.0} s in all, {last} poses", dead.as_secs_f64()),
        "every pose is in the trial, once and as sent; none said to be lost",
    );
}

/// A small file system in memory, gone with this.
struct SmallDisk(PathBuf);

impl SmallDisk {
    /// `None`, with the test recorded as skipped, where this user may not mount one.
    fn new(place: PathBuf, kilobytes: u64) -> Option<Self> {
        fs::create_dir_all(&place).unwrap();
        let size = format!("size={kilobytes}k");
        let flags = MsFlags::MS_NOSUID | MsFlags::MS_NODEV;
        match mount(Some("tmpfs"), &place, Some("tmpfs"), flags, Some(size.as_str())) {
            Ok(()) => Some(Self(place)),
            Err(Errno::EPERM) => {
                skip(Absent::Machine, "only root may mount a small disk");
                None
            }
            Err(error) => panic!("{}: {error}", place.display()),
        }
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = umount2(&self.0, MntFlags::MNT_DETACH);
    }
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_disk_that_is_full_ends_a_recording_with_all_that_there_was_room_for() {
    let (seed, times) = (seed(), repetitions(20));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let Some(bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts[..1], seed);
    let mut the_box = bench.start(&relay, "sent.bin");
    wait_for("an announcement", || relay.the_box().is_some());
    let (mut trials, mut all) = (Vec::new(), 0);
    for time in 0..times {
        let kilobytes = random.random_range(32..320);
        let Some(disk) = SmallDisk::new(bench.path("small"), kilobytes) else { return };
        let mut host = bench.host(0, "receive --anyway --quiet --out small/trial");
        let (code, said) = host.ends();
        let recorded = bench.recorded("small/trial");
        let last = said.trim().lines().last().unwrap_or_default();
        println!("disk {time}, {kilobytes} KB: {} poses: {last}", recorded.len());
        assert!(code == Some(2) && said.to_lowercase().contains("no space"), "{code:?} {said}");
        assert!(is_without_holes(&recorded), "a hole");
        let folder = bench.path("small/trial");
        if folder.join(names::MANIFEST).exists() {
            let trial = Trial::open(&folder).expect("it can be opened");
            assert_eq!(trial.frames.len(), recorded.len());
        }
        all += recorded.len();
        trials.push(recorded);
        drop(disk);
    }
    the_box.end();
    let sent = bench.sent("sent.bin");
    trials.iter().for_each(|recorded| assert_sent(recorded, &sent));
    assert!(all > 0, "nothing was recorded");
    evidence(
        "`plumb receive` onto a disk (tmpfs) of 32 to 320 KB, until it is full",
        &format!("{times} disks"),
        &format!("each said so, and is readable until then: {all} poses without a hole, as sent"),
    );
}

/// The library by others that tells a program another time; `None`, with the test recorded as skipped,
/// where it is not installed.
fn false_time() -> Option<PathBuf> {
    let places = fs::read_dir("/usr/lib").unwrap().filter_map(|it| Some(it.ok()?.path()));
    let found = places.map(|it| it.join("faketime/libfaketimeMT.so.1")).find(|it| it.exists());
    if found.is_none() {
        skip(Absent::Tool, "there is no libfaketimeMT.so.1 (Debian: faketime)");
    }
    found
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_host_whose_clock_jumps_records_as_any_other() {
    // Long enough for some figures.
    let (seed, times) = (seed(), repetitions(200).max(60));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let Some(library) = false_time() else { return };
    let Some(mut bench) = Bench::new() else { return };
    let relay = Relay::new(&bench.hosts, seed);
    let offset = bench.path("offset");
    // A third of a century ago.
    fs::write(&offset, "-1000000000").unwrap();
    let words = |text: &str| OsString::from(text);
    bench.environment = vec![
        ("LD_PRELOAD", library.into()),
        ("FAKETIME_TIMESTAMP_FILE", offset.clone().into()),
        ("FAKETIME_NO_CACHE", words("1")),
        // The clock since the start cannot be set.
        ("DONT_FAKE_MONOTONIC", words("1")),
        ("FAKETIME_DONT_FAKE_MONOTONIC", words("1")),
    ];
    let mut jumping = bench.receive(0, "jumping", "--quiet");
    bench.environment.clear();
    let mut steady = bench.receive(1, "steady", "--quiet");
    let mut the_box = bench.start(&relay, "sent.bin");
    for trial in ["jumping", "steady"] {
        bench.wait_for_poses(trial, 10);
    }
    for _ in 0..times {
        sleep(random_ms(&mut random, 20..120));
        let seconds: i64 = random.random_range(-1_500_000_000..1_500_000_000);
        let next = bench.path("offset.new");
        fs::write(&next, format!("{seconds:+}")).unwrap();
        fs::rename(next, &offset).unwrap();
    }
    the_box.end();
    let last = bench.sent("sent.bin").len();
    wait_for("all poses", || {
        ["jumping", "steady"].iter().all(|it| bench.recorded(it).len() >= last)
    });
    for host in [&mut jumping, &mut steady] {
        host.interrupt();
        host.succeeds();
    }
    let [jumped, not] = ["jumping", "steady"].map(|trial| bench.manifest(trial).started);
    assert_ne!(jumped[..4], not[..4], "nobody has changed its clock");
    let times_ns: Vec<u64> = bench.entries("jumping").iter().map(|it| it.host_ns).collect();
    assert!(times_ns.is_sorted(), "the recording's own time jumps");
    for trial in ["jumping", "steady"] {
        assert_eq!(assert_whole(&bench, trial, "sent.bin"), last);
        let packets = bench.manifest(trial).packets.unwrap();
        assert_eq!((packets.lost, packets.repeated, packets.sessions), (0, 0, 1), "{trial}");
    }
    let seconds = last / 60 - 1;
    assert_eq!(bench.figures("jumping", seconds), bench.figures("steady", seconds));
    evidence(
        "the clock of the host's `plumb receive` set at random, by up to 47 years (libfaketime)",
        &format!("{times} times, in {last} poses"),
        "the trial and its figures are those of a host beside it whose clock is not set, bit by bit",
    );
}
