//! An emulated Raspberry Pi 4 with the card in its slot, started as its firmware would start it.
//!
//! QEMU has the processor, the interrupt controllers, the clock, the mailbox, the pins, the PL011
//! serial line, the frame buffer and the slot. What it lacks is played here: the boot firmware,
//! by the rules in [`firmware`](super::firmware), and the watchdog, in
//! [`power_management`](super::power_management). The camera is vivid, as on the other emulated
//! board; its frames come in the initramfs, as there is no second disk.

use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle, sleep};
use std::time::Instant;

use nix::fcntl::OFlag;
use nix::pty::{PtyMaster, grantpt, posix_openpt, ptsname_r, unlockpt};
use nix::sys::termios::{FlushArg, SetArg, cfmakeraw, tcflush, tcgetattr, tcsetattr};
use plumbline::config::FILE_NAME;
use plumbline_update::card::SETTINGS;

use super::card::{Card, chosen};
use super::firmware::{self, BOARDS};
use super::mailbox::asked_for_try;
use super::power_management::{LOOK_EVERY, PowerManagement, Reset};
use super::qmp::Qmp;
use crate::machine::{PATIENCE, Seen, connect, image, read, wait_for, watch_serial};
use crate::scene::{self, SCENE, run};

/// The box's serial line: the PL011, by the name that the kernel gives it.
pub const LINE: &str = "/dev/ttyAMA0";

/// The system timer's microseconds.
const CLOCK: u64 = 0xfe00_3004;

/// The levels of pins 32 to 53.
const PINS: u64 = 0xfe20_0038;

/// The green LED hangs on pin 42.
const GREEN_LED: u32 = 1 << (42 - 32);

/// What is added to the card's own command line: the camera, and clocks that nobody has set,
/// where there is no firmware.
const ADDED: &str = "rdinit=/test/start clk_ignore_unused pd_ignore_unused";

/// A card and the machine that it is put into.
pub struct Pi {
    directory: tempfile::TempDir,
    card: PathBuf,
    line: Line,
    /// What the box is told beside the card, for tests.
    options: String,
    running: Option<Running>,
}

/// A reset by the watchdog's registers, which is how a Pi is restarted, too.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Restart {
    /// When, on the clock that begins when the machine starts.
    pub at_s: f64,
    /// Whether the firmware had been asked for one try of the other slot.
    pub to_try: bool,
}

/// A machine that is switched on.
struct Running {
    child: Arc<Mutex<Child>>,
    qmp: Arc<Mutex<Qmp>>,
    off: Arc<AtomicBool>,
    restarts: Arc<Mutex<Vec<Restart>>>,
    keeper: JoinHandle<()>,
}

impl Pi {
    /// A new card with the key of the tests' boxes, and this configuration or none. `options` are
    /// added to its command line.
    pub fn new(blob: Option<&[u8]>, options: &str) -> Self {
        Self::with_card(options, |card| {
            scene::copy_key(card, SETTINGS.start_bytes);
            if let Some(blob) = blob {
                scene::copy(card, SETTINGS.start_bytes, FILE_NAME, blob);
            }
        })
    }

    /// A new card with this configuration, and without a key.
    pub fn unpaired(blob: &[u8]) -> Self {
        Self::with_card("", |card| scene::copy(card, SETTINGS.start_bytes, FILE_NAME, blob))
    }

    fn with_card(options: &str, fill: impl FnOnce(&Path)) -> Self {
        let directory = tempfile::tempdir().expect("a temporary directory");
        let card = directory.path().join("card.img");
        let names = [image("rpi4.img"), card.clone()];
        let names = names.each_ref().map(|path| path.to_str().expect("a plain path"));
        run("cp", &["--sparse=always", names[0], names[1]]);
        fill(&card);
        // QEMU takes no card whose size is not a power of two.
        let size = std::fs::metadata(&card).expect("it was copied").len().next_power_of_two();
        let file = std::fs::OpenOptions::new().write(true).open(&card).expect("it was copied");
        file.set_len(size).expect("there is room");
        let line = Line::new();
        Self { directory, card, line, options: options.to_owned(), running: None }
    }

    /// The card's image.
    pub fn card(&self) -> &Path {
        &self.card
    }

    /// The other end of the serial line, for a program; what has come before is gone. Until it is
    /// given back, nothing is seen here of what comes.
    pub fn lend_line(&self) -> Lent {
        self.line.is_lent.store(true, Ordering::Relaxed);
        tcflush(&self.line.far_end, FlushArg::TCIFLUSH).expect("it can be cleared");
        Lent { name: self.line.name.clone(), is_lent: Arc::clone(&self.line.is_lent) }
    }

