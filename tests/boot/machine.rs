//! A computer that QEMU emulates, with the box's image in it: started, watched
//! over its console, its network and its serial line, and switched off.
//!
//! The guest's clock counts instructions, 2 ns each, so that what happens in it
//! does not depend on how busy this machine is: it takes longer here, and that is
//! all.

use std::io::{Read, Write};
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, Weak};
use std::thread;
use std::time::{Duration, Instant};

use plumbline::packet::{Health, Hello, Message, PacketError, PosePacket, frame_packet};
use plumbline::seal::{Announcement, Key, Peer, SEALED_FRAME_BYTES_MAX};
use plumbline_files::BadInput;
use plumbline_stream::transport::{
    Arrived, Carrier, Event, KnownBox, Line, Link, Serial, Transport as _, Udp, WAIT,
};

use crate::scene;

/// Everything that is waited for comes within this, on a machine that is busy with
/// other things, or never.
pub const PATIENCE: Duration = Duration::from_secs(240);

/// What QEMU makes a device tree of.
pub const VIRT: &str = "-machine virt -cpu cortex-a72 -smp 2 -m 512";

/// The guest's name of this machine.
pub const HOST: [u8; 4] = [10, 0, 2, 2];

/// Kernel, initramfs, overlays, SD card: `cargo xtask test boot` makes them.
pub fn image(name: &str) -> PathBuf {
    let directory = std::env::var_os("PLUMBLINE_IMAGES")
        .expect("PLUMBLINE_IMAGES names no directory: run this with `cargo xtask test boot`");
    Path::new(&directory).join(name)
}

/// What the machine is made of.
pub struct Parts<'a> {
    pub kernel: PathBuf,
    /// One after the other, as the kernel unpacks them.
    pub initramfs: Vec<PathBuf>,
    pub command_line: &'a str,
    pub boot_disk: &'a Path,
    /// How QEMU emulates that disk, beside what is usual: `throttling.iops-write=4`.
    pub boot_disk_options: &'a str,
    /// What vivid plays, where the test guest is in the initramfs.
    pub frames_disk: Option<&'a Path>,
    /// What the firmware hands over, where that is not QEMU's own. Such a machine is off after a reset:
    /// its firmware, which the test plays, is to start it.
    pub device_tree: Option<&'a Path>,
}

/// The network and the serial line as the box's host sees them, there before the machine is.
pub struct Host {
    socket: UdpSocket,
    key: Key,
}

impl Host {
    /// A host that has the key of the tests' boxes.
    pub fn new() -> Self {
        Self::with_key(scene::key())
    }

    /// A host that has this key alone.
    pub fn with_key(key: Key) -> Self {
        Self { socket: UdpSocket::bind("127.0.0.1:0").expect("a socket"), key }
    }

    /// Where the box is to announce itself.
    pub fn address(&self) -> SocketAddr {
        let port = self.socket.local_addr().expect("it is bound").port();
        (HOST, port).into()
    }
}

/// All that has come out of the machine.
#[derive(Default)]
pub struct Seen {
    pub console: String,
    /// What was opened of that which came over UDP, as from a box with the host's key.
    pub udp: Vec<Message>,
    pub serial: Vec<Message>,
    /// The packets themselves.
    pub udp_packets: Packets,
    pub serial_packets: Packets,
}

/// The packets of a link, as they are on their way.
#[derive(Default, Clone)]
pub struct Packets {
    pub all: Vec<Vec<u8>>,
    /// The number of those that were not the box's, or had come before.
    pub not_authentic: usize,
    /// What was wrong with the datagrams, or frames on the serial line, that were no packets.
    pub damaged: Vec<PacketError>,
}

impl Packets {
    /// What the box says of itself in clear.
    pub fn announcements(&self) -> impl Iterator<Item = Announcement> {
        self.all.iter().filter_map(|packet| Announcement::parse(packet))
    }

    /// Whether the box says nothing but who it is.
    pub fn are_announcements(&self) -> bool {
        self.announcements().count() == self.all.len()
    }

