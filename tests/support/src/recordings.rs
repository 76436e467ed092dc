//! Rendered recordings that several tests read, including those that run in an emulator, which
//! would take minutes for what this machine renders in seconds.

use std::env;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use crate::root;

/// Names the directory with the recordings; without it they are made where they are missing.
pub const RECORDINGS: &str = "PLUMBLINE_RECORDINGS";

/// Names the directory with this project's programs, where they are built; without it they are
/// built when a test starts one.
pub const PROGRAMS: &str = "PLUMBLINE_PROGRAMS";

/// Frames of the standard recording.
pub const STANDARD_FRAMES: usize = 130;

/// [`STANDARD_FRAMES`] of the standard scene at 60 Hz. From frame 43 to 116 an arm hides the lower
/// target completely, for longer than a target coasts.
pub const STANDARD: &str = "standard";

/// Frames of the recording of a person.
pub const PERSON_FRAMES: usize = 240;

/// [`PERSON_FRAMES`] of the standard scene at 60 Hz, in which nothing is hidden.
pub const PERSON: &str = "person";

/// One frame of a camera with 640 x 480 pixels.
pub const VGA: &str = "vga";

/// The frames of a recording, as Y4M.
pub const FRAMES_FILE: &str = "frames.y4m";
/// The true poses of a recording, with the columns of `plumb track`.
pub const TRUTH_FILE: &str = "truth.csv";
/// The configuration that a recording is tracked with.
pub const CONFIG_FILE: &str = "box.plb";

const SETTINGS: [(&str, &[&str]); 3] = [
    (STANDARD, &["--frames", "130", "--occlude", "lumbar:0.72:1.94:1"]),
    (PERSON, &["--frames", "240"]),
    (VGA, &["--frames", "1", "--lens", "vga"]),
];

/// The folder of a recording, which is made first if it is missing.
///
/// # Panics
/// When it cannot be made.
pub fn recording(name: &str) -> PathBuf {
    static MADE: OnceLock<PathBuf> = OnceLock::new();
    let make = || {
        let target = env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
        let plumb = program("plumb").expect("plumb builds");
        make_recordings(&root().join(target), &plumb).expect("the recordings can be made")
    };
    let directory = || env::var_os(RECORDINGS).map_or_else(make, PathBuf::from);
    MADE.get_or_init(directory).join(name)
}

/// Makes those recordings below the target directory that are missing or older than `plumb`, which
/// renders them. Returns the directory that they are in.
///
/// # Errors
/// When a recording cannot be written.
pub fn make_recordings(target: &Path, plumb: &Path) -> Result<PathBuf, String> {
    let directory = target.join("recordings");
    let named = |error| format!("{}: {error}", directory.display());
    fs::create_dir_all(&directory).map_err(named)?;
    // Several test programs may need them at the same time.
    let lock = File::create(directory.join("lock")).map_err(named)?;
    lock.lock().map_err(named)?;
    let built = fs::metadata(plumb).and_then(|about| about.modified()).map_err(named)?;
    for (name, settings) in SETTINGS {
        let folder = directory.join(name);
        // This file is written last.
        let made = fs::metadata(folder.join(CONFIG_FILE)).and_then(|about| about.modified());
        if made.is_ok_and(|made| made > built) {
            continue;
        }
        make(plumb, &folder, settings)?;
    }
    Ok(directory)
}

fn make(plumb: &Path, folder: &Path, settings: &[&str]) -> Result<(), String> {
    let place = |name: &str| folder.join(name).display().to_string();
    let [out, camera, targets, scene, config] =
        ["", "camera.toml", "targets.toml", "scene.toml", CONFIG_FILE].map(place);
    let mut simulate = Command::new(plumb);
    simulate.args(["simulate", "--force", "--out", &out]).args(settings);
    run(simulate)?;
    let mut provision = Command::new(plumb);
    provision.args(["provision", "--force", "--camera", &camera, "--targets", &targets]);
    provision.args(["--scene", &scene, "--out", &config]);
    run(provision).map(drop)
}

/// The program of the package with the same name: where [`PROGRAMS`] says, or otherwise built here.
///
/// # Errors
/// When it does not build.
pub fn program(name: &str) -> Result<PathBuf, String> {
    if let Some(directory) = env::var_os(PROGRAMS) {
        return Ok(Path::new(&directory).join(name));
    }
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    // Of the whole workspace, so that what it uses has the features, and so the builds, of the tests.
    cargo.args(["build", "--quiet", "--locked", "--workspace", "--bin", name]);
    cargo.arg("--message-format=json-render-diagnostics");
    let messages = run(cargo)?;
    let executable = messages
        .lines()
        .filter_map(|line| line.split_once("\"executable\":\"")?.1.split('"').next())
        .next_back();
    executable.map(PathBuf::from).ok_or_else(|| format!("cargo names no program of {name}"))
}

/// What a program prints; an error where it fails.
fn run(mut command: Command) -> Result<String, String> {
    command.current_dir(root()).stdin(Stdio::null()).stderr(Stdio::inherit());
    let output = command.output().map_err(|error| format!("{command:?}: {error}"))?;
    if !output.status.success() {
        return Err(format!("{command:?}: {}", output.status));
    }
    String::from_utf8(output.stdout).map_err(|error| format!("{command:?}: {error}"))
}
