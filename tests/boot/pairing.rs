//! A box without a key, which gets one over its serial cable.

use plumbline::packet::ResetReason;
use plumbline::seal::{BoxState, KEY_FILE_NAME, Paired, Pairing, SEALED_BYTES_MAX};

use crate::machine::{Host, Packets, Seen, is_measured, poses};
use crate::scene::{self, file_on};

/// The longest time in which a box that tracks has measured something, of its announcements over
/// UDP: four a second.
const ANNOUNCEMENTS: usize = 20;

fn poses_on_both(seen: &Seen) -> Option<()> {
    let has_poses = |messages| poses(messages).filter(|pose| is_measured(pose)).count() >= 10;
    (has_poses(&seen.udp) && has_poses(&seen.serial)).then_some(())
}

fn sealed(packets: &Packets) -> usize {
    packets.all.len() - packets.announcements().count()
}

#[test]
fn a_box_without_a_key_only_says_that_it_is_there_until_one_comes_over_its_cable() {
    let host = Host::new();
    let directory = tempfile::tempdir().unwrap();
    let config = scene::config(host.address());
    let disk = scene::unpaired_disk(directory.path(), &scene::blob(&config));
    let machine = crate::boot_with_camera(&host, &disk, "");
    machine.wait_for("announcements on both links", |seen| {
        let announced = |packets: &Packets, count| packets.announcements().count() >= count;
        let on_both = announced(&seen.udp_packets, ANNOUNCEMENTS)
            && announced(&seen.serial_packets, ANNOUNCEMENTS / 4);
        (on_both && seen.console.contains("self-test passed")).then_some(())
    });
    machine.look(|seen| {
        assert!(seen.udp.is_empty() && seen.serial.is_empty());
        for packets in [&seen.udp_packets, &seen.serial_packets] {
            assert!(packets.are_announcements(), "{} others", sealed(packets));
            for announcement in packets.announcements() {
                assert_eq!((announcement.state, announcement.key_id), (BoxState::Unpaired, None));
                assert_eq!(announcement.pairing_s, 255);
                assert_eq!(announcement.text, "boot test has no key");
            }
        }
    });

    let key = scene::key();
    machine.say_on_line(Pairing { key: key.clone() }.packet(&mut [0; SEALED_BYTES_MAX]));
    let paired = machine.wait_for("the answer to the key", |seen| {
        seen.serial_packets.all.iter().find_map(|packet| Paired::read(packet))
    });
    assert_eq!(paired, Paired { key_id: key.id(), is_stored: true });
    machine.wait_for("poses on both links", poses_on_both);
    machine.look(|seen| {
        let name = seen.hello().map(|hello| hello.device.as_str());
        assert_eq!(name, Some("boot test"));
        let last = seen.udp_packets.announcements().last().expect("there are some");
        assert_eq!((last.state, last.key_id), (BoxState::Ready, Some(key.id())));
        assert_eq!(last.text, "");
    });
    drop(machine);

    // It has kept the key, whatever happens to its power.
    let on_disk = file_on(disk.to_str().expect("a plain path"), KEY_FILE_NAME);
    assert_eq!(on_disk, Some(scene::key_file(&key)));
    let machine = crate::boot_with_camera(&host, &disk, "");
    machine.wait_for("poses after the next start", poses_on_both);
    machine.look(|seen| {
        let hello = seen.hello().expect("a Hello");
        assert_eq!(hello.reset_reason, ResetReason::PowerOn);
        assert!(seen.udp_packets.announcements().all(|it| it.key_id == Some(key.id())));
    });
}
