//! A configuration that comes over the network, to a box that nobody can log in to.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

use plumb::link::{BoxLink, LinkArguments};
use plumbline::config::Config;
use plumbline::packet::Action;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::machine::{HOST, Host, PATIENCE};
use crate::scene::{self, run};

/// The host's own end of a link, and what the box calls it.
fn link() -> (BoxLink, SocketAddr) {
    let any = UdpSocket::bind("127.0.0.1:0").expect("a free port");
    let port = any.local_addr().expect("it is bound").port();
    drop(any);
    let udp = Some((Ipv4Addr::LOCALHOST, port).into());
    let link = LinkArguments { udp, serial: None, baud: 115_200 }.open();
    (link.expect("the port is free"), (HOST, port).into())
}

/// The configuration on a disk, as a box finds it at its next start.
fn on_disk(disk: &Path, directory: &Path) -> Vec<u8> {
    let disk = disk.to_str().expect("a plain path");
    let listing = run("mdir", &["-b", "-i", disk]);
    let file = |name: &str| {
        let copy = directory.join("copy");
        let is_there = listing.to_lowercase().contains(&format!("::/{name}"));
        is_there.then(|| {
            run(
                "mcopy",
                &[
                    "-n",
                    "-o",
                    "-i",
                    disk,
                    &format!("::{name}"),
                    copy.to_str().expect("a plain path"),
                ],
            );
            std::fs::read(&copy).expect("it was copied")
        })
    };
    let whole = |name: &str| file(name).filter(|blob| Config::decode(blob).is_ok());
    whole("config.plb").or_else(|| whole("config.new")).expect("a whole configuration")
}

#[test]
fn a_power_cut_while_a_configuration_is_stored_leaves_the_old_or_the_new_one() {
    let seed = rand::random();
    println!("power cuts: seed {seed}");
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let directory = tempfile::tempdir().unwrap();
    let (mut link, address) = link();
    // They differ in length, so that half of one and half of the other is none.
    let configs = ["one", "another, longer one"].map(|device| {
        let mut config = scene::config(address);
        config.device = device.try_into().expect("a short name");
        config
    });
    let disk = scene::boot_disk(directory.path(), &scene::blob(&configs[0]));
    let host = Host::new();
    let mut stored = 0;
    for cut in 1..=4 {
        let machine = crate::boot_with_camera(&host, &disk, "overlay.cpio", "");
        let met = link.hello_within(PATIENCE).unwrap();
        // Stored one after the other without a pause, until the power goes.
        let moment = Duration::from_millis(random.random_range(300..1500));
        let cut_off = std::thread::spawn(move || {
            sleep(moment);
            drop(machine);
        });
        let storing = (0..200)
            .take_while(|turn| link.store_config(Some(&met), &configs[turn % 2]).is_ok())
            .count();
        cut_off.join().expect("no panic");
        stored += storing;
        println!("cut {cut} after {moment:?}: {storing} stored");
        let found = on_disk(&disk, directory.path());
        assert!(configs.iter().any(|config| scene::blob(config) == found), "half a configuration");
    }
    assert!(stored >= 4, "only {stored} were stored: the cuts came too early to say anything");
    // And the box still starts, with one of them, in one file.
    let _machine = crate::boot_with_camera(&host, &disk, "overlay.cpio", "");
    link.wait_until_heard_within(PATIENCE).unwrap();
    let config = link.config().unwrap();
    assert!(configs.contains(&config));
    assert!(
        !run("mdir", &["-b", "-i", disk.to_str().unwrap()]).to_lowercase().contains("config.new")
    );
}

#[test]
fn a_refused_box_takes_a_better_configuration_and_starts_with_it() {
    let directory = tempfile::tempdir().unwrap();
    let (mut link, address) = link();
    let config = scene::config(address);
    let mut damaged = scene::blob(&config);
    damaged[30] ^= 1;
    let disk = scene::boot_disk(directory.path(), &damaged);
    let options = format!("plumbline.udp={address}");
    let host = Host::new();
    let machine = crate::boot_with_camera(&host, &disk, "overlay.cpio", &options);
    let heard = link.wait_until_heard_within(PATIENCE).unwrap();
    println!("{heard:?}");
    assert_eq!(link.store_config(None, &config).unwrap().1, config.crc());
    link.request(Action::Reboot, "to start anew").unwrap();
    let hello = link.hello_within(PATIENCE).unwrap();
    assert_eq!((hello.device.as_str(), hello.config_crc), ("boot test", config.crc()));
    assert_eq!(link.config().unwrap(), config);
    drop(machine);
}
