//! A camera that is lost again and again.
//!
//! A recording cannot be lost, and this computer has no camera that could. The box here is another
//! process of this program: the session, the links, the counters and the camera's own logic (what
//! closes it, opens it again and counts) are the box's; only the device behind these, with which a box
//! asks the kernel for frames, is played. What the kernel does to a box whose plug is pulled is seen
//! on the booted box: `tests/boot/endurance`.

use std::env;
use std::fs::File;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock};
use std::thread::sleep;
use std::time::Instant;

use anyhow::{Result, bail};
use plumbline::config::{Capture, Config};
use plumbline::image::GreyImage;
use plumbline::packet::{CameraState, MarkedInstant, ResetReason};
use plumbline::pipeline::Pipeline;
use plumbline_board::link::{FileLink, Identity, Links, Ports};
use plumbline_board::session::{self, Setup};
use plumbline_board::source::camera::{Camera, Counts, Device, Waited};
use plumbline_board::source::{Frame, Pixels};
use plumbline_board::trigger::Triggers;
use plumbline_board::update::Updates;
use plumbline_board::{allocation, logger, random};
use plumbline_test_support::{evidence, repetitions, seed};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::judge::{Clock, Judge};
use crate::replayed::{assert_constant, is_too_slow, set_up, sums};
use crate::script::{Happening, Script, Step};
use crate::show::{Kinds, SIZE_PX, Show};
use crate::watched::{Growth, SETTLED, TheBox, watch};

/// Tells the box what to show: a seed, the frames, the frames in which it is lost once, and the numbers
/// of pictures.
const BOX: &str = "PLUMBLINE_TEST_BOX";

/// One loss in this many is a camera that falls silent, and is given up after a second; the others say
/// that they are gone.
const SILENT_ONE_IN: u32 = 50;

/// The camera's side of the stage.
struct Stage {
    show: Show,
    play: Mutex<Play>,
}

struct Play {
    script: Script,
    /// Of how the camera is lost and found.
    random: ChaCha8Rng,
    /// Frames that are still to come.
    left: u64,
    /// The frame after a loss, which waits for the camera to be opened again.
    waiting: Option<Step>,
    /// The camera gives nothing until it is opened again.
    is_silent: bool,
    /// Attempts to open it that fail.
    fails: u32,
}

static STAGE: OnceLock<Stage> = OnceLock::new();

/// Set when the last frame has been given.
static IS_OVER: AtomicBool = AtomicBool::new(false);

fn stage() -> &'static Stage {
    STAGE.get().expect("it is set before the camera is opened")
}

/// A camera that plays the script.
#[derive(Debug)]
struct Played {
    step: Option<Step>,
    relit: Vec<u8>,
    counts: Counts,
}

impl Device for Played {
    fn open(_: &Capture, _: (usize, usize)) -> Result<Self> {
        let mut play = stage().play.lock().expect("nobody panics with it");
        if play.fails > 0 {
            play.fails -= 1;
            bail!("the played camera is not plugged in");
        }
        play.is_silent = false;
        let relit = vec![0; SIZE_PX.0 * SIZE_PX.1];
        Ok(Self { step: None, relit, counts: Counts::default() })
    }

    fn wait(&mut self, until: Instant) -> Waited {
        let mut play = stage().play.lock().expect("nobody panics with it");
        if play.is_silent {
            sleep(until.saturating_duration_since(Instant::now()));
            return Waited::Quiet;
        }
        if play.left == 0 {
            IS_OVER.store(true, Ordering::Relaxed);
            return Waited::Quiet;
        }
        let step = match play.waiting.take() {
            Some(step) => step,
            None => {
                let step = play.script.next().expect("the script has no end");
                if step.is_lost {
                    play.waiting = Some(step);
                    play.fails = play.random.random_range(0..=1);
                    if play.random.random_ratio(1, SILENT_ONE_IN) {
                        play.is_silent = true;
                        return Waited::Quiet;
                    }
                    return Waited::Lost("the played camera was unplugged".into());
                }
                step
            }
        };
        play.left -= 1;
        self.counts.missed += u64::from(step.missed);
        if let Some(light) = step.light {
            light.show(stage().show.picture(step.picture), &mut self.relit);
        }
        self.step = Some(step);
        Waited::Ready
    }

    fn frame(&self) -> Frame<'_> {
        let step = self.step.expect("a wait has found one");
        let pixels = match step.light {
            Some(_) => &self.relit,
            None => stage().show.picture(step.picture),
        };
        let (width, height) = SIZE_PX;
        let image = GreyImage::new(pixels, width, height, width).expect("a whole picture");
        Frame {
            pixels: Pixels::Grey8(image),
            capture_time_ns: step.time_ns,
            instant: MarkedInstant::ExposureMiddle,
            ready_at: Instant::now(),
            late: false,
        }
    }

    fn counts(&self) -> Counts {
        self.counts
    }
}

