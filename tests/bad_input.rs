//! Input that cannot be used: `plumb` says which file, which field and what to
//! do, in one line, with exit code 2, and keeps what it had written.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use common::binary;
use common::photographer::y4m;
use plumbline::lens::Lens;
use plumbline_files::camera;
use plumbline_files::lens_id::LensId;
use plumbline_files::scene::{self, SceneFile};
use tempfile::TempDir;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const FRAME_BYTES: usize = WIDTH * HEIGHT + 6;

const CAMERA: &str = "width_px = 320\nheight_px = 240\nfx_px = 400.0\nfy_px = 400.0\ncx_px = 159.5\ncy_px = 119.5\nmodel = \"radial2\"\ndistortion = [0.0, 0.0]\n";

const TARGETS: &str = "[[target]]\nname = \"lumbar\"\nrole = \"lower\"\ncolumns = 6\nrows = 5\npitch_mm = 12.0\n\n[[target]]\nname = \"shoulder\"\nrole = \"upper\"\ncolumns = 5\nrows = 4\npitch_mm = 12.0\n";

/// A directory with good files, one of which each test spoils.
struct Setting(TempDir);

impl Setting {
    fn new() -> Self {
        let setting = Self(tempfile::tempdir().expect("a temporary directory"));
        setting.write("camera.toml", CAMERA.as_bytes());
        setting.write("targets.toml", TARGETS.as_bytes());
        setting.write("frames.y4m", &video(3));
        setting
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).expect("a file in the temporary directory");
    }

    /// `plumb track` over `inputs`, run inside the directory, poses to `poses.csv`.
    fn track(&self, inputs: &[&str]) -> Output {
        binary::plumb()
            .args(["track", "--camera", "camera.toml", "--targets", "targets.toml"])
            .args(["--force", "--out", "poses.csv"])
            .args(inputs)
            .current_dir(self.0.path())
            .output()
            .expect("plumb runs")
    }

    fn rows(&self) -> usize {
        std::fs::read_to_string(self.path("poses.csv")).expect("poses.csv").lines().count() - 1
    }
}

/// Grey frames as Y4M.
fn video(frames: usize) -> Vec<u8> {
    y4m(&vec![vec![100; WIDTH * HEIGHT]; frames], [WIDTH as u16, HEIGHT as u16], 60)
}

