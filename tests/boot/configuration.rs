//! A configuration that cannot be used: refused by its name, said on the console and, to hosts with
//! the box's key, on the links of the kernel's command line; and nothing is tracked.

use crc::{CRC_32_ISO_HDLC, Crc};
use plumbline::seal::{BoxState, Key};

use crate::machine::{Host, logs, poses};
use crate::scene;

/// Boots with this blob; the box must complain with these words.
fn assert_refused(blob: &[u8], words: &str) {
    let host = Host::new();
    let directory = tempfile::tempdir().unwrap();
    let disk = scene::boot_disk(directory.path(), blob);
    let options = format!("plumbline.udp={} plumbline.serial=/dev/ttyS0:115200", host.address());
    let machine = crate::boot_with_camera(&host, &disk, &options);
    // It goes on saying so.
    let twice = |text: &str| text.matches("configuration refused").count() >= 2;
    machine.wait_for("the refusal on both links", |seen| {
        (twice(&logs(&seen.udp)) && twice(&logs(&seen.serial))).then_some(())
    });
    machine.look(|seen| {
        for (place, text) in
            [("console", &seen.console), ("UDP", &logs(&seen.udp)), ("serial", &logs(&seen.serial))]
        {
            assert!(text.contains(words), "{place} does not say {words:?}: {text}");
        }
        assert_eq!(poses(&seen.udp).chain(poses(&seen.serial)).count(), 0, "it tracks");
    });
}

#[test]
fn a_refused_box_says_why_to_hosts_with_its_key_alone() {
    let host = Host::with_key(Key::new([8; 32]).unwrap());
    let directory = tempfile::tempdir().unwrap();
    let mut blob = sound();
    blob[30] ^= 1;
    let disk = scene::boot_disk(directory.path(), &blob);
    let options = format!("plumbline.udp={} plumbline.serial=/dev/ttyS0:115200", host.address());
    let machine = crate::boot_with_camera(&host, &disk, &options);
    machine.wait_for("the refusal on the console, and announcements", |seen| {
        let said = seen.console.contains("configuration refused");
        let announced = [&seen.udp_packets, &seen.serial_packets]
            .iter()
            .all(|packets| packets.announcements().count() >= 8);
        (said && announced).then_some(())
    });
    machine.look(|seen| {
        assert!(seen.udp.is_empty() && seen.serial.is_empty(), "it is heard with another key");
        for packets in [&seen.udp_packets, &seen.serial_packets] {
            assert!(packets.are_announcements());
            for announcement in packets.announcements() {
                assert_eq!(announcement.key_id, Some(scene::key().id()));
                assert_eq!(announcement.state, BoxState::Refusing);
                assert_eq!(announcement.text, "");
            }
        }
    });
}

fn sound() -> Vec<u8> {
    scene::blob(&scene::config(Host::new().address()))
}

#[test]
fn a_configuration_with_a_flipped_bit_is_refused() {
    let mut blob = sound();
    let middle = blob.len() / 2;
    blob[middle] ^= 0x10;
    assert_refused(&blob, "checksum");
}

#[test]
fn a_field_out_of_range_is_named() {
    let mut blob = sound();
    // No tool writes such a blob, so the rate is changed in the bytes, and the checksum after it.
    let rate = (scene::RATE_HZ as f32).to_le_bytes();
    let at = blob.windows(4).rposition(|bytes| bytes == rate).expect("the rate is in the blob");
    blob[at..at + 4].copy_from_slice(&50_000_f32.to_le_bytes());
    let covered = blob.len() - 4;
    let checksum = Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&blob[..covered]);
    blob[covered..].copy_from_slice(&checksum.to_le_bytes());
    assert_refused(&blob, "capture.rate_hz");
}
