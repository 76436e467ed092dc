//! `plumb aim` and the box's real program, which replays a rendered recording without end.

use crate::common::{finished, keys};
use plumbline_stream::fixture::known_box;
use plumbline_stream::transport::{Event, Link, Transport, Udp};
use plumbline_test_support::{board_beside, command, free_port};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::common::finished::{Finished, plumb};
use image::Rgb;
use plumbline::packet::{Message, Packet};
use plumbline_files::{camera, poses};

const FRAMES: usize = 6;
const WIDTH: usize = 1456;
const HEIGHT: usize = 1088;

/// The colour of the rings about corners.
const ORANGE: Rgb<u8> = Rgb([255, 165, 0]);

/// The box's program on a recording; killed when dropped.
struct TheBox {
    child: Child,
    folder: tempfile::TempDir,
    port: u16,
    frames: Vec<Vec<u8>>,
}

impl TheBox {
    /// `None` where the program is not built.
    fn start() -> Option<Self> {
        let board = board_beside(env!("CARGO_BIN_EXE_plumb"))?;
        let folder = tempfile::tempdir().unwrap();
        let frames = FRAMES.to_string();
        done(folder.path(), &["simulate", "--frames", &frames, "--out", "trial"]);
        let settings = "device = \"ward 3\"\nserial_number = \"7\"\n[capture]\ndriver = \"v4l2\"\n\
                        pixel_format = \"grey\"\nrate_hz = 10.0\n";
        std::fs::write(folder.path().join("box.toml"), settings).unwrap();
        keys::known(folder.path());
        let port = free_port();
        let udp = format!("127.0.0.1:{port}");
        let mut provision = vec!["provision", "--box", "box.toml", "--out", "box.plb"];
        provision.extend(["--camera", "trial/camera.toml", "--targets", "trial/targets.toml"]);
        done(folder.path(), &[&provision[..], &["--udp", &udp]].concat());
        let mut child = command(board)
            .args(["--config", "box.plb", "--replay", "-", "--fps", "10", "--udp", &udp])
            .current_dir(folder.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let video = std::fs::read(folder.path().join("trial/frames.y4m")).unwrap();
        let header = video.iter().position(|&byte| byte == b'\n').unwrap() + 1;
        let frame = b"FRAME\n".len() + WIDTH * HEIGHT;
        let frames: Vec<_> =
            video[header..].chunks(frame).map(|frame| frame[6..].to_vec()).collect();
        assert_eq!(frames.len(), FRAMES);
        let mut input = child.stdin.take().unwrap();
        std::thread::spawn(move || {
            // Until the program is gone.
            let mut more = input.write_all(&video[..header]);
            while more.is_ok() {
                more = input.write_all(&video[header..]);
            }
        });
        Some(Self { child, folder, port, frames })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn aim(&self, arguments: &[&str]) -> Finished {
        let udp = format!("127.0.0.1:{}", self.port);
        plumb(self.folder.path(), &[&["aim", "--udp", &udp], arguments].concat())
    }

    /// Fails unless the box says that it is not in set-up mode. The first Health may still say that
    /// it is, in the instant between the end of the mode's time and the end of the mode; by itself
    /// the mode would end 20 s after the last request.
    #[track_caller]
    fn assert_has_left_set_up_mode(&self) {
        let udp = Udp::bind(([127, 0, 0, 1], self.port).into()).unwrap();
        let mut link = Link::new(udp, vec![known_box()], "a test");
        let give_up = Instant::now() + Duration::from_secs(30);
        let mut left_s = Vec::new();
        while left_s.len() < 3 && !left_s.contains(&0) {
            assert!(Instant::now() < give_up, "no health in time");
            let mut take = |event| {
                if let Event::Packet(Packet { message: Message::Health(health), .. }) = event {
                    left_s.push(health.aiming_s);
                }
            };
            link.poll(&mut take).unwrap();
        }
        assert!(left_s.contains(&0), "{left_s:?} s are left");
    }
}

impl Drop for TheBox {
    fn drop(&mut self) {
        // It may have ended already, which is as well.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[track_caller]
fn done(folder: &Path, arguments: &[&str]) {
    let finished = plumb(folder, arguments);
    assert_eq!(finished.code, Some(0), "{arguments:?}: {}", finished.stderr);
}

#[track_caller]
fn says(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
}

#[test]
fn what_the_camera_sees_is_shown_and_kept() {
    let Some(the_box) = TheBox::start() else { return };
    let finished = the_box.aim(&["--png", "view.png", "--once"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    says(&finished.stdout, &["lumbar: tracking, focus 9", "shoulder: tracking, focus 9"]);
    says(&finished.stdout, &["contrast 0.7", "px per square", "mm away, depth +-0.0"]);
    says(&finished.stderr, &["\"ward 3\"", "is in set-up mode", "has left set-up mode"]);
    let picture = image::open(the_box.path("view.png")).unwrap().into_rgb8();
    assert_eq!(picture.dimensions(), (WIDTH as u32 / 2, HEIGHT as u32 / 2));
    let lens = camera::read(&the_box.path("trial/camera.toml")).unwrap().lens;
    for row in poses::read(&the_box.path("trial/truth.csv")).unwrap().iter().take(2) {
        let [x, y, z] = [row.x_mm, row.y_mm, row.z_mm].map(Option::unwrap);
        let middle_px = lens.project(&nalgebra::Vector3::new(x, y, z)).unwrap() / 2.0;
        let near = picture.enumerate_pixels().filter(|(x, y, pixel)| {
            let off_px = nalgebra::Vector2::new(f64::from(*x), f64::from(*y)) - middle_px;
            **pixel == ORANGE && off_px.norm() < 50.0
        });
        let near = near.count();
        assert!(near > 100, "{}: {near} pixels of rings", row.target);
    }

    let stills = ["--stills", "photos", "--count", "2", "--every", "0.1", "--board", "6x5"];
    let finished = the_box.aim(&stills);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    says(
        &finished.stdout,
        &["still-01.png: 1456 x 1088 px; the board is found", "next hold it in the upper left"],
    );
    for name in ["photos/still-01.png", "photos/still-02.png"] {
        let still = image::open(the_box.path(name)).unwrap();
        let image::DynamicImage::ImageLuma8(still) = still else { panic!("{still:?}") };
        assert!(the_box.frames.contains(still.as_raw()), "{name} is none of the frames");
    }
    let finished = the_box.aim(&stills);
    assert_eq!(finished.code, Some(2));
    says(&finished.stderr, &["photos/still-01.png: exists already", "--force"]);
    assert_eq!(the_box.aim(&[&stills[..], &["--force"]].concat()).code, Some(0));

    // Numbers alone, for a while.
    let finished = the_box.aim(&["--duration", "2.5"]);
    assert_eq!(finished.code, Some(0), "{}", finished.stderr);
    assert!(finished.stdout.matches("frame: level").count() >= 2, "{}", finished.stdout);

    let finished = the_box.aim(&["--expose", "--store"]);
    assert_eq!(finished.code, Some(2));
    says(&finished.stderr, &["the box refuses the exposure: a recording is exposed as it is"]);
    says(&finished.stderr, &["has left set-up mode"]);
    the_box.assert_has_left_set_up_mode();
}

/// A box that is off is told of, not shown as it was.
#[test]
fn a_box_that_falls_silent_is_given_up() {
    let Some(mut the_box) = TheBox::start() else { return };
    let udp = format!("127.0.0.1:{}", the_box.port);
    let mut command = command(env!("CARGO_BIN_EXE_plumb"));
    command.args(["aim", "--udp", &udp, "--png", "view.png"]);
    command.args(["--stills", "photos", "--count", "900", "--every", "0.5"]);
    command.current_dir(the_box.folder.path()).stdin(Stdio::null());
    command.env("XDG_DATA_HOME", keys::data(the_box.folder.path()));
    let running = std::thread::spawn(move || finished::ended(command));
    let give_up = Instant::now() + Duration::from_secs(60);
    while !(the_box.path("view.png").exists() && the_box.path("photos/still-01.png").exists()) {
        assert!(Instant::now() < give_up, "no picture in time");
        std::thread::sleep(Duration::from_millis(20));
    }
    the_box.child.kill().unwrap();
    the_box.child.wait().unwrap();
    let killed = Instant::now();
    let finished = running.join().unwrap();
    let (stdout, stderr) = (&finished.stdout, &finished.stderr);
    assert_eq!(finished.code, Some(2), "{stderr}");
    assert!(killed.elapsed() < Duration::from_secs(20), "{:?}", killed.elapsed());
    says(stderr, &["the box is no longer heard; check its power and its link"]);
    says(stderr, &["set-up mode ends by itself", "it ends by itself within 20 s"]);
    // A loaded machine may miss one of the seven.
    assert!(stdout.matches("nothing heard from the box for ").count() >= 4, "{stdout}");
}

#[test]
fn wrong_inputs_are_named_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    keys::known(folder.path());
    let port = free_port();
    let udp = format!("127.0.0.1:{port}");
    std::fs::create_dir(folder.path().join("directory.png")).unwrap();
    std::fs::write(folder.path().join("file"), "").unwrap();
    let cases: [(&[&str], &[&str]); 12] = [
        (&["--count", "3"], &["--stills"]),
        (&["--store"], &["--expose"]),
        (&["--duration", "1801"], &["give 1800 seconds at most"]),
        (&["--stills", "."], &["--stills: without a terminal", "--count"]),
        (&["--reduction", "17"], &["1..=16"]),
        (
            &["--stills", ".", "--count", "1", "--board", "2x2"],
            &["--board: 2 x 2 corners; a grid needs at least 3"],
        ),
        (&["--png", "/dev/full"], &["--png: /dev/full does not end in .png"]),
        (&["--png", "directory.png"], &["--png: directory.png is not a file"]),
        (&["--png", "none/view.png"], &["--png: none is not a directory; make the directory"]),
        (&["--png", "file/view.png"], &["--png: file is not a directory"]),
        (&["--stills", "file", "--count", "1"], &["--stills: file is not a directory"]),
        (&[], &["no box is heard; check that the box is on"]),
    ];
    for (arguments, parts) in cases {
        let finished = plumb(folder.path(), &[&["aim", "--udp", &udp], arguments].concat());
        assert_eq!(finished.code, Some(2), "{arguments:?}");
        says(&finished.stderr, parts);
    }
}
