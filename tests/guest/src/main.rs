//! `/test/start`: the first process of the test machine.
//!
//! ```text
//! /test/start ── mounts, modules, camera ──▶ exec /init      (process 1, the box itself)
//!      └────── starts /test/start feed ────▶ plays frames    (the scene in front of the camera)
//! ```
//!
//! The camera is vivid, the kernel's own: a capture device (/dev/video0) and an
//! output device (/dev/video1) that is looped into it, so that whatever is
//! written to the one is seen by the other. The frames are raw, 1280 x 720, one
//! byte per pixel, in the file `/test/frames` of the initramfs or else on a disk
//! with the serial number `frames`; they are played forwards and backwards in
//! turn, so that the motion never jumps.
//!
//! With `test.usb_camera=CODE` on the kernel's command line the camera is one on USB instead, which
//! the kernel's driver for such cameras finds. It plays the files `/frames/0` and so on of the
//! initramfs, which have the format with this code of the kernel.
//!
//! Other options: `test.disconnect_after=SECONDS` and
//! `test.disconnect_for=SECONDS` pull the camera's plug once, and put it back;
//! `test.fast` has 60 frames per second instead of 24;
//! `test.gain` makes the frames as bright as the camera's gain has them, 100 for
//! as they are on the disk; `test.trigger` pulls at a GPIO line; `test.output` says what the box drives
//! at another; `test.modem_line` pulls at modem lines before the box starts. `test.unplug=TIMES` pulls
//! the plug of the USB camera and puts it back, and `test.set_clock` sets the computer's clock, both
//! at random, by `test.seed=NUMBER`; `test.load=PROGRAMS` starts programs that never rest, and lets
//! vivid and the player have the processor before them.

mod camera;
mod disturbances;
mod kernel;
mod modem_line;
mod random;
mod seccomp;
mod trigger;
mod usb_camera;
mod usb_descriptors;

use std::fs::{self, File};
use std::io::{Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use camera::{FRAME_BYTES, Player};
use nix::errno::Errno;
use nix::kmod::{ModuleInitFlags, finit_module};
use nix::mount::{MsFlags, mount};

const CAPTURE: &str = "/dev/video0";
const OUTPUT: &str = "/dev/video1";

/// Frames from one look at the camera's gain to the next.
const GAIN_EVERY: usize = 6;

/// Disks and devices come within this, or never.
const PATIENCE: Duration = Duration::from_secs(60);

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let done = match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["feed"] => feed(),
        ["usb", code] => usb_camera::play(code),
        ["trigger"] => trigger::pull(),
        ["output"] => trigger::tell_output(),
        ["modem_line"] => modem_line::run(),
        ["set_clock"] => seed().and_then(disturbances::set_clock),
        ["burn"] => disturbances::burn(),
        ["vivid"] => camera::prefer_vivid(),
        _ => start(),
    };
    let Err(error) = done else { return };
    eprintln!("test: {error:#}");
    if std::process::id() != 1 {
        std::process::exit(1);
    }
    // Where process 1 ends the kernel panics: better that the console is read first.
    sleep(PATIENCE);
}

