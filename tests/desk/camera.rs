//! The box's program, whose camera shows what a test wants it to show: reels of rendered frames, at
//! the pace of the box.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use plumbline::seal::KEY_FILE_NAME;
use plumbline_test_support::{command, program};
use tempfile::TempDir;

use crate::stand::{PATIENCE, plumb};

/// The pace of the box's camera: at this rate a box that shares a busy computer keeps it, and has measured
/// the times that are compared.
pub const RATE_HZ: usize = 30;

/// The lens of the recordings is that of a small camera: a frame costs the box little.
const SIZE_PX: (u32, u32) = (640, 480);

/// Photographs of the board, each of its own pose.
pub const PHOTOGRAPHS: usize = 15;

/// Frames of the person, who is shown forwards and backwards, so that nobody jumps.
const PERSON_FRAMES: usize = 120;

/// What is rendered once for all tests: `person`, with its truth, and `dry`, the board.
pub fn rendered() -> &'static Path {
    static MADE: OnceLock<TempDir> = OnceLock::new();
    let made = MADE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let done = |arguments: &str| {
            let words = arguments.split_whitespace();
            let output = command(plumb()).args(words).current_dir(folder.path()).output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        };
        done(&format!("simulate --lens vga --frames {PERSON_FRAMES} --out person"));
        done(&format!(
            "simulate --lens vga --board 9x6 --pitch-mm 20 --photographs {PHOTOGRAPHS} --out dry"
        ));
        folder
    });
    made.path()
}

/// Frames that are shown again and again.
type Reel = Vec<Vec<u8>>;

/// All reels: the photographs, then the board that stands, then the person.
fn reels() -> &'static [Reel] {
    static READ: OnceLock<Vec<Reel>> = OnceLock::new();
    READ.get_or_init(|| {
        let folder = rendered();
        let photograph = |number: usize| {
            let path = folder.join(format!("dry/photos/board-{number:02}.png"));
            vec![image::open(path).unwrap().to_luma8().into_raw()]
        };
        let mut reels: Vec<Reel> = (1..=PHOTOGRAPHS).map(photograph).collect();
        reels.push(frames_of(&folder.join("dry/scene.y4m")));
        let person = frames_of(&folder.join("person/frames.y4m"));
        let back = person[1..person.len() - 1].iter().rev().cloned();
        let there_and_back = person.iter().cloned().chain(back);
        reels.push(there_and_back.collect());
        reels
    })
}

fn frames_of(path: &Path) -> Reel {
    let mut video = Vec::new();
    File::open(path).unwrap().read_to_end(&mut video).unwrap();
    let header = video.iter().position(|&byte| byte == b'\n').unwrap() + 1;
    let word = "FRAME\n".len();
    let frames = video[header..].chunks_exact(word + (SIZE_PX.0 * SIZE_PX.1) as usize);
    frames.map(|frame| frame[word..].to_vec()).collect()
}

/// What a camera shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    /// The board as somebody holds it for this photograph, from 0.
    Photograph(usize),
    /// The board standing where the person will stand.
    Standing,
    /// The person.
    Person,
}

impl Shown {
    fn reel(self) -> usize {
        match self {
            Self::Photograph(number) => number % PHOTOGRAPHS,
            Self::Standing => PHOTOGRAPHS,
            Self::Person => PHOTOGRAPHS + 1,
        }
    }
}

/// Frames that were begun before a camera shows something else and are not yet tracked when the next
/// is taken, at most: one in the pipe, one that is read ahead, one that is tracked; and the one that was
/// being written.
const UNDER_WAY: usize = 4;

/// What the threads of a box share.
struct Shared {
    reel: AtomicUsize,
    /// How many frames the program has taken, over all its starts.
    taken: AtomicUsize,
    is_over: AtomicBool,
}

/// A box with its camera: started again whenever its program ends, as on a real box, until this is
/// dropped.
pub struct TheBox {
    shared: Arc<Shared>,
    supervisor: Option<JoinHandle<()>>,
}

