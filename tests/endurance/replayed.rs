//! The program itself, as people have it, fed as fast as it takes frames.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::process::{ChildStdin, Stdio};
use std::time::Duration;

use nix::fcntl::{FcntlArg, fcntl};
use plumbline::config::BLOB_BYTES_MAX;
use plumbline_test_support::{
    Absent, command, evidence, is_emulated, program, repetitions, seed, skip,
};

use crate::judge::{Clock, Judge};
use crate::script::{Happening, Script, Step};
use crate::show::{RATE_HZ, SIZE_PX, Scene, Show};
use crate::watched::{Growth, SETTLED, TheBox, watch};

/// A camera that gives nothing for longer than a second is silent.
const SILENCE: Duration = Duration::from_millis(1_300);

/// By this much the box's own memory may grow after it has settled: nothing, but for what the kernel
/// counts in pages of several threads, and updates late.
pub const GROWTH_KB_MAX: u64 = 64;

/// Writes what a box is started with, and returns what the camera will show.
pub fn set_up(folder: &Path, person: usize) -> Scene {
    let scene = Scene::new(person);
    let mut blob = vec![0; BLOB_BYTES_MAX];
    let blob = scene.config.encode(&mut blob).expect("a sound configuration");
    std::fs::write(folder.join("box.plb"), blob).expect("there is room");
    scene
}

/// Where rendering and tracking take a hundred times as long there is nothing to learn that the same
/// code has not shown already.
pub fn is_too_slow() -> bool {
    if is_emulated() {
        skip(Absent::Emulator, "an emulator is too slow for thousands of frames");
    }
    is_emulated()
}

/// The camera's side of the pipe.
fn feed(mut box_in: ChildStdin, show: &Show, steps: impl Iterator<Item = Step>, silent_every: u64) {
    // Larger than a frame, so that the two processes rarely wait for each other. Where that is not
    // allowed it is only slower.
    let _ = fcntl(&box_in, FcntlArg::F_SETPIPE_SZ(1 << 20));
    let (width, height) = SIZE_PX;
    let mut relit = vec![0; width * height];
    let feed = || -> io::Result<()> {
        writeln!(box_in, "YUV4MPEG2 W{width} H{height} F{RATE_HZ}:1 Ip A1:1 Cmono")?;
        for (index, step) in (1..).zip(steps) {
            let picture = show.picture(step.picture);
            box_in.write_all(b"FRAME\n")?;
            match step.light {
                Some(light) => {
                    light.show(picture, &mut relit);
                    box_in.write_all(&relit)?;
                }
                None => box_in.write_all(picture)?,
            }
            if index % silent_every == 0 {
                std::thread::sleep(SILENCE);
            }
        }
        Ok(())
    };
    // A box that ends early is judged by what it says.
    let _ = feed();
}

/// Feeds this many frames with this many silences; asserts all that must hold, and returns the judge's
/// sums as text, and what became of the memory.
fn replay(frames: u64, silences: u64, person: usize) -> (String, Growth) {
    let seed = seed();
    let folder = tempfile::tempdir().expect("a temporary directory");
    let scene = set_up(folder.path(), person);
    let script = Script::new(seed, scene.show.kinds, None);
    let [record, said] = ["packets.bin", "said.txt"].map(|name| folder.path().join(name));
    let file = File::create(&said).expect("there is room");
    let mut child = command(program("plumbline-board").expect("the box's program builds"))
        .args(["--config", "box.plb", "--replay", "-", "--unpaced", "--record", "packets.bin"])
        .current_dir(folder.path())
        .stdin(Stdio::piped())
        .stdout(file.try_clone().expect("a second handle"))
        .stderr(file)
        .spawn()
        .expect("the box starts");
    let box_in = child.stdin.take().expect("it is piped");
    let mut the_box = TheBox(child);
    let mut judge = Judge::new(script.clone(), Clock::Recording, &scene.truth);
    let growth = std::thread::scope(|scope| {
        let steps = script.take(frames as usize);
        let silent_every = frames / silences;
        let show = &scene.show;
        scope.spawn(move || feed(box_in, show, steps, silent_every));
        watch(&mut the_box, &record, &mut judge, frames)
    });
    let said = std::fs::read_to_string(said).expect("it has said something");
    assert!(the_box.succeeds(), "{said}");
    assert_eq!(judge.seen, frames, "{said}");
    let counted =
        format!("frames       {frames} (0 late), 0 dropped, 0 missed, camera lost 0 times");
    for words in
        [counted.as_str(), "allocations  0 after the first frame", " sent, 0 dropped (file"]
    {
        assert!(said.contains(words), "{words}:\n{said}");
    }
    assert!(judge.stalls >= silences, "{} silences of {silences} were said", judge.stalls);
    (sums(&judge), growth)
}

/// What was seen, for people.
pub fn sums(judge: &Judge) -> String {
    let Judge { measured, worst_mm, worst_deviations, searched, empty, healths, stalls, .. } =
        judge;
    let happened = |what| judge.script.happened(what);
    format!(
        "{} lens caps, {} strangers, {} dropouts ({} frames), {} changes of light, {stalls} silences: \
         {measured} poses, at most {worst_mm:.2} mm and {worst_deviations:.1} of their own standard \
         deviations off, {searched} searches, none invented in {empty} frames of nobody; heap 0 in \
         {healths} Healths",
        happened(Happening::LensCap),
        happened(Happening::Stranger),
        happened(Happening::Dropout),
        judge.script.missed,
        happened(Happening::Relit),
    )
}

/// Memory that has not grown, for people.
pub fn assert_constant(Growth { settled, largest }: &Growth) -> String {
    let grown_kb = largest.1.own_kb - settled.1.own_kb;
    assert!(grown_kb <= GROWTH_KB_MAX, "{grown_kb} KB: {settled:?}, {largest:?}");
    let (begin, own_kb, resident_kb) = (settled.0, settled.1.own_kb, settled.1.resident_kb);
    format!(
        "memory {own_kb} KB ({resident_kb} KB resident) at frame {begin}, +{grown_kb} KB at most"
    )
}

#[test]
fn whatever_a_camera_sees_for_a_while_the_program_is_right_about_it() {
    if is_too_slow() {
        return;
    }
    println!("{}", replay(2_000, 1, 24).0);
}

/// Minutes, with the program as people have it.
#[test]
#[ignore = "takes minutes: cargo xtask test endurance"]
fn a_million_frames_through_the_program() {
    let frames = repetitions(1_000_000) as u64;
    assert!(frames > 2 * SETTLED, "{frames} frames show nothing of the memory");
    let (sums, growth) = replay(frames, 5, 240);
    let memory = assert_constant(&growth);
    evidence(
        "frames through the box's program (its released build, --replay - --unpaced), with lens caps, \
         strangers, dropouts, changes of light and silences at random",
        &format!("{frames} frames"),
        &format!("all answered in order; {sums}; {memory}"),
    );
}
