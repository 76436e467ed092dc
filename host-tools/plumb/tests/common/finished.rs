//! `plumb` as it ended, within a time.

use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
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
    command.env("XDG_DATA_HOME", super::keys::data(directory));
    ended(command)
}

/// Runs a command to its end.
pub fn ended(mut command: Command) -> Finished {
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // Read while it runs: a pipe that is full would hold it up.
    let output = reading(child.stdout.take().unwrap());
    let errors = reading(child.stderr.take().unwrap());
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
    let (stdout, stderr) = (output.join().unwrap(), errors.join().unwrap());
    assert!(!stderr.contains("panicked"), "{stderr}");
    Finished { code: status.code(), stdout, stderr }
}

/// Ctrl-C, as far as a program notices.
pub fn interrupt(child: &Child) {
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
}

/// Reads a pipe to its end.
fn reading(mut pipe: impl Read + Send + 'static) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let mut text = String::new();
        pipe.read_to_string(&mut text).unwrap();
        text
    })
}