/// Sets up the camera, starts the feeder, and becomes the box.
fn start() -> Result<()> {
    for (kind, place) in [("proc", "/proc"), ("sysfs", "/sys"), ("devtmpfs", "/dev")] {
        fs::create_dir_all(place)?;
        mount(Some(kind), place, Some(kind), MsFlags::empty(), None::<&str>)
            .with_context(|| format!("{kind} cannot be mounted"))?;
    }
    if is_asked_for("test.trigger")? {
        trigger::set_up()?;
        Command::new("/proc/self/exe").arg("trigger").spawn().context("nobody pulls the line")?;
    }
    if is_asked_for("test.output")? {
        trigger::set_up()?;
        Command::new("/proc/self/exe").arg("output").spawn().context("nobody tells of the line")?;
    }
    if is_asked_for("test.modem_line")? {
        // To its end, so that neither disturbs the other.
        Command::new("/proc/self/exe").arg("modem_line").status().context("the modem's lines")?;
    }
    if is_asked_for("test.set_clock")? {
        Command::new("/proc/self/exe").arg("set_clock").spawn().context("nobody sets the clock")?;
    }
    let load = number("test.load=")?;
    if load.is_some() {
        Command::new("/proc/self/exe").arg("vivid").spawn().context("nobody prefers vivid")?;
    }
    for _ in 0..load.unwrap_or(0) {
        Command::new("/proc/self/exe").arg("burn").spawn().context("no load")?;
    }
    let mut player = Command::new("/proc/self/exe");
    if let Some(code) = value_of(&options()?, "test.usb_camera=") {
        load_modules(Path::new("/test/modules.usb"))?;
        player.args(["usb", code]);
    } else {
        load_modules(Path::new("/test/modules.vivid"))?;
        camera::connect(CAPTURE, OUTPUT, is_asked_for("test.fast")?)?;
        player.arg("feed");
    }
    player.spawn().context("the player does not start")?;
    // Comes back only when it fails.
    Err(Command::new("/init").exec()).context("/init does not start")
}

/// Each line is `PATH OPTIONS`.
fn load_modules(list: &Path) -> Result<()> {
    let lines = fs::read_to_string(list).with_context(|| list.display().to_string())?;
    for line in lines.lines() {
        let (path, options) = line.split_once(' ').unwrap_or((line, ""));
        let file = File::open(path).with_context(|| path.to_owned())?;
        let options = std::ffi::CString::new(options)?;
        match finit_module(&file, &options, ModuleInitFlags::empty()) {
            Ok(()) | Err(Errno::EEXIST) => {}
            Err(error) => bail!("{path}: {error}"),
        }
    }
    Ok(())
}

/// Plays the frames for as long as the machine runs.
fn feed() -> Result<()> {
    let mut frames = open_frames()?;
    let count = frame_count(&mut frames)?;
    let mut disconnection = Disconnection::asked_for()?;
    let started = Instant::now();
    if number("test.load=")?.is_some() {
        camera::prefer_player()?;
    }
    let mut player = player()?;
    let obeys_gain = is_asked_for("test.gain")?;
    let mut levels = levels(100);
    for step in 0_usize.. {
        let offset = (frame_index(step, count) * FRAME_BYTES) as u64;
        if obeys_gain && step.is_multiple_of(GAIN_EVERY) {
            levels = self::levels(camera::gain(CAPTURE)?);
        }
        // The driver hands a buffer back when it has been shown: this is what paces.
        let played = player.play(|pixels| {
            frames.read_exact_at(pixels, offset)?;
            if obeys_gain {
                pixels.iter_mut().for_each(|pixel| *pixel = levels[usize::from(*pixel)]);
            }
            Ok(())
        });
        if played.is_err_and(|error| error.raw_os_error() == Some(Errno::ENODEV as i32)) {
            drop(player);
            player = self::player()?;
        }
        if let Some(Disconnection { after, lasts }) = disconnection
            && started.elapsed() >= after
        {
            disconnection = None;
            println!("test: the camera's plug is pulled at {} s", uptime_s()?);
            camera::press_disconnect(CAPTURE)?;
            // vivid puts the plug back when its last user has gone: the player is one.
            sleep(lasts);
            drop(player);
            player = self::player()?;
            println!("test: the camera's plug is back");
        }
    }
    Ok(())
}

/// What each grey level becomes with this gain, in hundredths.
fn levels(gain: u32) -> [u8; 256] {
    std::array::from_fn(|level| (level as u32 * gain / 100).min(255) as u8)
}

/// The kernel's command line.
fn options() -> Result<String> {
    fs::read_to_string("/proc/cmdline").context("/proc/cmdline")
}

/// Whether this is a word of the kernel's command line.
fn is_asked_for(word: &str) -> Result<bool> {
    Ok(options()?.split_whitespace().any(|it| it == word))
}

