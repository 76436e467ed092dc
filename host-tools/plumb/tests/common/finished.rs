//! `plumb` as it ended, within a time.

use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A run that takes longer has failed; a loaded machine renders slowly.
const PATIENCE: Duration = Duration::from_secs(240);

/// What is left of a run.
pub struct Finished {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

/// Runs `plumb` in a directory, with no terminal.
pub fn plumb(directory: &Path, arguments: &[&str]) -> Finished {
    let mut command = plumbline_test_support::command(env!("CARGO_BIN_EXE_plumb"));
    command.args(arguments).current_dir(directory).stdin(Stdio::null());
    ended(command)
}

/// Runs a command to its end.
pub fn ended(mut command: Command) -> Finished {
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let give_up = Instant::now() + PATIENCE;
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if Instant::now() > give_up {
            let _ = child.kill();
            panic!("{command:?} never ended");
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    let (mut stdout, mut stderr) = (String::new(), String::new());
    child.stdout.take().unwrap().read_to_string(&mut stdout).unwrap();
    child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
    assert!(!stderr.contains("panicked"), "{stderr}");
    Finished { code: status.code(), stdout, stderr }
}
