//! The whole way of a technician with a box that nobody can log in to: from the printed sheet
//! to the sway of a person, with the programs that a technician has, over the network. Only
//! what stands in front of the camera is rendered.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Vector3, Vector6};
use plumbline::packet::{Message, decode_datagram};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_files::poses::{self, PoseRow};
use plumbline_render::simulate::Simulation;
use plumbline_stream::transport::Raw;
use plumbline_test_support::free_port;
use plumbline_trial::journal::{Content, Reader};
use plumbline_trial::names;

use crate::machine::{HOST, Host, Machine, Parts, image, wait_for_packet};
use crate::scene::{self, FRAMES, SCENE};
use common::binary;
use common::photographer::{photographs, posed};

/// The checks of `plumb doctor` that compare the box's time with this computer's.
const TIMED: [&str; 3] = ["frames", "latency", "rate"];

/// Those that fail where frames are missing: the body moves further from one frame to the next, so
/// that a target is searched for again.
const FOLLOWING: [&str; 2] = ["lumbar poses", "shoulder poses"];

/// Where other work takes the processor, the emulated box is slower than its own clock says, and
/// those checks rightly fail. This is how much slower it must have been: the rate's tolerance.
const SLOWER_PPM: f64 = -20_000.0;

/// A wire that is high while a trial is recorded, at the board's chip.
const OUTPUT: &str =
    "[trigger]\nchip = \"9030000.pl061\"\noutput_line = 1\noutput_marks = \"recording\"\n";

/// The wire rises and falls within this time of the recording, of which most is this computer's: it is
/// busy.
const RECORDING_S_MAX: f64 = 2.0;

/// How much faster the box's clock ran than this computer's, as the doctor says: "drift -301 +-".
fn drift_ppm(said: &str) -> Option<f64> {
    said.split_once("drift ")?.1.split_whitespace().next()?.parse().ok()
}

/// The technician's computer, and the box at the other end of its network.
struct Ward {
    directory: tempfile::TempDir,
    port: u16,
    disk: PathBuf,
}