/// What follows this beginning of a word of the kernel's command line.
fn value_of<'a>(options: &'a str, beginning: &str) -> Option<&'a str> {
    options.split_whitespace().find_map(|word| word.strip_prefix(beginning))
}

/// The number that follows this beginning of a word of the kernel's command line.
fn number(beginning: &str) -> Result<Option<u64>> {
    let options = options()?;
    let number = value_of(&options, beginning).map(str::parse).transpose();
    number.with_context(|| format!("{beginning} of the kernel's command line"))
}

/// Of what happens at random.
fn seed() -> Result<u64> {
    Ok(number("test.seed=")?.unwrap_or(1))
}

/// 0, 1 ... n-1, n-1 ... 1, 0 and again.
fn frame_index(step: usize, count: usize) -> usize {
    let phase = step % (2 * count);
    if phase < count { phase } else { 2 * count - 1 - phase }
}

/// The number of whole frames; a disk's size is rounded up to sectors.
fn frame_count(disk: &mut File) -> Result<usize> {
    // A device's metadata says nothing of its size.
    let bytes = disk.seek(SeekFrom::End(0))? as usize;
    ensure!(bytes >= FRAME_BYTES, "the disk of frames holds {bytes} bytes");
    Ok(bytes / FRAME_BYTES)
}

/// Opens the frames: on a board with one disk slot they come in the initramfs.
fn open_frames() -> Result<File> {
    match File::open("/test/frames") {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => open_disk("frames"),
        opened => opened.context("/test/frames"),
    }
}

/// Opens the disk with this serial number: it may be listed before it can be opened.
fn open_disk(serial: &str) -> Result<File> {
    let until = Instant::now() + PATIENCE;
    loop {
        match File::open(disk(serial)?) {
            Ok(file) => return Ok(file),
            Err(error) if Instant::now() > until => return Err(error).context(serial.to_owned()),
            Err(_) => sleep(Duration::from_millis(20)),
        }
    }
}

/// The disk with this serial number. The box's init loads its driver, so it may take a while.
fn disk(serial: &str) -> Result<PathBuf> {
    let until = Instant::now() + PATIENCE;
    while Instant::now() < until {
        for entry in fs::read_dir("/sys/block")? {
            let entry = entry?;
            let found = fs::read_to_string(entry.path().join("serial"));
            if found.is_ok_and(|found| found.trim() == serial) {
                return Ok(Path::new("/dev").join(entry.file_name()));
            }
        }
        sleep(Duration::from_millis(20));
    }
    bail!("there is no disk with the serial number {serial}")
}

/// Opens the output device, waiting until it is (again) there.
fn player() -> Result<Player> {
    let until = Instant::now() + PATIENCE;
    loop {
        match Player::open(OUTPUT) {
            Ok(player) => return Ok(player),
            Err(error) if Instant::now() > until => return Err(error).context(OUTPUT),
            Err(_) => sleep(Duration::from_millis(20)),
        }
    }
}

/// Since the kernel's start.
fn uptime_s() -> Result<String> {
    let text = fs::read_to_string("/proc/uptime")?;
    Ok(text.split_whitespace().next().unwrap_or_default().to_owned())
}

/// When the plug is pulled, counted from the first frame, and for how long.
struct Disconnection {
    after: Duration,
    lasts: Duration,
}

impl Disconnection {
    /// What the kernel's command line asks for.
    fn asked_for() -> Result<Option<Self>> {
        let options = options()?;
        let seconds = |name: &str| -> Result<Option<Duration>> {
            let value = value_of(&options, name);
            Ok(value.map(str::parse).transpose()?.map(Duration::from_secs_f64))
        };
        let after = seconds("test.disconnect_after=")?;
        let lasts = seconds("test.disconnect_for=")?;
        Ok(after.map(|after| Self { after, lasts: lasts.unwrap_or(Duration::from_secs(3)) }))
    }
}