    /// Whether these words can be read in one of them.
    pub fn show(&self, words: &str) -> bool {
        let shows = |packet: &Vec<u8>| packet.windows(words.len()).any(|it| it == words.as_bytes());
        self.all.iter().any(shows)
    }
}

/// One of the ways out of the machine.
#[derive(Debug, Clone, Copy)]
pub enum Way {
    Udp,
    Serial,
}

impl Way {
    fn of(self, seen: &mut Seen) -> (&mut Vec<Message>, &mut Packets) {
        match self {
            Self::Udp => (&mut seen.udp, &mut seen.udp_packets),
            Self::Serial => (&mut seen.serial, &mut seen.serial_packets),
        }
    }
}

impl Seen {
    pub fn hello(&self) -> Option<&Hello> {
        self.udp.iter().rev().find_map(|message| match message {
            Message::Hello(hello) => Some(hello),
            _ => None,
        })
    }

    pub fn health(&self) -> Option<&Health> {
        healths(&self.udp).last()
    }
}

pub fn poses(messages: &[Message]) -> impl Iterator<Item = &PosePacket> {
    messages.iter().filter_map(|message| match message {
        Message::Pose(pose) => Some(pose),
        _ => None,
    })
}

pub fn healths(messages: &[Message]) -> impl Iterator<Item = &Health> {
    messages.iter().filter_map(|message| match message {
        Message::Health(health) => Some(health),
        _ => None,
    })
}

/// The texts of all Log packets, joined.
pub fn logs(messages: &[Message]) -> String {
    let texts = messages.iter().filter_map(|message| match message {
        Message::Log(log) => Some(log.text.as_str()),
        _ => None,
    });
    texts.collect::<Vec<_>>().join(" ")
}

/// The messages with the poses in the order of their frames: what the box has sent before it was
/// heard comes between what it sends now.
pub fn in_order(messages: &[Message]) -> Vec<Message> {
    let mut messages = messages.to_vec();
    messages.sort_by_key(|message| match message {
        Message::Pose(pose) => pose.sequence,
        _ => 0,
    });
    messages
}

/// Every target was measured.
pub fn is_measured(pose: &PosePacket) -> bool {
    pose.targets.iter().all(|target| target.pose.is_ok())
}

/// The machine, switched on; dropping it pulls its plug.
pub struct Machine {
    child: Child,
    seen: Arc<Mutex<Seen>>,
    /// The host's end of the serial line.
    line: UnixStream,
    /// Of the initramfs, of the serial line.
    _directory: tempfile::TempDir,
}

impl Machine {
    pub fn start(parts: &Parts, host: &Host) -> Self {
        let directory = tempfile::tempdir().expect("a temporary directory");
        let initramfs = directory.path().join("initramfs");
        let archives: Vec<u8> = parts.initramfs.iter().flat_map(|path| read(path)).collect();
        std::fs::write(&initramfs, archives).expect("the initramfs is written");
        let line = directory.path().join("line");

        let mut command = Command::new("qemu-system-aarch64");
        command.args(VIRT.split(' ')).arg("-nodefaults");
        command.args("-icount shift=1,sleep=on -display none -serial stdio".split(' '));
        command.arg("-kernel").arg(&parts.kernel).arg("-initrd").arg(&initramfs);
        command
            .arg("-append")
            .arg(format!("console=ttyAMA0 quiet cryptomgr.notests {}", parts.command_line));
        if let Some(tree) = parts.device_tree {
            command.arg("-no-reboot").arg("-dtb").arg(tree);
        }
        let disks = [
            ("boot", Some(parts.boot_disk), parts.boot_disk_options),
            ("frames", parts.frames_disk, "readonly=on"),
        ];
        for (name, path, options) in disks {
            let Some(path) = path else { continue };
            let comma = if options.is_empty() { "" } else { "," };
            let drive = format!("if=none,id={name},format=raw{comma}{options},file=");
            command.arg("-drive").arg(drive + path.to_str().expect("a plain path"));
            command.arg("-device").arg(format!("virtio-blk-pci,drive={name},serial={name}"));
        }
        command.args("-netdev user,id=net -device virtio-net-pci,netdev=net,romfile=".split(' '));
        let chardev = format!("socket,id=line,server=on,wait=off,path={}", line.display());
        command.args(["-chardev", &chardev, "-device", "pci-serial,chardev=line"]);
        command.args("-device i6300esb -action watchdog=reset".split(' '));
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            .spawn()
            .expect("qemu-system-aarch64 starts");

        let seen = Arc::new(Mutex::new(Seen::default()));
        let console = child.stdout.take().expect("it is piped");
        watch_console(console, &seen);
        let socket = host.socket.try_clone().expect("a second handle");
        let udp = move || {
            let socket = socket.try_clone().expect("one more handle");
            Udp::new(socket).expect("it takes a time-out")
        };
        watch(udp, Way::Udp, &host.key, &seen, &Arc::default());
        let line = connect(&line, &mut child);
        watch_serial(&line, &host.key, &seen, &Arc::default());
        Self { child, seen, line, _directory: directory }
    }

