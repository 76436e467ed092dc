//! A configuration that comes over the network, to a box that nobody can log in to.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::thread::sleep;
use std::time::Instant;

use plumbline::config::Config;
use plumbline::packet::{Action, Hello, LinkKind, Message};
use plumbline::seal::KEY_FILE_NAME;
use plumbline_stream::link::BoxLink;
use plumbline_stream::transport::{KnownBox, Link, Udp};
use plumbline_test_support::seed;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::machine::{HOST, Host, Machine, PATIENCE};
use crate::scene::{self, file_on, files_on};

/// The host's own end of a link, and what the box calls it.
pub fn link() -> (BoxLink, SocketAddr) {
    let udp = Udp::bind((Ipv4Addr::LOCALHOST, 0).into()).expect("a free port");
    let port = udp.local_address().expect("it is bound").port();
    let link = Link::new(udp, vec![known_box()], "boot test");
    (BoxLink::new(Box::new(link), "the box".to_owned(), LinkKind::Udp), (HOST, port).into())
}

/// The tests' boxes as a host knows them.
pub fn known_box() -> KnownBox {
    KnownBox { name: "boot test".into(), key: scene::key(), address: None }
}

/// Who the box is, once it says so by itself: it may be starting.
pub fn hello(link: &mut BoxLink) -> Hello {
    let hello = link.messages(Instant::now() + PATIENCE, |message| match message {
        Message::Hello(hello) => Some(hello.clone()),
        _ => None,
    });
    hello.expect("the link works").expect("a Hello in time")
}

/// The configuration on a disk, as a box finds it at its next start.
pub fn on_disk(disk: &str) -> Vec<u8> {
    let whole = |name: &str| file_on(disk, name).filter(|blob| Config::decode(blob).is_ok());
    whole("config.plb").or_else(|| whole("config.new")).expect("a whole configuration")
}

/// A computer with a card or a disk, and a switch.
pub trait Computer: Send {
    fn switch_on(&mut self);
    fn cut_power(&mut self);
    /// Its card as mtools take it.
    fn disk(&self) -> String;
}

/// Two configurations that differ in length, so that half of one and half of the other is none.
pub fn two_of(config: &Config) -> [Config; 2] {
    ["one", "another, longer one"].map(|device| {
        let mut config = config.clone();
        config.device = device.try_into().expect("a short name");
        config
    })
}

/// More configurations than are stored before any power cut.
const STORED_MAX: usize = 200;

/// What was being done when the power was cut.
#[derive(Debug, Default)]
pub struct Cut {
    /// Configurations that were stored until then, in all.
    pub stored: usize,
    /// The cuts after which the journal of a file was still there.
    pub in_the_middle: usize,
}

/// Stores the configurations in turn and cuts the power at random moments, `cuts` times: each
/// time one of them must be there whole, and the computer must start with it in the end.
/// `computer` starts with the first of them.
pub fn assert_power_cuts_leave_one(
    computer: &mut impl Computer,
    link: &mut BoxLink,
    configs: &[Config; 2],
    cuts: usize,
) -> Cut {
    let mut random = ChaCha8Rng::seed_from_u64(seed());
    let mut seen = Cut::default();
    for cut in 1..=cuts {
        computer.switch_on();
        let met = hello(link);
        // Stored one after the other without a pause, until the power goes.
        let mut turns = (0..STORED_MAX).map(|turn| {
            link.store_config(Some(&met), &configs[turn % 2]).map_err(|error| error.to_string())
        });
        // The clock starts with the second: how long the first one takes says how long to wait.
        let begun = Instant::now();
        turns.next().expect("there is a first").expect("the power is on");
        let moment = begun.elapsed().mul_f64(random.random_range(0.0..3.0));
        let more = std::thread::scope(|scope| {
            scope.spawn(|| {
                sleep(moment);
                computer.cut_power();
            });
            turns.take_while(Result::is_ok).count()
        });
        assert!(more < STORED_MAX - 1, "the power was never cut");
        println!("cut {cut} {moment:?} after the first was stored: {more} more stored");
        seen.stored += 1 + more;
        let has_journal = files_on(&computer.disk()).iter().any(|name| name == "config.new");
        seen.in_the_middle += usize::from(has_journal);
        let found = on_disk(&computer.disk());
        assert!(configs.iter().any(|config| scene::blob(config) == found), "half a configuration");
    }
    // And the box still starts, with one of them, in one file.
    computer.switch_on();
    link.wait_until_heard_within(PATIENCE).unwrap();
    let config = link.config().unwrap();
    assert!(configs.contains(&config));
    let files = files_on(&computer.disk());
    assert!(!files.iter().any(|name| name == "config.new"), "{files:?}");
    assert_eq!(file_on(&computer.disk(), KEY_FILE_NAME), Some(scene::key_file(&scene::key())));
    computer.cut_power();
    seen
}

/// QEMU's own board.
struct Virt {
    host: Host,
    disk: PathBuf,
    disk_options: &'static str,
    machine: Option<Machine>,
}

impl Computer for Virt {
    fn switch_on(&mut self) {
        let machine = crate::boot_with_disk(&self.host, &self.disk, self.disk_options, "");
        self.machine = Some(machine);
    }

    fn cut_power(&mut self) {
        self.machine = None;
    }

    fn disk(&self) -> String {
        self.disk.to_str().expect("a plain path").to_owned()
    }
}

#[test]
fn a_power_cut_while_a_configuration_is_stored_leaves_the_old_or_the_new_one() {
    let cut = power_cuts(4, "");
    println!("{cut:?}");
}

/// Cuts the power of QEMU's own board this many times while configurations are stored on a disk with
/// these options of QEMU's.
pub fn power_cuts(cuts: usize, disk_options: &'static str) -> Cut {
    let directory = tempfile::tempdir().unwrap();
    let (mut link, address) = link();
    let configs = two_of(&scene::config(address));
    let disk = scene::boot_disk(directory.path(), &scene::blob(&configs[0]));
    let mut computer = Virt { host: Host::new(), disk, disk_options, machine: None };
    assert_power_cuts_leave_one(&mut computer, &mut link, &configs, cuts)
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
    let machine = crate::boot_with_camera(&host, &disk, &options);
    let heard = link.wait_until_heard_within(PATIENCE).unwrap();
    println!("{heard:?}");
    assert_eq!(link.store_config(None, &config).unwrap().1, config.crc());
    link.request(Action::Reboot, "to restart").unwrap();
    let hello = hello(&mut link);
    assert_eq!((hello.device.as_str(), hello.config_crc), ("boot test", config.crc()));
    assert_eq!(link.config().unwrap(), config);
    drop(machine);
}