impl TheBox {
    /// Starts the box that has its files in this folder; what it sends is written in clear into
    /// `sent.bin`, each time anew.
    pub fn start(folder: &Path, shown: Shown, rate_hz: usize) -> Self {
        Self::start_on(folder, shown, rate_hz, None)
    }

    /// The same, with a serial line besides.
    pub fn start_on(folder: &Path, shown: Shown, rate_hz: usize, serial: Option<&str>) -> Self {
        let reel = AtomicUsize::new(shown.reel());
        let (taken, is_over) = (AtomicUsize::new(0), AtomicBool::new(false));
        let shared = Arc::new(Shared { reel, taken, is_over });
        let (for_supervisor, folder) = (Arc::clone(&shared), folder.to_owned());
        let serial = serial.map(str::to_owned);
        let supervisor = std::thread::spawn(move || {
            while !for_supervisor.is_over.load(Ordering::Relaxed) {
                run_once(&for_supervisor, &folder, rate_hz, serial.as_deref());
            }
        });
        Self { shared, supervisor: Some(supervisor) }
    }

    /// Has the camera show this; the poses of what it showed before have been sent when this returns.
    #[track_caller]
    pub fn show(&self, shown: Shown) {
        self.shared.reel.store(shown.reel(), Ordering::Relaxed);
        let taken = || self.shared.taken.load(Ordering::Relaxed);
        let (before, give_up) = (taken(), Instant::now() + PATIENCE);
        while taken() <= before + UNDER_WAY {
            assert!(Instant::now() < give_up, "the box takes no frames");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for TheBox {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        let supervisor = self.supervisor.take();
        assert!(supervisor.is_some_and(|it| it.join().is_ok()) || std::thread::panicking());
    }
}

/// One start of the program, until it ends or nobody wants it any more.
fn run_once(shared: &Arc<Shared>, folder: &Path, rate_hz: usize, serial: Option<&str>) {
    let said = File::options().create(true).append(true).open(folder.join("box.txt")).unwrap();
    let mut child = command(board())
        .args(["--config", "box.plb", "--key", KEY_FILE_NAME, "--replay", "-", "--supervised"])
        .args(["--record", "sent.bin"])
        .args(serial.into_iter().flat_map(|it| ["--serial", it]))
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(said.try_clone().unwrap())
        .stderr(said)
        .spawn()
        .unwrap();
    let camera = child.stdin.take().unwrap();
    let for_camera = Arc::clone(shared);
    let feeder = std::thread::spawn(move || feed(camera, &for_camera, rate_hz));
    while child.try_wait().unwrap().is_none() {
        if shared.is_over.load(Ordering::Relaxed) {
            end(&mut child);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    feeder.join().unwrap();
}

fn end(child: &mut Child) {
    // It may have ended by itself.
    let _ = child.kill();
    child.wait().unwrap();
}

/// The frames, which the program takes at its own pace, until it takes none any more.
fn feed(mut camera: ChildStdin, shared: &Shared, rate_hz: usize) {
    let (width, height) = SIZE_PX;
    let header = format!("YUV4MPEG2 W{width} H{height} F{rate_hz}:1 Ip A1:1 Cmono\n");
    let mut is_taken = camera.write_all(header.as_bytes()).is_ok();
    for number in 0.. {
        let reel = &reels()[shared.reel.load(Ordering::Relaxed)];
        let frame = &reel[number % reel.len()];
        is_taken = is_taken
            && camera.write_all(b"FRAME\n").is_ok()
            && camera.write_all(frame).is_ok()
            && !shared.is_over.load(Ordering::Relaxed);
        if !is_taken {
            break;
        }
        shared.taken.fetch_add(1, Ordering::Relaxed);
    }
}

fn board() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| program("plumbline-board").expect("the box's program builds"))
}
