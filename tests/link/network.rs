//! Three computers with addresses of their own, and the cables between them, inside this one: each is
//! a network namespace of the kernel, which ends with its test. No packet leaves them, and the
//! network of this computer stays as it is.
//!
//! ```text
//! the host 198.18.0.2 ──── 198.18.0.1 the stranger 198.18.0.5 ──── 198.18.0.6 the box
//! ```
//!
//! The addresses are of the block that is set aside for tests of networks (RFC 2544). All that host
//! and box say to each other goes through the stranger, who can do more than anybody else in their
//! network: see each packet whole, and send packets under any address.

use std::fs::File;
use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use nix::errno::Errno;
use nix::sched::{CloneFlags, setns, unshare};
use nix::sys::socket::{
    AddressFamily, MsgFlags, SockFlag, SockProtocol, SockType, SockaddrIn, recv, sendto, socket,
};
use plumbline_test_support::{Absent, is_emulated, skip};

pub const HOST: Ipv4Addr = Ipv4Addr::new(198, 18, 0, 2);
pub const THE_BOX: Ipv4Addr = Ipv4Addr::new(198, 18, 0, 6);

/// The stranger, as the host has it for a neighbour, and the box.
pub const STRANGER: Ipv4Addr = Ipv4Addr::new(198, 18, 0, 1);
const STRANGER_AT_BOX: Ipv4Addr = Ipv4Addr::new(198, 18, 0, 5);

/// The bytes of the two heads in front of what a datagram says.
const IP_BYTES: usize = 20;
const UDP_BYTES: usize = 8;

/// Packets that are kept at most: some minutes of a box.
const PACKETS_MAX: usize = 100_000;

/// One of the computers.
pub struct Computer {
    namespace: File,
}

impl Computer {
    /// A computer without cables.
    fn new() -> Result<Self, Errno> {
        // A thread can leave the network of its program alone.
        let made = std::thread::spawn(|| {
            unshare(CloneFlags::CLONE_NEWNET)?;
            Ok(File::open("/proc/thread-self/ns/net").expect("a thread has a network"))
        });
        Ok(Self { namespace: made.join().expect("it does not panic")? })
    }

    /// Does something on this computer; programs and threads that it starts are on it too.
    pub fn enter<T: Send>(&self, body: impl FnOnce() -> T + Send) -> T {
        let name = std::thread::current().name().unwrap_or_default().to_owned();
        std::thread::scope(|scope| {
            let inside = std::thread::Builder::new().name(name).spawn_scoped(scope, || {
                setns(&self.namespace, CloneFlags::CLONE_NEWNET).unwrap();
                body()
            });
            match inside.unwrap().join() {
                Ok(done) => done,
                Err(panic) => std::panic::resume_unwind(panic),
            }
        })
    }

    /// Its name for `ip`.
    fn name(&self) -> String {
        format!("/proc/{}/fd/{}", std::process::id(), self.namespace.as_raw_fd())
    }
}

/// The three of them.
pub struct Network {
    pub host: Computer,
    pub stranger: Computer,
    pub the_box: Computer,
}

impl Network {
    /// `None`, with the test recorded as skipped, where this computer has not what it takes.
    pub fn new() -> Option<Self> {
        if is_emulated() {
            skip(Absent::Emulator, "an emulator of programs has no networks of its own");
            return None;
        }
        match Command::new("ip").arg("-V").output() {
            Err(error) if error.kind() == ErrorKind::NotFound => {
                skip(Absent::Tool, "there is no program `ip` (iproute2), which lays cables");
                return None;
            }
            version => assert!(version.unwrap().status.success()),
        }
        let computer = || match Computer::new() {
            Err(Errno::EPERM | Errno::ENOSYS | Errno::EINVAL) => None,
            made => Some(made.unwrap()),
        };
        let (Some(host), Some(stranger), Some(the_box)) = (computer(), computer(), computer())
        else {
            skip(Absent::Machine, "only root may make a network namespace here");
            return None;
        };
        let network = Self { host, stranger, the_box };
        network.connect();
        Some(network)
    }

    fn connect(&self) {
        let [host, the_box] = [&self.host, &self.the_box].map(Computer::name);
        self.stranger.enter(|| {
            for (cable, other, address) in
                [("to-host", host, STRANGER), ("to-box", the_box, STRANGER_AT_BOX)]
            {
                ip(&format!("link add name {cable} type veth peer name cable netns {other}"));
                ip(&format!("addr add {address}/30 dev {cable}"));
                ip(&format!("link set {cable} up"));
            }
            std::fs::write("/proc/sys/net/ipv4/ip_forward", "1").unwrap();
        });
        for (computer, address, gateway) in
            [(&self.host, HOST, STRANGER), (&self.the_box, THE_BOX, STRANGER_AT_BOX)]
        {
            computer.enter(|| {
                ip("link set lo up");
                ip(&format!("addr add {address}/30 dev cable"));
                ip("link set cable up");
                ip(&format!("route add default via {gateway}"));
            });
        }
    }
}

