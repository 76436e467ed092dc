//! The box's program as a child process that is never left behind.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdin, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

/// Where the program is when it is not beside this one.
const VARIABLE: &str = "PLUMBLINE_BOARD";

/// The program ends by itself this long after its last frame, or is made to.
const END_MAX: Duration = Duration::from_secs(5);

/// Where an installation has it, from the directory of this program.
const INSTALLED: &str = "../lib/plumb/plumbline-board";

/// The box's program: `PLUMBLINE_BOARD`, or beside this program, or where an installation has it.
pub fn program() -> Result<PathBuf> {
    let (path, remedy) = match std::env::var_os(VARIABLE) {
        Some(path) => (PathBuf::from(path), format!("correct the variable {VARIABLE}")),
        None if !cfg!(target_os = "linux") => bail!(
            "the box's program runs on Linux only, so that there is no demonstration here; \
             `plumb simulate` renders a person for `plumb track`, and `plumb receive` takes the \
             packets of a box in the network"
        ),
        None => {
            let own = std::env::current_exe().context("this program cannot find itself")?;
            let remedy = format!(
                "build it with `cargo build --release --locked -p plumbline-board`, or set {VARIABLE} to it"
            );
            let places = [own.with_file_name("plumbline-board"), own.with_file_name(INSTALLED)];
            let [beside, _] = &places;
            let found = places.iter().find(|it| it.is_file()).unwrap_or(beside);
            (found.clone(), remedy)
        }
    };
    if !path.is_file() {
        bail!("the box's program is not at {}: {remedy}", path.display());
    }
    Ok(path)
}

/// The running program; killed when dropped.
pub struct TheBox {
    child: Child,
    stderr: Option<JoinHandle<String>>,
}

impl TheBox {
    /// Starts it: frames from its standard input, packets to `udp`.
    pub fn start(program: &Path, config: &Path, udp: &str) -> Result<Self> {
        let mut child = Command::new(program)
            .arg("--config")
            .arg(config)
            .args(["--replay", "-", "--unpaced", "--udp", udp])
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| {
                format!("the box's program {} cannot be started", program.display())
            })?;
        let stderr = child.stderr.take().map(|pipe| std::thread::spawn(move || read_all(pipe)));
        Ok(Self { child, stderr })
    }

    /// Where its frames go in; dropping it ends the recording.
    pub fn take_input(&mut self) -> ChildStdin {
        self.child.stdin.take().expect("asked for when it was started, and taken once")
    }

    /// Whether it has ended.
    pub fn is_gone(&mut self) -> Result<bool> {
        Ok(self.status()?.is_some())
    }

    /// Ends it at once.
    pub fn kill(&mut self) {
        // It may have ended already, which is as well.
        let _ = self.child.kill();
    }

    /// Waits for the program to end, and kills it if it does not. Returns what it
    /// printed on standard error, and its exit status.
    pub fn finish(mut self) -> Result<String> {
        let give_up = Instant::now() + END_MAX;
        while self.status()?.is_none() {
            if Instant::now() > give_up {
                self.kill();
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let status = self.child.wait().context("the box's program cannot be waited for")?;
        let said = self.stderr.take().and_then(|reader| reader.join().ok()).unwrap_or_default();
        let said = said.trim();
        let said = if said.is_empty() { "(nothing)" } else { said };
        Ok(format!("{said} ({status})"))
    }

    fn status(&mut self) -> Result<Option<ExitStatus>> {
        self.child.try_wait().context("the box's program cannot be watched")
    }
}

impl Drop for TheBox {
    fn drop(&mut self) {
        self.kill();
        // Reaps it; it has been killed, so that this does not wait long.
        let _ = self.child.wait();
    }
}

fn read_all(mut pipe: ChildStderr) -> String {
    let mut bytes = Vec::new();
    // What came before an error is still worth showing.
    let _ = pipe.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}