/// Not a test: the process that [`lose`] starts.
#[test]
#[ignore = "the box of the other tests"]
fn the_box() {
    let Ok(words) = env::var(BOX) else { return };
    let words: Vec<u64> = words.split(' ').map(|word| word.parse().expect("a number")).collect();
    let [seed, frames, loss_every, person, dark, strange] = words[..] else { panic!("{words:?}") };
    logger::install(log::LevelFilter::Info);
    let blob = std::fs::read("box.plb").expect("a configuration");
    let config = Config::decode(&blob).expect("a sound one");
    let [person, dark, strange] = [person, dark, strange].map(|count| count as usize);
    let kinds = Kinds { person, dark, strange };
    let play = Play {
        script: Script::new(seed, kinds, Some(loss_every)),
        random: ChaCha8Rng::seed_from_u64(!seed),
        left: frames,
        waiting: None,
        is_silent: false,
        fails: 0,
    };
    let show = Show::read(Path::new("pictures.grey"), kinds);
    assert!(STAGE.set(Stage { show, play: Mutex::new(play) }).is_ok(), "there is one box");

    let mut pipeline = Box::new(Pipeline::new());
    pipeline.configure(&config).expect("it can be tracked with");
    let file = FileLink::open(Path::new("packets.bin")).expect("a file can be made");
    let ports = Ports { file: Some(file), ..Ports::default() };
    let identity = Identity {
        start: random::start(),
        name: Identity::name_of(&config),
        key: Ok(None),
        store: None,
        reset_reason: ResetReason::Unknown,
        start_count: None,
        refusal: None,
    };
    let setup = Setup {
        links: Links::new(ports, identity, None),
        boot_count: None,
        reset_reason: ResetReason::Unknown,
        watchdog: None,
        triggers: Triggers::default(),
        store: None,
        may_reboot: false,
        updates: &mut Updates::impossible("it is no box of its own"),
    };
    let capture = config.capture.clone().expect("it names a camera");
    let mut camera = Camera::<Played>::new(capture, SIZE_PX, config.readout_ns);
    let before = allocation::allocations();
    let ended = session::run(&mut pipeline, &config, &mut camera, setup, &IS_OVER);
    println!("{}", ended.summary);
    println!("allocations of all: {}", allocation::allocations() - before);
}

/// Plays so many frames with a loss in each block of this many; asserts all that must hold, and returns
/// the judge's sums as text, the number of losses, and what became of the memory.
fn lose(frames: u64, loss_every: u64, person: usize) -> (String, u64, Growth) {
    let seed = seed();
    let folder = tempfile::tempdir().expect("a temporary directory");
    let scene = set_up(folder.path(), person);
    let Kinds { person, dark, strange } = scene.show.kinds;
    scene.show.write(&folder.path().join("pictures.grey"));
    let [record, said] = ["packets.bin", "said.txt"].map(|name| folder.path().join(name));
    let file = File::create(&said).expect("there is room");
    let child = Command::new(env::current_exe().expect("this program"))
        // With one thread the runner of the tests waits without a clock: otherwise it says after a
        // minute that this test is slow, for which it allocates.
        .args(["--exact", "lost::the_box", "--ignored", "--nocapture", "--test-threads=1"])
        .env(BOX, format!("{seed} {frames} {loss_every} {person} {dark} {strange}"))
        .current_dir(folder.path())
        .stdout(file.try_clone().expect("a second handle"))
        .stderr(file)
        .spawn()
        .expect("the box starts");
    let script = Script::new(seed, scene.show.kinds, Some(loss_every));
    let mut judge = Judge::new(script, Clock::Camera, &scene.truth);
    let mut the_box = TheBox(child);
    let growth = watch(&mut the_box, &record, &mut judge, frames);
    let said = std::fs::read_to_string(said).expect("it has said something");
    assert!(the_box.succeeds(), "{said}");

    let losses = judge.script.happened(Happening::Loss);
    assert_eq!((judge.seen, losses), (frames, frames / loss_every), "{said}");
    let health = judge.health.as_ref().expect("it sends one at its end");
    let missed = judge.script.missed;
    assert_eq!(u64::from(health.camera_losses), losses, "{health:?}");
    assert_eq!(u64::from(health.frames_missed), missed, "{health:?}");
    assert_eq!(health.camera, CameraState::Ended);
    let counted = format!(
        "frames       {frames} (0 late), 0 dropped, {missed} missed, camera lost {losses} times"
    );
    for words in
        [counted.as_str(), "allocations  0 after the first frame", " sent, 0 dropped (file"]
    {
        assert!(said.contains(words), "{words}:\n{said}");
    }
    let all = said.lines().find(|line| line.starts_with("allocations of all")).unwrap_or_default();
    (format!("{}; {all}", sums(&judge)), losses, growth)
}

#[test]
fn a_camera_that_is_lost_a_few_times_is_counted_each_time() {
    if is_too_slow() {
        return;
    }
    println!("{}", lose(2_000, 200, 24).0);
}

/// Minutes.
#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_thousand_losses_of_the_camera_in_a_million_frames() {
    const LOSS_EVERY: u64 = 1_000;
    let frames = repetitions(1_000_000) as u64 / LOSS_EVERY * LOSS_EVERY;
    assert!(frames > 2 * SETTLED, "{frames} frames show nothing of the memory");
    let (sums, losses, growth) = lose(frames, LOSS_EVERY, 240);
    let memory = assert_constant(&growth);
    evidence(
        "losses of the camera in the box's session (a played device behind its camera's own logic), in \
         as many frames with lens caps, strangers, dropouts and changes of light at random",
        &format!("{losses} losses in {frames} frames"),
        &format!("each counted in Health and in the summary; {sums}; {memory}"),
    );
}