#[track_caller]
fn ip(arguments: &str) {
    let output = Command::new("ip").args(arguments.split(' ')).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "ip {arguments}: {said}");
}

/// A datagram as it is on the cable, with all of its heads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Datagram {
    pub from: SocketAddrV4,
    pub to: SocketAddrV4,
    pub bytes: Vec<u8>,
}

impl Datagram {
    /// The datagram in an IP packet; `None` if it is of another kind.
    fn parse(packet: &[u8]) -> Option<Self> {
        let (head, rest) = packet.split_at_checked(IP_BYTES)?;
        // Version 4 without options, and UDP.
        if head[0] != 0x45 || head[9] != 17 {
            return None;
        }
        let address = |at: usize| Ipv4Addr::from(<[u8; 4]>::try_from(&head[at..at + 4]).unwrap());
        let number = |at: usize| u16::from_be_bytes([rest[at], rest[at + 1]]);
        let bytes = rest.get(UDP_BYTES..usize::from(number(4)))?.to_vec();
        let from = SocketAddrV4::new(address(12), number(0));
        let to = SocketAddrV4::new(address(16), number(2));
        Some(Self { from, to, bytes })
    }

    fn packet(&self) -> Vec<u8> {
        // The kernel puts in the length of the whole, and the checksum of the first head.
        let mut packet = vec![0x45, 0, 0, 0, 0, 0, 0, 0, 64, 17, 0, 0];
        packet.extend(self.from.ip().octets());
        packet.extend(self.to.ip().octets());
        let length = (UDP_BYTES + self.bytes.len()) as u16;
        for number in [self.from.port(), self.to.port(), length, 0] {
            // Without a checksum of its own, as UDP allows.
            packet.extend(number.to_be_bytes());
        }
        packet.extend(&self.bytes);
        packet
    }
}

/// Sends datagrams under any address.
pub struct Forger(OwnedFd);

impl Forger {
    /// Of the computer on which it is made.
    pub fn new() -> Self {
        let flags = SockFlag::SOCK_CLOEXEC;
        Self(socket(AddressFamily::Inet, SockType::Raw, flags, SockProtocol::Raw).unwrap())
    }

    pub fn send(&self, datagram: &Datagram) {
        let to = SockaddrIn::from(datagram.to);
        let packet = datagram.packet();
        let sent = sendto(self.0.as_raw_fd(), &packet, &to, MsgFlags::empty());
        assert_eq!(sent, Ok(packet.len()));
    }
}

/// Sees all datagrams that come to a computer, whomever they are for.
pub struct Listener {
    seen: Arc<Mutex<Vec<Datagram>>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Listener {
    /// On the computer on which it is made.
    pub fn new() -> Self {
        // Without the heads of the cable.
        let (kind, flags) = (SockType::Datagram, SockFlag::SOCK_CLOEXEC);
        let cable = socket(AddressFamily::Packet, kind, flags, SockProtocol::EthIp).unwrap();
        let (seen, is_over) = (Arc::default(), Arc::new(AtomicBool::new(false)));
        let (into, over) = (Arc::clone(&seen), Arc::clone(&is_over));
        let thread = std::thread::spawn(move || listen(&cable, &into, &over));
        Self { seen, is_over, thread: Some(thread) }
    }

    pub fn seen(&self) -> Vec<Datagram> {
        self.seen.lock().unwrap().clone()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        let thread = self.thread.take();
        assert!(thread.is_some_and(|it| it.join().is_ok()) || std::thread::panicking());
    }
}

fn listen(cable: &OwnedFd, into: &Mutex<Vec<Datagram>>, is_over: &AtomicBool) {
    let mut buffer = [0; 2048];
    while !is_over.load(Ordering::Relaxed) {
        match recv(cable.as_raw_fd(), &mut buffer, MsgFlags::MSG_DONTWAIT) {
            Ok(length) => {
                let mut seen = into.lock().unwrap();
                if seen.len() < PACKETS_MAX {
                    seen.extend(Datagram::parse(&buffer[..length]));
                }
            }
            Err(Errno::EAGAIN) => std::thread::sleep(Duration::from_millis(1)),
            Err(error) => panic!("{error}"),
        }
    }
}