/// Exit code 2, and one `error:` line with all of `parts`.
#[track_caller]
fn assert_refused(output: &Output, parts: &[&str]) {
    let text = binary::messages(output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    let errors: Vec<&str> = text.lines().filter(|line| line.starts_with("error: ")).collect();
    let [error] = errors[..] else { panic!("not one error line: {text}") };
    for part in parts {
        assert!(error.contains(part), "no {part:?} in: {error}");
    }
    // What was found, and what to do about it.
    assert!(error.contains("; "), "{error}");
}

#[test]
fn good_files_are_not_refused() {
    let setting = Setting::new();
    let output = setting.track(&["frames.y4m"]);
    let text = binary::messages(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains("3 frames of 320 x 240 px"), "{text}");
    assert!(text.contains("lumbar: found in 0 of 3 frames; not found: "), "{text}");
    assert_eq!(setting.rows(), 2 * 3);
}

#[test]
fn a_truncated_video_keeps_the_rows_of_its_complete_frames() {
    let setting = Setting::new();
    let whole = video(3);
    setting.write("frames.y4m", &whole[..whole.len() - 1000]);
    let found = format!("ends {} bytes into this frame of {FRAME_BYTES} bytes", FRAME_BYTES - 1000);
    let remedy = "the 2 complete frames before it were used";
    let output = setting.track(&["frames.y4m"]);
    assert_refused(&output, &["frames.y4m: frame 2: ", &found, remedy]);
    assert_eq!(setting.rows(), 2 * 2);
}

#[test]
fn a_truncated_stream_keeps_its_rows_on_standard_output() {
    let setting = Setting::new();
    let mut child = binary::plumb()
        .args(["track", "--camera", "camera.toml", "--targets", "targets.toml", "-"])
        .current_dir(setting.0.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("plumb runs");
    let whole = video(2);
    let mut input = child.stdin.take().expect("a pipe");
    input.write_all(&whole[..whole.len() - 1]).expect("plumb reads");
    drop(input);
    let output = child.wait_with_output().expect("plumb ends");
    assert_refused(&output, &["standard input: frame 1: "]);
    assert_eq!(String::from_utf8_lossy(&output.stdout).lines().count(), 1 + 2);
}

/// Only `plumb track` can scale a camera.
#[test]
fn a_calibration_of_another_size_is_refused_with_what_the_command_can_do() {
    let setting = Setting::new();
    setting.write("camera.toml", CAMERA.replace("width_px = 320", "width_px = 640").as_bytes());
    let board =
        "[[target]]\nname = \"board\"\nrole = \"scene\"\ncolumns = 6\nrows = 5\npitch_mm = 12.0\n";
    setting.write("board.toml", board.as_bytes());
    let parts = ["frames.y4m: frame size: 320 x 240 px", "use the calibration made at this size"];
    let tracked = setting.track(&["frames.y4m"]);
    assert_refused(&tracked, &[&parts[..], &[", or --scale-camera if these"]].concat());
    let scene = binary::plumb()
        .args(["scene", "--camera", "camera.toml", "--targets", "board.toml"])
        .args(["--out", "scene.toml", "frames.y4m"])
        .current_dir(setting.0.path())
        .output()
        .expect("plumb runs");
    assert_refused(&scene, &parts);
    assert!(!binary::messages(&scene).contains("--scale-camera"));
}

#[test]
fn a_fault_in_the_second_input_keeps_the_rows_of_the_first() {
    let setting = Setting::new();
    setting.write("small.y4m", b"YUV4MPEG2 W64 H64 F60:1 Cmono\n");
    let output = setting.track(&["frames.y4m", "small.y4m"]);
    assert_refused(&output, &["small.y4m: frame size: 64 x 64 px", "frames.y4m have 320 x 240 px"]);
    assert_eq!(setting.rows(), 2 * 3);
    setting.write("broken.png", b"\x89PNG\r\n\x1a\n and then nothing sensible");
    let output = setting.track(&["frames.y4m", "broken.png"]);
    assert_refused(&output, &["broken.png: ", "cannot be decoded"]);
    assert_eq!(setting.rows(), 2 * 3);
}

#[test]
fn a_wrong_number_of_columns_is_refused() {
    let cases = [
        (
            "columns = 6",
            "columns = 2",
            "columns, rows of target \"lumbar\": 2 x 5",
            "INNER corners",
        ),
        (
            "columns = 6",
            "columns = 60",
            "columns, rows of target \"lumbar\": 60 x 5",
            "at most 120",
        ),
        ("columns = 6", "columns = -6", "columns (line 4)", "-6"),
        ("columns = 6", "columns = 4", "columns, rows of target \"shoulder\"", "told apart"),
        ("columns = 6\n", "", "columns: missing field", "columns, rows, pitch_mm"),
        ("columns = 6", "colums = 6", "colums (line 4): unknown field", "columns, rows, pitch_mm"),
    ];
    for (good, bad, field, found) in cases {
        let setting = Setting::new();
        setting.write("targets.toml", TARGETS.replacen(good, bad, 1).as_bytes());
        let output = setting.track(&["frames.y4m"]);
        assert_refused(&output, &["targets.toml: ", field, found]);
        assert!(!setting.path("poses.csv").exists(), "nothing was tracked: {bad}");
    }
}

#[test]
fn a_camera_file_with_a_missing_or_absurd_field_is_refused() {
    let cases = [
        ("fx_px = 400.0\n", "", "camera.toml: fx_px: missing field"),
        ("fx_px = 400.0", "fx_px = -400.0", "camera.toml: fx_px, fy_px: -400 and 400; "),
        ("fx_px = 400.0", "fx_px = nan", "camera.toml: fx_px, fy_px: NaN and 400; "),
        ("fx_px = 400.0", "fx_px = \"wide\"", "camera.toml: fx_px (line 3): "),
        ("cx_px = 159.5", "cx_px = 1e9", "camera.toml: cx_px, cy_px: 1000000000"),
        ("[0.0, 0.0]", "[-9.0, 0.0]", "camera.toml: distortion: [-9.0, 0.0"),
        ("[0.0, 0.0]", "[0.0]", "camera.toml: distortion: 1 coefficient; "),
        ("radial2", "fisheye", "camera.toml: model (line 7): unknown variant `fisheye`"),
        ("width_px = 320", "width_px = 0", "camera.toml: width_px, height_px: 0 and 240; "),
        ("width_px = 320", "width_px 320", "camera.toml: (line 1): "),
        (
            "width_px = 320",
            "width_px = 640",
            "frames.y4m: frame size: 320 x 240 px, but camera.toml",
        ),
    ];
    for (good, bad, found) in cases {
        let setting = Setting::new();
        setting.write("camera.toml", CAMERA.replacen(good, bad, 1).as_bytes());
        assert_refused(&setting.track(&["frames.y4m"]), &[found]);
    }
}

#[test]
fn bad_calibrations_of_other_programs_are_refused() {
    let yaml = "image_width: 320\nimage_height: 240\ndistortion_model: plumb_bob\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [400, 0, 160, 0, 400, 120, 0, 0, 1]\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0, 0, 0, 0, 0]\n";
    let cases = [
        ("plumb_bob", "mei", "camera.toml: distortion_model: \"mei\""),
        ("plumb_bob", "equidistant", "camera.toml: distortion_coefficients: 5 coefficients; "),
        ("[400, 0", "[400, 0, 0", "camera.toml: camera_matrix: 3 x 3, 10 numbers"),
        ("[400, 0", "[400; 0", "camera.toml: line 7: "),
        ("[0, 0, 0, 0, 0]", "[0, 0, 0, 0, 0, 1, 0]", "camera.toml: distortion_coefficients: 7"),
        ("image_width: 320\n", "", "camera.toml: image_width: missing field"),
        ("camera_matrix:", "camera_matrix: [", "camera.toml: line "),
    ];
    for (good, bad, found) in cases {
        let setting = Setting::new();
        setting.write("camera.toml", yaml.replacen(good, bad, 1).as_bytes());
        assert_refused(&setting.track(&["frames.y4m"]), &[found]);
    }
    let setting = Setting::new();
    setting.write("camera.toml", yaml.as_bytes());
    assert_eq!(setting.track(&["frames.y4m"]).status.code(), Some(0));
}

#[test]
fn files_that_cannot_be_read_are_named() {
    let setting = Setting::new();
    assert_refused(&setting.track(&["none.y4m"]), &["none.y4m: no such file", "check the path"]);
    assert_refused(&setting.track(&["."]), &[".: a directory; name its files"]);
    setting.write("notes.png", b"these are notes");
    assert_refused(&setting.track(&["notes.png"]), &["notes.png: neither an image", "convert it"]);
    setting.write("empty.y4m", b"");
    assert_refused(&setting.track(&["empty.y4m"]), &["empty.y4m: empty"]);
    setting.write("huge.y4m", b"YUV4MPEG2 W99999 H99999 F60:1 Cmono\nFRAME\n");
    let found = "huge.y4m: header, W and H: 99999 x 99999 px; each side must lie within";
    assert_refused(&setting.track(&["huge.y4m"]), &[found]);
    assert_refused(&setting.track(&["--fps", "0", "frames.y4m"]), &["--fps: 0 frames per second"]);
    assert_refused(&setting.track(&["--scene", "none.toml", "frames.y4m"]), &["none.toml: "]);
    std::fs::remove_file(setting.path("camera.toml")).expect("the camera file");
    assert_refused(&setting.track(&["frames.y4m"]), &["camera.toml: no such file"]);
    std::fs::copy(setting.path("frames.y4m"), setting.path("camera.toml")).expect("a copy");
    assert_refused(&setting.track(&["frames.y4m"]), &["camera.toml: "]);
    assert!(!setting.path("poses.csv").exists(), "nothing was tracked");
}

#[test]
fn an_output_never_overwrites_an_input() {
    let setting = Setting::new();
    let output = binary::plumb()
        .args(["track", "--camera", "camera.toml", "--targets", "targets.toml"])
        .args(["--out", "./frames.y4m", "frames.y4m"])
        .current_dir(setting.0.path())
        .output()
        .expect("plumb runs");
    assert_refused(&output, &["--out: ", "one of the inputs"]);
    assert_eq!(std::fs::read(setting.path("frames.y4m")).expect("the video"), video(3));
    assert_refused(
        &binary::plumb()
            .args(["track", "--camera", "camera.toml", "--targets", "targets.toml"])
            .args(["--out", "camera.toml/place.csv", "frames.y4m"])
            .current_dir(setting.0.path())
            .output()
            .expect("plumb runs"),
        &["camera.toml: ", "a file is in its place"],
    );
    let scene = "theta1_rad = 0\ntheta2_rad = 0\ntheta3_rad = 0\nx_mm = 0\ny_mm = 0\nz_mm = 1000\n";
    setting.write("scene.toml", scene.as_bytes());
    let described = ["--camera", "camera.toml", "--targets", "targets.toml"];
    for (command, out, frames) in [
        ("track", "scene.toml", Some("frames.y4m")),
        ("provision", "scene.toml", None),
        ("provision", "./camera.toml", None),
    ] {
        let output = binary::plumb()
            .arg(command)
            .args(described)
            .args(["--scene", "scene.toml", "--out", out])
            .args(frames)
            .current_dir(setting.0.path())
            .output()
            .expect("plumb runs");
        assert_refused(&output, &["--out: ", out, "one of the inputs"]);
    }
    assert_eq!(std::fs::read(setting.path("scene.toml")).expect("the scene"), scene.as_bytes());
    assert_eq!(std::fs::read(setting.path("camera.toml")).expect("the camera"), CAMERA.as_bytes());
}

#[test]
fn an_output_replaces_nothing_unless_it_is_told_to() {
    let setting = Setting::new();
    for (command, out, more) in [
        ("track", "poses.csv", &["frames.y4m"][..]),
        ("provision", "config.plb", &["--udp", "127.0.0.1:4210"]),
    ] {
        let run = |force: &[&str]| {
            binary::plumb()
                .args([command, "--camera", "camera.toml", "--targets", "targets.toml"])
                .args(["--out", out])
                .args(more)
                .args(force)
                .current_dir(setting.0.path())
                .output()
                .expect("plumb runs")
        };
        setting.write(out, b"precious");
        assert_refused(&run(&[]), &[out, "exists already", "--force"]);
        assert_eq!(std::fs::read(setting.path(out)).expect("the file"), b"precious");
        let output = run(&["--force"]);
        assert_eq!(output.status.code(), Some(0), "{}", binary::messages(&output));
        assert_ne!(std::fs::read(setting.path(out)).expect("the file"), b"precious");
    }
}

#[test]
fn a_file_where_a_directory_belongs_is_named_with_a_remedy() {
    let setting = Setting::new();
    let output = setting.track(&["--draw", "camera.toml", "frames.y4m"]);
    assert_refused(&output, &["camera.toml: ", "another name"]);
}

#[test]
fn a_negative_number_is_a_value_and_not_an_option() {
    let setting = Setting::new();
    assert_refused(&setting.track(&["--fps", "-5", "frames.y4m"]), &["--fps: -5 frames"]);
    let simulate = |gradient: &str| {
        binary::plumb()
            .args(["simulate", "--frames", "1", "--out", "trial", "--gradient", gradient])
            .current_dir(setting.0.path())
            .output()
            .expect("plumb runs")
    };
    assert_refused(&simulate("-5"), &["--gradient: -5; give a value from -1 to 1"]);
    let darker = simulate("-0.5");
    assert_eq!(darker.status.code(), Some(0), "{}", binary::messages(&darker));
}

/// Through another lens the same board would have had another pose.
#[test]
fn a_scene_of_another_camera_is_refused_and_one_of_no_camera_warned_of() {
    let setting = Setting::new();
    let lens = camera::parse(CAMERA, "").expect("a good camera").lens;
    let with_scene = |camera: Option<Lens>, arguments: &[&str]| {
        let camera = camera.as_ref().map(LensId::of);
        let scene = SceneFile { cam_from_scene_theta: [0.0; 6], source: String::new(), camera };
        setting.write("scene.toml", scene::to_toml(&scene).as_bytes());
        binary::plumb()
            .args(arguments)
            .args(["--camera", "camera.toml", "--targets", "targets.toml"])
            .args(["--scene", "scene.toml", "--force"])
            .current_dir(setting.0.path())
            .output()
            .expect("plumb runs")
    };
    for arguments in [
        &["provision", "--udp", "127.0.0.1:5005", "--out", "config.plb"][..],
        &["track", "--out", "poses.csv", "frames.y4m"],
    ] {
        let other = Lens { cx_px: lens.cx_px + 1.0, ..lens };
        let parts = ["scene.toml: camera: ", "another lens, 320 x 240 px", "`plumb scene`"];
        assert_refused(&with_scene(Some(other), arguments), &parts);
        let own = binary::messages(&with_scene(Some(lens), arguments));
        assert!(!own.contains("warning") && !own.contains("error"), "{own}");
        let unsaid = with_scene(None, arguments);
        let text = binary::messages(&unsaid);
        assert_eq!(unsaid.status.code(), Some(0), "{text}");
        assert!(text.contains("warning: scene.toml: it does not say through which"), "{text}");
    }
}

#[test]
fn a_provisioned_box_gets_what_the_files_say_or_nothing() {
    let setting = Setting::new();
    let provision = |links: &[&str]| {
        binary::plumb()
            .args(["provision", "--camera", "camera.toml", "--targets", "targets.toml"])
            .args(["--out", "config.plb"])
            .args(links)
            .current_dir(setting.0.path())
            .output()
            .expect("plumb runs")
    };
    assert_refused(&provision(&["--udp", "nowhere"]), &["--udp: ", "HOST:PORT"]);
    assert_refused(&provision(&["--udp", "0.0.0.0:0"]), &["--udp: "]);
    assert_refused(&provision(&["--serial", "/dev/ttyS0"]), &["--serial: ", "DEVICE:BAUD"]);
    assert_refused(&provision(&["--serial", "/dev/ttyS0:1"]), &["--serial: ", "baud"]);
    assert!(!setting.path("config.plb").exists());
    let output = provision(&["--udp", "127.0.0.1:5005", "--serial", "/dev/ttyS0:115200"]);
    assert_eq!(output.status.code(), Some(0), "{}", binary::messages(&output));
    let config = read_config(&setting.path("config.plb"));
    assert_eq!(config.links.udp, Some(([127, 0, 0, 1], 5005).into()));
    assert_eq!(config.targets[1].name.as_str(), "shoulder");
    assert_eq!(config.cam_from_scene_theta, None);
}

#[test]
fn a_box_file_s_fault_is_named_by_field() {
    let setting = Setting::new();
    let capture = "[capture]\ndriver = \"v4l2\"\npixel_format = \"grey\"\nrate_hz = 60\n";
    let provision = |text: &str, links: &[&str]| {
        std::fs::write(setting.path("box.toml"), text).expect("a file");
        binary::plumb()
            .args(["provision", "--camera", "camera.toml", "--targets", "targets.toml"])
            .args(["--box", "box.toml", "--out", "config.plb"])
            .args(links)
            .current_dir(setting.0.path())
            .output()
            .expect("plumb runs")
    };
    for (text, parts) in [
        (
            "[capture]\ndriver = \"v4l2\"\npixel_format = \"rgb\"",
            ["box.toml: pixel_format", "nv12"],
        ),
        (&*format!("{capture}exposure_us = 20000"), ["box.toml: capture.exposure_us", "frame"]),
        (&*format!("{capture}[machine]\nrealtime_priority = 120"), ["box.toml: machine.", "99"]),
        ("[network]\naddress = \"192.168.1.5\"", ["box.toml: network.address", "/24"]),
        ("[links]\nserial = \"/dev/ttyS0:1\"", ["box.toml: links.serial: ", "baud"]),
        ("[links]\nudp = \"0.0.0.0:1\"", ["box.toml: links.udp: ", "address"]),
        (capture, ["box.toml: links: neither udp nor serial", "--udp"]),
    ] {
        assert_refused(&provision(text, &[]), &parts);
    }
    assert!(!setting.path("config.plb").exists());
    // The command line has the last word on the links, and leaves the rest.
    let text = format!("{capture}[links]\nudp = \"10.0.0.1:4210\"");
    let output = provision(&text, &["--udp", "10.0.0.2:4210"]);
    assert_eq!(output.status.code(), Some(0), "{}", binary::messages(&output));
    let config = read_config(&setting.path("config.plb"));
    assert_eq!(config.links.udp, Some(([10, 0, 0, 2], 4210).into()));
    assert_eq!(config.capture.expect("a camera").rate_hz, 60.0);
    assert_eq!(config.machine.watchdog_s, Some(15));
}

fn read_config(path: &Path) -> plumbline::config::Config {
    plumbline::config::Config::decode(&std::fs::read(path).expect("a blob")).expect("a good blob")
}