    /// Whether it is off, after a reset.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().expect("it can be asked").is_some()
    }

    /// Sends a packet over the serial line.
    pub fn say_on_line(&self, packet: &[u8]) {
        let mut buffer = [0; SEALED_FRAME_BYTES_MAX];
        let frame = frame_packet(packet, &mut buffer).expect("a packet");
        (&self.line).write_all(frame).expect("the line takes it");
    }

    /// As the function of this name.
    pub fn wait_for<T>(&self, what: &str, find: impl Fn(&Seen) -> Option<T>) -> T {
        wait_for(&self.seen, what, find)
    }

    /// Looks at all that has come so far.
    pub fn look<T>(&self, look: impl FnOnce(&Seen) -> T) -> T {
        look(&self.seen.lock().expect("no watcher panics"))
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        // SIGKILL: as good as pulling the plug.
        let _ = self.child.kill();
        let _ = self.child.wait();
        if thread::panicking()
            && let Ok(seen) = self.seen.lock()
        {
            let health = seen.health();
            // Its last words first: what is long may be cut.
            println!(
                "last Health: {health:?}\nlogs: {}\nconsole:\n{}",
                logs(&seen.udp),
                seen.console
            );
        }
    }
}

/// Waits until `find` finds what it looks for.
///
/// # Panics
/// When it never does.
pub fn wait_for<T>(seen: &Mutex<Seen>, what: &str, find: impl Fn(&Seen) -> Option<T>) -> T {
    let give_up = Instant::now() + PATIENCE;
    loop {
        if let Some(found) = find(&seen.lock().expect("no watcher panics")) {
            return found;
        }
        assert!(Instant::now() < give_up, "{what} never came");
        thread::sleep(Duration::from_millis(20));
    }
}

/// Waits until the box speaks at this port: it takes a while to boot, and the programs do not wait so
/// long.
///
/// # Panics
/// When it never does.
pub fn wait_for_packet(port: u16) {
    let socket = UdpSocket::bind(("127.0.0.1", port)).expect("the port is free");
    socket.set_read_timeout(Some(WAIT)).expect("a time-out");
    let give_up = Instant::now() + PATIENCE;
    // A wait may end early: a program that was stopped and goes on is interrupted in it.
    while socket.recv(&mut [0; 512]).is_err() {
        assert!(Instant::now() < give_up, "the box never speaks at port {port}");
    }
}

