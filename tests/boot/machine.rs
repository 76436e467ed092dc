//! A computer that QEMU emulates, with the box's image in it: started, watched
//! over its console, its network and its serial line, and switched off.
//!
//! The guest's clock counts instructions, 2 ns each, so that what happens in it
//! does not depend on how busy this machine is: it takes longer here, and that is
//! all.

use std::io::Read;
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use plumbline::packet::{
    Deframer, Health, Hello, Message, PACKET_BYTES_MAX, PosePacket, decode_datagram,
};

/// Everything that is waited for comes within this, on a machine that is busy with
/// other things, or never.
pub const PATIENCE: Duration = Duration::from_secs(240);

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
    /// What vivid plays, where the test guest is in the initramfs.
    pub frames_disk: Option<&'a Path>,
}

/// The network and the serial line as the box's host sees them, there before the machine is.
pub struct Host {
    socket: UdpSocket,
}

impl Host {
    pub fn new() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        socket.set_read_timeout(Some(Duration::from_millis(100))).expect("a timeout");
        Self { socket }
    }

    /// Where the box is to send its packets.
    pub fn address(&self) -> SocketAddr {
        let port = self.socket.local_addr().expect("it is bound").port();
        (HOST, port).into()
    }
}

/// All that has come out of the machine.
#[derive(Default)]
pub struct Seen {
    pub console: String,
    pub udp: Vec<Message>,
    pub serial: Vec<Message>,
    /// Frames on the serial line that were no packets.
    pub serial_damaged: usize,
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

/// Every target was measured.
pub fn is_measured(pose: &PosePacket) -> bool {
    pose.targets.iter().all(|target| target.pose.is_ok())
}

/// The machine, switched on; dropping it pulls its plug.
pub struct Machine {
    child: Child,
    seen: Arc<Mutex<Seen>>,
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
        command.args("-machine virt -cpu cortex-a72 -smp 2 -m 512 -nodefaults".split(' '));
        command.args("-icount shift=1,sleep=on -display none -serial stdio".split(' '));
        command.arg("-kernel").arg(&parts.kernel).arg("-initrd").arg(&initramfs);
        command.arg("-append").arg(format!("console=ttyAMA0 quiet {}", parts.command_line));
        let disks = [("boot", Some(parts.boot_disk)), ("frames", parts.frames_disk)];
        for (name, path) in disks {
            let Some(path) = path else { continue };
            let read_only = if name == "frames" { ",readonly=on" } else { "" };
            let drive = format!("if=none,id={name},format=raw{read_only},file=");
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
        watch_udp(host.socket.try_clone().expect("a second handle"), &seen);
        watch_serial(connect(&line, &mut child), &seen, |_| {});
        Self { child, seen, _directory: directory }
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
            println!(
                "console:\n{}\nlast Health: {health:?}\nlogs: {}",
                seen.console,
                logs(&seen.udp)
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

/// Ends when the machine is gone: nobody else keeps what is seen.
fn watch_udp(socket: UdpSocket, seen: &Arc<Mutex<Seen>>) {
    let seen = Arc::downgrade(seen);
    thread::spawn(move || {
        let mut datagram = [0; PACKET_BYTES_MAX];
        loop {
            let received = socket.recv(&mut datagram);
            let Some(seen) = seen.upgrade() else { return };
            let Ok(mut seen) = seen.lock() else { return };
            if let Ok(count) = received {
                let packet = decode_datagram(&datagram[..count]).expect("an intact datagram");
                seen.udp.push(packet.message);
            }
        }
    });
}

/// Takes the packets from a serial line; hands its bytes on as they come.
pub fn watch_serial(
    mut line: UnixStream,
    seen: &Arc<Mutex<Seen>>,
    mut hand_on: impl FnMut(&[u8]) + Send + 'static,
) {
    let seen = Arc::clone(seen);
    thread::spawn(move || {
        let mut bytes = [0; 4096];
        let mut deframer: Deframer = Deframer::new();
        while let Ok(count @ 1..) = line.read(&mut bytes) {
            hand_on(&bytes[..count]);
            let Ok(mut seen) = seen.lock() else { return };
            deframer.push(&bytes[..count], |outcome| match outcome {
                Ok(packet) => seen.serial.push(packet.message),
                Err(_) => seen.serial_damaged += 1,
            });
        }
    });
}
