//! A card without room for a new configuration, and one that takes seconds to write.

use std::path::Path;
use std::time::Instant;

use plumbline::config::Config;
use plumbline::packet::PosePacket;
use plumbline_test_support::evidence;

use crate::machine::{Host, PATIENCE, is_measured, poses};
use crate::provisioning::{self, hello, on_disk, two_of};
use crate::scene::{self, run};

/// Bytes of a cluster of the tests' disks, in which FAT gives out room.
const CLUSTER_BYTES: usize = 2048;

/// The number of bytes that are free on a disk.
fn free_bytes(disk: &str) -> usize {
    let listing = run("mdir", &["-i", disk]);
    let line = listing.lines().find(|line| line.contains("bytes free")).expect("mdir says so");
    let digits: String = line.chars().filter(char::is_ascii_digit).collect();
    digits.parse().expect("a number")
}

/// Fills a disk but for this many clusters.
fn fill(disk: &Path, clusters: usize) {
    let name = disk.to_str().expect("a plain path");
    let bytes = free_bytes(name) - clusters * CLUSTER_BYTES;
    scene::copy(disk, 0, "fill", &vec![0; bytes]);
    assert_eq!(free_bytes(name), clusters * CLUSTER_BYTES);
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_full_card_keeps_what_is_stored_and_says_so() {
    let mut refused = 0;
    let rooms = [0, 1, 2, 8];
    for clusters in rooms {
        let directory = tempfile::tempdir().unwrap();
        let (mut link, address) = provisioning::link();
        let [old, new] = two_of(&scene::config(address));
        let disk = scene::boot_disk(directory.path(), &scene::blob(&old));
        fill(&disk, clusters);
        let host = Host::new();
        let machine = crate::boot_with_camera(&host, &disk, "");
        let met = hello(&mut link);
        let stored = store(&mut link, &met, &new);
        println!("{clusters} clusters free: {stored:?}");
        let expected = match &stored {
            Ok(_) => &new,
            Err(why) => {
                refused += 1;
                assert!(why.contains("No space left") && why.contains("still is"), "{why}");
                &old
            }
        };
        // It goes on as if nothing had happened.
        link.wait_until_heard_within(PATIENCE).unwrap();
        assert_eq!(hello(&mut link).boot_id, met.boot_id, "it has started again");
        drop(machine);
        let found = on_disk(disk.to_str().expect("a plain path"));
        assert!(found == scene::blob(expected), "another configuration is on the disk");
    }
    assert!(refused > 0, "there was always room");
    evidence(
        "a configuration for a full card (booted box), with room for 0 to 8 clusters",
        &format!("{} cards", rooms.len()),
        &format!("{refused} refused with the reason; the old or the new one whole on each"),
    );
}

#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_slow_card_delays_nothing_but_what_is_stored() {
    let mut seconds = Vec::new();
    let rates = [20, 5, 2, 1];
    for writes_per_s in rates {
        let directory = tempfile::tempdir().unwrap();
        let (mut link, address) = provisioning::link();
        let [old, new] = two_of(&scene::config(address));
        let disk = scene::boot_disk(directory.path(), &scene::blob(&old));
        let host = Host::new();
        let options = format!("throttling.iops-write={writes_per_s}");
        let machine = crate::boot_with_disk(&host, &disk, &options, "");
        let met = hello(&mut link);
        let begun = Instant::now();
        let stored = store(&mut link, &met, &new);
        let took_s = begun.elapsed().as_secs_f64();
        println!("{writes_per_s} writes a second: stored after {took_s:.1} s: {stored:?}");
        assert_eq!(stored, Ok(new.crc()), "{writes_per_s} writes a second");
        seconds.push(format!("{took_s:.1} s"));
        // The same start, and it measures.
        let now = hello(&mut link);
        assert_eq!(now.boot_id, met.boot_id, "the box has started again meanwhile");
        // The link is another host's: this one listens on the serial line.
        let sequence = |pose: &PosePacket| pose.sequence;
        let before = machine.look(|seen| poses(&seen.serial).map(sequence).max());
        machine.wait_for("poses afterwards", |seen| {
            let mut measured = poses(&seen.serial).filter(|pose| is_measured(pose));
            measured.any(|pose| Some(pose.sequence) > before).then_some(())
        });
        drop(machine);
        let found = on_disk(disk.to_str().expect("a plain path"));
        assert!(found == scene::blob(&new), "another configuration is on the disk");
    }
    evidence(
        &format!("a configuration for a card that takes {rates:?} writes a second (booted box)"),
        &format!("{} cards", rates.len()),
        &format!("stored after {}; the box goes on in the same start", seconds.join(", ")),
    );
}

/// Stores it; the checksum of what is stored, or why it is not.
fn store(
    link: &mut plumbline_stream::link::BoxLink,
    met: &plumbline::packet::Hello,
    config: &Config,
) -> Result<u32, String> {
    link.store_config(Some(met), config).map(|(_, crc)| crc).map_err(|error| error.to_string())
}