    /// Power comes on.
    pub fn switch_on(&mut self) {
        assert!(self.running.is_none(), "it is on");
        let starter = Starter::new(self);
        let (child, qmp, registers) = starter.start(Reset::PowerOn, false, &self.line);
        let (child, qmp) = (Arc::new(Mutex::new(child)), Arc::new(Mutex::new(qmp)));
        let (off, restarts) = (Arc::<AtomicBool>::default(), Arc::<Mutex<Vec<_>>>::default());
        let keeper = {
            let (child, qmp, off) = (Arc::clone(&child), Arc::clone(&qmp), Arc::clone(&off));
            let (line, restarts) = (self.line.clone(), Arc::clone(&restarts));
            thread::spawn(move || keep(&starter, registers, &child, &qmp, &off, &line, &restarts))
        };
        self.running = Some(Running { child, qmp, off, restarts, keeper });
    }

    /// The first restart since the power came on, once it has come.
    pub fn wait_for_restart(&self) -> Restart {
        let running = self.running.as_ref().expect("it is on");
        let give_up = Instant::now() + PATIENCE;
        loop {
            if let Some(restart) = running.restarts.lock().expect("no panic").first() {
                return *restart;
            }
            assert!(Instant::now() < give_up, "the machine was not restarted");
            sleep(LOOK_EVERY);
        }
    }

    /// The plug is pulled.
    pub fn cut_power(&mut self) {
        let Some(running) = self.running.take() else { return };
        running.off.store(true, Ordering::Relaxed);
        if let Ok(mut child) = running.child.lock() {
            let _ = child.kill();
            let _ = child.wait();
        }
        let kept = running.keeper.join();
        assert!(kept.is_ok() || thread::panicking(), "the machine's keeper has failed");
    }

    /// Waits until `find` finds what it looks for among the packets.
    pub fn wait_for<T>(&self, what: &str, find: impl Fn(&Seen) -> Option<T>) -> T {
        wait_for(&self.line.seen, what, find)
    }

    /// Microseconds of the machine's clock, and whether the green LED is lit.
    pub fn green_led(&self) -> (u32, bool) {
        let running = self.running.as_ref().expect("it is on");
        let mut qmp = running.qmp.lock().expect("no panic");
        let (now, pins) = (qmp.word(CLOCK), qmp.word(PINS));
        (now.expect("it runs"), pins.expect("it runs") & GREEN_LED != 0)
    }

    /// What the screen shows.
    pub fn screen(&self) -> ::image::RgbImage {
        let file = self.directory.path().join("screen.png");
        let running = self.running.as_ref().expect("it is on");
        running.qmp.lock().expect("no panic").picture(&file);
        ::image::open(&file).expect("a picture").into_rgb8()
    }
}

impl Drop for Pi {
    fn drop(&mut self) {
        self.cut_power();
        if thread::panicking()
            && let Ok(seen) = self.line.seen.lock()
        {
            let announced = seen.serial_packets.announcements().last();
            let count = seen.serial_packets.all.len();
            println!("{count} packets on the line, announced: {announced:?}");
            println!("logs: {}", crate::machine::logs(&seen.serial));
        }
    }
}

/// Does what the hardware does while power is on: the watchdog's reset.
fn keep(
    starter: &Starter,
    mut registers: PowerManagement,
    child: &Mutex<Child>,
    qmp: &Mutex<Qmp>,
    off: &AtomicBool,
    line: &Line,
    restarts: &Mutex<Vec<Restart>>,
) {
    while !off.load(Ordering::Relaxed) {
        sleep(LOOK_EVERY);
        // Without an answer the machine has just been switched off.
        let Some(now_us) = qmp.lock().expect("no panic").word(CLOCK) else { continue };
        if !registers.go_on(now_us) {
            continue;
        }
        let mut running = child.lock().expect("no panic");
        if off.load(Ordering::Relaxed) {
            return;
        }
        let _ = running.kill();
        let _ = running.wait();
        let to_try = asked_for_try(&starter.log, &starter.memory);
        let restart = Restart { at_s: f64::from(now_us) * 1e-6, to_try };
        println!("reset by the watchdog's registers: {restart:?}");
        restarts.lock().expect("no panic").push(restart);
        let (started, control, counting) = starter.start(Reset::Watchdog, to_try, line);
        *running = started;
        drop(running);
        *qmp.lock().expect("no panic") = control;
        registers = counting;
    }
}

/// How the machine is started, again and again.
struct Starter {
    directory: PathBuf,
    card: PathBuf,
    options: String,
    memory: PathBuf,
    /// Where QEMU writes what the firmware is asked for.
    log: PathBuf,
}

impl Starter {
    fn new(pi: &Pi) -> Self {
        let directory = pi.directory.path().to_owned();
        let (memory, log) = (directory.join("memory"), directory.join("firmware.log"));
        Self { card: pi.card.clone(), options: pi.options.clone(), memory, log, directory }
    }