pub fn read(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// QEMU makes the socket soon after it has started.
pub fn connect(path: &Path, machine: &mut Child) -> UnixStream {
    let give_up = Instant::now() + PATIENCE;
    loop {
        match UnixStream::connect(path) {
            Ok(stream) => return stream,
            Err(error) => assert!(Instant::now() < give_up, "{}: {error}", path.display()),
        }
        let ended = machine.try_wait().expect("it can be asked");
        assert!(ended.is_none(), "QEMU has ended: {ended:?}");
        thread::sleep(Duration::from_millis(10));
    }
}

fn watch_console(mut console: impl Read + Send + 'static, seen: &Arc<Mutex<Seen>>) {
    let seen = Arc::clone(seen);
    thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(count @ 1..) = console.read(&mut bytes) {
            let Ok(mut seen) = seen.lock() else { return };
            seen.console.push_str(&String::from_utf8_lossy(&bytes[..count]));
        }
    });
}

/// Takes the packets from the host's end of a serial line.
pub fn watch_serial(
    line: &UnixStream,
    key: &Key,
    seen: &Arc<Mutex<Seen>>,
    is_paused: &Arc<AtomicBool>,
) {
    // What is not taken in this time is lost, as on a line.
    line.set_read_timeout(Some(WAIT)).expect("a time-out");
    line.set_write_timeout(Some(WAIT)).expect("a time-out");
    let line = line.try_clone().expect("a second handle");
    let open = move || {
        let line = line.try_clone().expect("one more handle");
        // A line that is gone does not come back.
        let mut line = Some(Box::new(line) as Box<dyn Line>);
        let gone = || std::io::ErrorKind::NotFound.into();
        Serial::new(Box::new(move || line.take().ok_or_else(gone))).expect("it is there")
    };
    watch(open, Way::Serial, key, seen, is_paused);
}

/// Listens to the box as a host does, with what the box has kept of the time before, except while
/// it `is_paused`. Ends when the machine is gone: nobody else keeps what is seen.
fn watch<C: Carrier>(
    open: impl Fn() -> C + Send + 'static,
    way: Way,
    key: &Key,
    seen: &Arc<Mutex<Seen>>,
    is_paused: &Arc<AtomicBool>,
) {
    let (seen, is_paused) = (Arc::downgrade(seen), Arc::clone(is_paused));
    let known = KnownBox { name: "boot test".into(), key: key.clone(), address: None };
    thread::spawn(move || {
        let mut link = None;
        while seen.strong_count() > 0 {
            if is_paused.load(Ordering::Relaxed) {
                link = None;
                thread::sleep(WAIT);
                continue;
            }
            let link = link.get_or_insert_with(|| {
                let carrier = Watched { carrier: open(), way, seen: seen.clone() };
                Link::new(carrier, vec![known.clone()], "boot test").with_past()
            });
            let polled = link.poll(&mut |event| {
                let Some(seen) = seen.upgrade() else { return };
                let Ok(mut seen) = seen.lock() else { return };
                let (messages, packets) = way.of(&mut seen);
                match event {
                    Event::Packet(packet) => messages.push(packet.message),
                    Event::NotAuthentic => packets.not_authentic += 1,
                    Event::Bad(error) => packets.damaged.push(error),
                    _ => {}
                }
            });
            if polled.is_err() {
                return;
            }
        }
    });
}

/// A carrier whose packets are kept as they come.
struct Watched<C> {
    carrier: C,
    way: Way,
    seen: Weak<Mutex<Seen>>,
}

impl<C: Carrier> Carrier for Watched<C> {
    fn poll(&mut self, wait: Duration, take: &mut dyn FnMut(Arrived<'_>)) -> Result<(), BadInput> {
        let Self { carrier, way, seen } = self;
        carrier.poll(wait, &mut |arrived| {
            if let Arrived::Packet { bytes, .. } = &arrived
                && let Some(seen) = seen.upgrade()
                && let Ok(mut seen) = seen.lock()
            {
                way.of(&mut seen).1.all.push(bytes.to_vec());
            }
            take(arrived);
        })
    }

    fn send(&mut self, to: Peer, packet: &[u8]) {
        self.carrier.send(to, packet);
    }

    fn only_peer(&self) -> Option<Peer> {
        self.carrier.only_peer()
    }

    fn dropped_here(&self) -> Option<u64> {
        self.carrier.dropped_here()
    }
}