impl Ward {
    fn new() -> Self {
        let directory = tempfile::tempdir().expect("a temporary directory");
        let port = free_port();
        let disk = scene::empty_disk(directory.path());
        Self { directory, port, disk }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    /// Runs `plumb` in the technician's directory; what it says.
    #[track_caller]
    fn plumb(&self, arguments: &str) -> String {
        binary::plumb_in(self.directory.path(), arguments)
    }

    /// As [`plumb`](Self::plumb), with where the box is heard.
    #[track_caller]
    fn plumb_here(&self, arguments: &str, option: &str) -> String {
        self.plumb(&format!("{arguments} {option} 127.0.0.1:{}", self.port))
    }

    /// Switches the box on, with these frames in front of its camera.
    fn switch_on(&self, frames_disk: &Path) -> (Machine, Host) {
        let [a, b, c, d] = HOST;
        let host = Host::new();
        let parts = Parts {
            kernel: image("vmlinuz"),
            initramfs: vec![image("initramfs"), image("overlay.cpio")],
            command_line: &format!(
                "rdinit=/test/start test.gain test.output plumbline.udp={a}.{b}.{c}.{d}:{}",
                self.port
            ),
            boot_disk: &self.disk,
            boot_disk_options: "",
            frames_disk: Some(frames_disk),
            device_tree: None,
        };
        (Machine::start(&parts, &host), host)
    }

    /// What `plumb doctor` says of the box, and its exit code.
    fn doctor(&self) -> (Option<i32>, String) {
        let arguments = format!("doctor --udp 127.0.0.1:{}", self.port);
        binary::plumb_judges_in(self.directory.path(), &arguments)
    }

    fn frames(&self, name: &str, poses: &[Pose<Cam, Target>]) -> PathBuf {
        let all: Vec<u8> = posed(SCENE.simulation.camera(), &board(), poses, 2)
            .into_iter()
            .flat_map(|photograph| photograph.samples)
            .collect();
        let path = self.path(name);
        std::fs::write(&path, all).expect("the frames are written");
        path
    }
}

fn board() -> TargetGeometry {
    TargetGeometry::checker(9, 6, 20.0, Origin::Center, Role::Scene, [0.0; 3]).expect("a board")
}

#[test]
fn from_a_printed_sheet_to_the_sway_of_a_person() {
    let ward = Ward::new();
    let simulation = &SCENE.simulation;
    // Print, and describe the box.
    ward.plumb("target --standard --out pair.pdf --targets targets.toml");
    ward.plumb("target --grid 9x6 --pitch-mm 20 --out board.pdf --targets targets.toml --add");
    ward.plumb("provision --new-box box.toml");
    let settings = std::fs::read_to_string(ward.path("box.toml")).expect("it was written");
    let [a, b, c, d] = HOST;
    let settings = settings
        .replace("192.168.1.20:4210", &format!("{a}.{b}.{c}.{d}:{}", ward.port))
        .replace("rate_hz = 60.0", "rate_hz = 24.0\ngain = 45.0");
    let settings = format!("{settings}\n{OUTPUT}");
    std::fs::write(ward.path("box.toml"), settings).expect("it is edited");
    // The box has nothing yet. Its card gets a key and what it takes to look for the board.
    let said = ward.plumb(
        "provision --uncalibrated 1280x720 --targets targets.toml --box box.toml --new-key \
         --card boot.img",
    );
    assert!(said.contains("a new key"), "{said}");

    // The board is held before the camera, here and there.
    let shown = photographs(simulation.camera(), &board(), 24, 1);
    let shown: Vec<u8> = shown.into_iter().flat_map(|photograph| photograph.samples).collect();
    std::fs::write(ward.path("board.grey"), shown).expect("the frames are written");
    let (machine, _host) = ward.switch_on(&ward.path("board.grey"));
    wait_for_packet(ward.port);
    ward.plumb_here("aim --stills photos --count 12 --every 1 --board 9x6", "--udp");
    drop(machine);
    let photographs: Vec<String> = (1..=12).map(|n| format!("photos/still-{n:02}.png")).collect();
    ward.plumb(&format!(
        "calibrate --board 9x6 --pitch-mm 20 --out camera.toml {}",
        photographs.join(" ")
    ));

    // The board stands where the person will stand.
    let upright = simulation.config().cam_from_scene().expect("the simulation has a scene");
    let stands = Pose::<Cam, Target>::new(upright.rotation, upright.translation_mm);
    let (machine, _host) = ward.switch_on(&ward.frames("standing.grey", &[stands; 12]));
    wait_for_packet(ward.port);
    ward.plumb_here(
        "provision --camera camera.toml --targets targets.toml --box box.toml --send",
        "--via-udp",
    );
    let said = ward.plumb_here("aim --expose --store", "--udp");
    assert!(said.contains("found: the camera's own exposure, gain "), "{said}");
    let said = ward.plumb_here("scene --store --seconds 2", "--udp");
    assert!(!said.contains("warning"), "{said}");
    drop(machine);

    // A person.
    let (machine, _host) = ward.switch_on(&SCENE.frames_disk);
    wait_for_packet(ward.port);
    ward.plumb_here("receive --anyway --frames 150 --out received", "--udp");
    let (code, said) = ward.doctor();
    let failed: Vec<&str> = said.lines().filter_map(|line| line.strip_prefix("FAIL  ")).collect();
    let is_one_of = |checks: &[&str], line: &str| checks.iter().any(|it| line.starts_with(it));
    let lacks_frames = failed.iter().any(|line| line.starts_with("frames"));
    let is_timed =
        |line: &&str| is_one_of(&TIMED, line) || lacks_frames && is_one_of(&FOLLOWING, line);
    let drift_ppm = drift_ppm(&said);
    let is_slow = drift_ppm.is_some_and(|drift| drift < SLOWER_PPM);
    let is_excused = failed.is_empty() || is_slow && failed.iter().all(is_timed);
    assert!(is_excused, "the clocks' drift {drift_ppm:?} ppm: {failed:?}");
    assert_eq!(code, Some(i32::from(!failed.is_empty())), "{:?}", said.lines().next());
    let driven = driven_until_low(&machine);
    drop(machine);
    assert_high_while_recorded(&driven, &frame_times_s(&ward.path("received")));
    let enough = if is_slow { ENOUGH_OF_A_SLOW_BOX } else { ENOUGH };
    let rows = poses::read(&ward.path("received/samples.csv")).expect("a recording");
    assert_sways_as(&rows, enough, simulation);
}

/// What the box has driven its wire to, as the kernel has traced it: seconds of the box's clock, and
/// whether high.
fn driven(console: &str) -> Vec<(f64, bool)> {
    let lines = console.lines().filter_map(|line| line.trim().strip_prefix("test: driven "));
    let one = |text: &str| {
        let (time_s, level) = text.split_once(' ')?;
        Some((time_s.parse().ok()?, level == "high"))
    };
    lines.map(|text| one(text).expect("a time and a level")).collect()
}

/// The same, once the wire has been high and is low again. On a busy computer the box tells much later
/// what it has driven when: all that measures comes before that.
fn driven_until_low(machine: &Machine) -> Vec<(f64, bool)> {
    machine.wait_for("the wire to fall", |seen| {
        let driven = driven(&seen.console);
        let rise = driven.iter().position(|(_, is_high)| *is_high)?;
        driven[rise..].iter().any(|(_, is_high)| !is_high).then_some(driven)
    })
}

/// When the frames of a trial were captured, by the box's clock.
fn frame_times_s(trial: &Path) -> Vec<f64> {
    let mut journal = Reader::open(&trial.join(names::JOURNAL)).expect("a journal");
    let mut times_s = Vec::new();
    while let Some(entry) = journal.next_entry().expect("it can be read") {
        let Content::Raw(Raw::Datagram(bytes)) = entry.content else { continue };
        if let Ok(Message::Pose(pose)) = decode_datagram(&bytes).map(|it| it.message) {
            times_s.push(1e-9 * pose.capture_time_ns as f64);
        }
    }
    times_s.sort_by(f64::total_cmp);
    times_s
}

/// The wire has risen once, with the first frames, and fallen once, with the last.
fn assert_high_while_recorded(driven: &[(f64, bool)], frames_s: &[f64]) {
    let (first_s, last_s) = (frames_s[0], frames_s[frames_s.len() - 1]);
    let levels: Vec<bool> = driven.iter().map(|(_, is_high)| *is_high).collect();
    // Low when the box opens it.
    assert_eq!(levels, [false, true, false], "{driven:?}, frames from {first_s} to {last_s}");
    let (rises_s, falls_s) = (driven[1].0 - first_s, driven[2].0 - last_s);
    println!(
        "the wire rises {rises_s:.3} s after the first frame, falls {falls_s:.3} s after the last"
    );
    // It may rise with the first word of the box, before a frame.
    assert!(rises_s.abs() < RECORDING_S_MAX, "{driven:?}, {first_s} to {last_s}");
    assert!((0.0..RECORDING_S_MAX).contains(&falls_s), "{driven:?}, {first_s} to {last_s}");
}

/// The trunk points of both targets in one frame: lumbar, then shoulder.
type Points = [Vector3<f64>; 2];

const NAMES: [&str; 2] = ["lumbar", "shoulder"];

fn received_points(rows: &[PoseRow]) -> Vec<Points> {
    let of = |name: &str| -> BTreeMap<u64, Vector3<f64>> {
        let rows = rows.iter().filter(|row| row.target == name);
        let point = |row: &PoseRow| Some(Vector3::new(row.ap_mm?, row.ml_mm?, row.si_mm?));
        rows.filter_map(|row| Some((row.frame, point(row)?))).collect()
    };
    let [lumbar, shoulder] = NAMES.map(of);
    lumbar.iter().filter_map(|(frame, &point)| Some([point, *shoulder.get(frame)?])).collect()
}

/// Frames of the disk that pass at most from one received frame to the next: half a second.
const PASSED_MAX: usize = 12;

/// Which frame of the disk each received one is, by its positions, which are the truth's but for a
/// constant that is found along the way. Each coordinate counts by its precision: the depth is known
/// ten times worse than the others. But while the body reverses its sideways motion, only the depth
/// tells one frame from the next.
fn frames_of(received: &[Points], known: &[Points]) -> Vec<usize> {
    let weighted = |[lumbar, shoulder]: &Points| {
        Vector6::new(0.1 * lumbar.x, lumbar.y, lumbar.z, 0.1 * shoulder.x, shoulder.y, shoulder.z)
    };
    let mean =
        |points: &[Points]| points.iter().map(weighted).sum::<Vector6<f64>>() / points.len() as f64;
    let mut offset_mm = mean(received) - mean(known);
    let mut frames = Vec::new();
    for _ in 0..20 {
        // Forwards, and then backwards.
        let frame = |moment: usize| moment.min(2 * known.len() - 1 - moment);
        let moments = in_order(received.len(), 2 * known.len(), |place, moment| {
            let at_mm = weighted(&received[place]) - offset_mm;
            (weighted(&known[frame(moment)]) - at_mm).norm_squared()
        });
        frames = moments.into_iter().map(frame).collect();
        let pairs = received.iter().zip(&frames);
        offset_mm = pairs
            .map(|(points, &frame)| weighted(points) - weighted(&known[frame]))
            .sum::<Vector6<f64>>()
            / received.len() as f64;
    }
    frames
}

/// The moments of a round that is played again and again, of the least total cost: each is at most
/// [`PASSED_MAX`] later than the one before. A body passes the same place more than once, so that
/// the nearest frame alone may be of another time.
fn in_order(places: usize, moments: usize, cost: impl Fn(usize, usize) -> f64) -> Vec<usize> {
    let earlier = |moment: usize, passed: usize| (moment + moments - passed) % moments;
    let mut totals: Vec<f64> = (0..moments).map(|moment| cost(0, moment)).collect();
    // For each place after the first and each moment: how many passed since the place before.
    let mut passed: Vec<Vec<usize>> = Vec::new();
    for place in 1..places {
        let total = |moment: usize, passed: usize| totals[earlier(moment, passed)];
        let best: Vec<usize> = (0..moments)
            .map(|moment| {
                (0..=PASSED_MAX)
                    .min_by(|&one, &other| total(moment, one).total_cmp(&total(moment, other)))
                    .expect("there are several")
            })
            .collect();
        totals =
            (0..moments).map(|moment| total(moment, best[moment]) + cost(place, moment)).collect();
        passed.push(best);
    }
    let last = (0..moments).min_by(|&one, &other| totals[one].total_cmp(&totals[other]));
    let mut moment = last.expect("a round has moments");
    let mut found = vec![moment];
    for passed in passed.iter().rev() {
        moment = earlier(moment, passed[moment]);
        found.push(moment);
    }
    found.reverse();
    found
}

/// The trunk points of each frame of the disk.
fn known_points(simulation: &Simulation) -> Vec<Points> {
    let of_frame = |frame: u64| {
        let truth = simulation.truth(frame);
        [0, 1].map(|target| {
            let point = &truth.targets[target].trunk_point;
            Vector3::new(point.ap_mm, point.ml_mm, point.si_mm)
        })
    };
    (0..FRAMES as u64).map(of_frame).collect()
}

/// How far the sway of the worst frame is from the truth's, for each trunk point and axis.
fn worst_errors_mm(received: &[Points], known: &[Points], frames: &[usize]) -> Points {
    [0, 1].map(|target| {
        let pairs = received.iter().zip(frames);
        let errors: Vec<Vector3<f64>> =
            pairs.map(|(points, &frame)| points[target] - known[frame][target]).collect();
        let mean = errors.iter().sum::<Vector3<f64>>() / errors.len() as f64;
        let farthest = |worst: Vector3<f64>, error: &Vector3<f64>| worst.sup(&(error - mean).abs());
        errors.iter().fold(Vector3::zeros(), farthest)
    })
}

/// The largest errors of a frame's sway, in AP, ML and SI. In depth, six standard deviations of the
/// shoulder's; in the others the trunk point, which is not in the target's plane, takes its errors
/// from the target's orientation.
const ERRORS_MM_MAX: [f64; 3] = [0.3, 0.1, 0.1];

/// Whether some error is larger than it may be.
fn is_wrong(worst_mm: &Vector3<f64>) -> bool {
    worst_mm.iter().zip(ERRORS_MM_MAX).any(|(worst_mm, max_mm)| *worst_mm >= max_mm)
}

/// How many of the 150 frames have both trunk points: at first each target is searched for.
const ENOUGH: usize = 140;

/// The same where the processor was taken from the box: it misses frames, after which a target may
/// have to be searched for again. These still tell the sway.
const ENOUGH_OF_A_SLOW_BOX: usize = 100;

/// Every frame's trunk points, about their mean, are the truth's.
fn assert_sways_as(rows: &[PoseRow], enough: usize, simulation: &Simulation) {
    let received = received_points(rows);
    assert!(received.len() >= enough, "{} of 150 frames have both trunk points", received.len());
    let known = known_points(simulation);
    let worst_mm = worst_errors_mm(&received, &known, &frames_of(&received, &known));
    for (name, worst_mm) in NAMES.iter().zip(worst_mm) {
        println!("{name}: worst error of a frame's sway {worst_mm:.3?} mm");
        assert!(!is_wrong(&worst_mm), "{name}: {worst_mm} mm");
    }
}

/// Frames are recognised by the positions that are then compared: that must not hide a sway of the
/// wrong size. The recognition can shift a sideways error into depth, but not out of sight.
#[test]
fn a_sway_of_the_wrong_size_is_seen() {
    let known = known_points(&SCENE.simulation);
    // Each frame once, but for some that are seen twice and some that are passed over.
    let played = (0..150).map(|step| (step + step / 25 - step / 40) % (2 * FRAMES));
    let frames: Vec<usize> = played.map(|step| step.min(2 * FRAMES - 1 - step)).collect();
    for (axis, scale, is_seen) in [(0, 0.9, true), (1, 0.9, true), (1, 1.1, true), (0, 1.0, false)]
    {
        let received: Vec<Points> = frames
            .iter()
            .map(|&frame| {
                known[frame].map(|mut point| {
                    point[axis] *= scale;
                    point
                })
            })
            .collect();
        let worst_mm = worst_errors_mm(&received, &known, &frames_of(&received, &known));
        assert_eq!(worst_mm.iter().any(is_wrong), is_seen, "{axis} {scale}: {worst_mm:?}");
    }
}