    /// Plays the firmware: takes from the card what its rules say, in a start that was asked for as a
    /// try or in any other, starts the watchdog if it is to run, and then the kernel.
    fn start(&self, reset: Reset, is_try: bool, line: &Line) -> (Child, Qmp, PowerManagement) {
        let slot = chosen(&self.card, is_try);
        let card = Card::of(&self.card, is_try);
        let start = firmware::start(&card, &BOARDS[0])
            .unwrap_or_else(|complaints| panic!("{}", complaints.join("\n")));
        let path = |name: &str| self.directory.join(name);
        let file = |name: &str| card.file(name).expect("the firmware has found it");
        std::fs::write(path("kernel"), file(&start.kernel)).expect("there is room");
        let archives = [file(&start.initramfs), &read(&image("overlay.cpio")), &SCENE.archive()];
        std::fs::write(path("initramfs"), archives.concat()).expect("there is room");
        // The tree is the card's own, fitted to what QEMU emulates.
        std::fs::copy(image("rpi4.dtb"), path("tree.dtb")).expect("there is room");
        let tree = path("tree.dtb");
        let tree = tree.to_str().expect("a plain path");
        let status = format!("{:x}", reset.status());
        let loader = "/chosen/bootloader";
        run("fdtput", &["-p", "-t", "x", tree, loader, "rsts", &status]);
        let number = format!("{:x}", slot.partition().number);
        run("fdtput", &["-p", "-t", "x", tree, loader, "partition", &number]);
        run("fdtput", &["-p", "-t", "x", tree, loader, "tryboot", if is_try { "1" } else { "0" }]);
        run("fdtput", &["-p", "-t", "x", tree, "/system", "linux,revision", "b03115"]);
        // The firmware's random numbers, without which a machine whose clock counts instructions
        // has none: the box waits for them.
        let seed: [u32; 16] = rand::random();
        let seed = seed.map(|word| format!("{word:x}"));
        let words = seed.iter().map(String::as_str);
        let chosen: Vec<&str> =
            ["-p", "-t", "x", tree, "/chosen", "rng-seed"].into_iter().chain(words).collect();
        run("fdtput", &chosen);
        // What the memory held is gone.
        let _ = std::fs::remove_file(&self.memory);
        for socket in ["control", "line"] {
            let _ = std::fs::remove_file(path(socket));
        }

        let text = |path: &Path| path.to_str().expect("a plain path").to_owned();
        let socket = |name: &str| format!("unix:{},server=on,wait=off", text(&path(name)));
        let mut command = Command::new(image("qemu-raspi4b"));
        command.args(["-machine", "memory-backend=memory", "-m", "2G", "-nodefaults"]);
        let memory = text(&self.memory);
        let backend = format!("memory-backend-file,id=memory,size=2G,share=on,mem-path={memory}");
        command.args(["-object", &backend, "-display", "none", "-no-reboot"]);
        // As on the other board: the machine's clock counts instructions.
        command.args(["-icount", "shift=1,sleep=on"]);
        command.args(["-kernel", &text(&path("kernel")), "-initrd", &text(&path("initramfs"))]);
        command.args(["-dtb", tree]);
        let command_line = format!("{} {ADDED} {}", start.command_line, self.options);
        command.args(["-append", &command_line]);
        command.args(["-drive", &format!("if=sd,format=raw,file={}", text(&self.card))]);
        command.args(["-serial", &socket("line"), "-serial", "null", "-qmp", &socket("control")]);
        command.args(["-d", "trace:bcm2835_mbox_property", "-D", &text(&self.log)]);
        // Its processor waits until all is connected.
        let mut child = command.arg("-S").stdin(Stdio::null()).spawn().expect("QEMU starts");
        let mut qmp = Qmp::new(connect(&path("control"), &mut child));
        line.plug_in(connect(&path("line"), &mut child));
        let registers = PowerManagement::of(&self.memory);
        if let Some(seconds) = start.watchdog_s {
            registers.start(seconds);
        }
        qmp.go();
        (child, qmp, registers)
    }
}

/// The other end of the serial line, which a program has for itself.
pub struct Lent {
    name: String,
    is_lent: Arc<AtomicBool>,
}

impl Lent {
    /// The device.
    pub fn name(&self) -> &str {
        &self.name
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        self.is_lent.store(false, Ordering::Relaxed);
    }
}

/// The serial line from the box, whichever start of the machine it is, to what listens here or,
/// while it is lent, to a program.
///
/// ```text
///                  ┌─ lent ─▶ host ═ pseudo-terminal ═ far_end    a program
/// machine ◀────────┤
///                  └────────▶ here ═ socket ═ watch_serial        what is seen
/// ```
#[derive(Clone)]
struct Line {
    name: String,
    host: Arc<PtyMaster>,
    /// Kept open: it makes the line one that changes no bytes, and a line that nobody has open is
    /// none.
    far_end: Arc<File>,
    here: Arc<UnixStream>,
    is_lent: Arc<AtomicBool>,
    /// Whether the machine has said anything since it was plugged in: before that, nothing is said
    /// from here to a kernel that is still starting.
    has_spoken: Arc<AtomicBool>,
    seen: Arc<Mutex<Seen>>,
    machine: Arc<Mutex<Option<UnixStream>>>,
}

impl Line {
    fn new() -> Self {
        let open = || -> nix::Result<(PtyMaster, String)> {
            // What nobody takes at once is lost, as on a line; the box does not wait for it.
            let flags = OFlag::O_RDWR | OFlag::O_NOCTTY | OFlag::O_NONBLOCK | OFlag::O_CLOEXEC;
            let host = posix_openpt(flags)?;
            grantpt(&host)?;
            unlockpt(&host)?;
            let name = ptsname_r(&host)?;
            Ok((host, name))
        };
        let (host, name) = open().expect("a pseudo-terminal");
        let far_end = File::options().read(true).write(true).open(&name).expect("its other end");
        let mut settings = tcgetattr(&far_end).expect("it has settings");
        cfmakeraw(&mut settings);
        tcsetattr(&far_end, SetArg::TCSANOW, &settings).expect("it takes settings");
        let (here, watched) = UnixStream::pair().expect("a pair of sockets");
        here.set_nonblocking(true).expect("a socket");
        let line = Self {
            name,
            host: Arc::new(host),
            far_end: Arc::new(far_end),
            here: Arc::new(here),
            is_lent: Arc::default(),
            has_spoken: Arc::default(),
            seen: Arc::default(),
            machine: Arc::default(),
        };
        watch_serial(&watched, &scene::key(), &line.seen, &line.is_lent);
        let (host, here) = (Arc::clone(&line.host), Arc::clone(&line.here));
        line.pass_to_machine(true, move |bytes| (&*host).read(bytes));
        line.pass_to_machine(false, move |bytes| (&*here).read(bytes));
        line
    }

    /// Passes on what `read` reads, as long as there is a line, if it is lent or not.
    fn pass_to_machine(
        &self,
        if_lent: bool,
        mut read: impl FnMut(&mut [u8]) -> std::io::Result<usize> + Send + 'static,
    ) {
        let (machine, is_lent) = (Arc::downgrade(&self.machine), Arc::clone(&self.is_lent));
        let has_spoken = Arc::clone(&self.has_spoken);
        thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Some(machine) = machine.upgrade() {
                let Ok(count @ 1..) = read(&mut bytes) else {
                    drop(machine);
                    sleep(LOOK_EVERY);
                    continue;
                };
                if is_lent.load(Ordering::Relaxed) == if_lent
                    && has_spoken.load(Ordering::Relaxed)
                    && let Some(machine) = &mut *machine.lock().expect("no panic")
                {
                    // It has just been switched off, or does not read: lost, as on a line.
                    let _ = machine.write(&bytes[..count]);
                }
            }
        });
    }

    /// Connects the machine's end.
    fn plug_in(&self, mut stream: UnixStream) {
        let copy = stream.try_clone().expect("a second handle");
        copy.set_write_timeout(Some(LOOK_EVERY)).expect("a timeout");
        self.has_spoken.store(false, Ordering::Relaxed);
        *self.machine.lock().expect("no panic") = Some(copy);
        let (host, here) = (Arc::clone(&self.host), Arc::clone(&self.here));
        let (is_lent, has_spoken) = (Arc::clone(&self.is_lent), Arc::clone(&self.has_spoken));
        thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = stream.read(&mut bytes) {
                has_spoken.store(true, Ordering::Relaxed);
                let _ = if is_lent.load(Ordering::Relaxed) {
                    (&*host).write(&bytes[..count])
                } else {
                    (&*here).write(&bytes[..count])
                };
            }
        });
    }
}

#[test]
fn what_the_machine_says_on_its_line_is_seen() {
    use plumbline::packet::{Start, frame_packet};
    use plumbline::seal::{BoxEnd, SEALED_BYTES_MAX, SEALED_FRAME_BYTES_MAX};
    let line = Line::new();
    let (mut machine, far) = UnixStream::pair().unwrap();
    line.plug_in(far);
    let end = BoxEnd::new(None, Start::MIN, &[1; 32]);
    let (mut packet, mut frame) = ([0; SEALED_BYTES_MAX], [0; SEALED_FRAME_BYTES_MAX]);
    let frame = frame_packet(end.announcement(&mut packet), &mut frame).unwrap();
    machine.write_all(frame).unwrap();
    wait_for(&line.seen, "the announcement", |seen| {
        (seen.serial_packets.announcements().count() == 1).then_some(())
    });
}
