//! Reaps child processes: the first process of a computer is the parent of every orphan,
//! and must wait for each. A separate thread does, which sleeps until a child ends.
//!
//! It also starts the network process, and starts it again if it ends. Only starting
//! allocates. The output of that process and its children comes through a pipe, so that
//! it reaches the hosts and not only the console.

use std::io::{PipeReader, Read};
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::time::Duration;

use nix::errno::Errno;
use nix::sys::wait::{WaitStatus, waitpid};
use nix::unistd::Pid;
use plumbline::config::Network;

use super::network;
use crate::logger;

/// The first pause before the network process is started again; doubled each time.
const BACK_OFF_MIN: Duration = Duration::from_secs(1);

/// The longest such pause.
const BACK_OFF_MAX: Duration = Duration::from_secs(60);

/// Starting a process needs little stack, and its pages are locked in memory.
const STACK_BYTES: usize = 128 << 10;

/// Longer lines are passed on in pieces.
const LINE_BYTES_MAX: usize = 256;

/// Starts the network process, and reaps all children from now on.
pub fn look_after(network: Network) {
    let mut command = Command::new("/proc/self/exe");
    command.arg0(network::NAME).args(network::arguments(network));
    match listen_to(&mut command) {
        Ok(output) => spawn("network output", move || pass_on(output, log_line)),
        // The output still goes to the console.
        Err(error) => log::error!("the network process's output cannot be read: {error}"),
    }
    spawn("children", move || run(command));
}

fn spawn(name: &str, body: impl FnOnce() + Send + 'static) {
    let thread = std::thread::Builder::new().name(name.into()).stack_size(STACK_BYTES);
    if let Err(error) = thread.spawn(body) {
        // A box with a serial line still measures.
        log::error!("no network: no thread can be started: {error}");
    }
}

/// Both outputs of the program, through one pipe.
fn listen_to(command: &mut Command) -> std::io::Result<PipeReader> {
    let (reader, writer) = std::io::pipe()?;
    command.stdout(writer.try_clone()?).stderr(writer);
    Ok(reader)
}

/// Passes each line to `tell`, with its severity. Does not allocate, as it runs
/// while frames are measured.
fn pass_on(mut output: impl Read, mut tell: impl FnMut(log::Level, &str)) {
    let (mut line, mut byte) = (heapless::Vec::<u8, LINE_BYTES_MAX>::new(), [0]);
    while let Ok(1) = output.read(&mut byte) {
        let [byte] = byte;
        if byte != b'\n' {
            // There is room: a full line has been passed on.
            let _ = line.push(byte);
        }
        if byte == b'\n' || line.is_full() {
            let text = str::from_utf8(&line).unwrap_or("(a line that is not text)").trim();
            if !text.is_empty() {
                // The format of the logger and of the DHCP client's program; anything else
                // is part of a panic message.
                let known = text.split_once(": ");
                let known = known.and_then(|(level, text)| Some((level.parse().ok()?, text)));
                let (level, text) = known.unwrap_or((log::Level::Warn, text));
                tell(level, text);
            }
            line.clear();
        }
    }
}

fn log_line(level: log::Level, text: &str) {
    log::log!(target: logger::NETWORK, level, "{text}");
}

fn run(mut command: Command) {
    let mut pause = BACK_OFF_MIN;
    loop {
        match command.spawn() {
            Ok(child) => {
                // A process ID fits, as the system's own type is an i32.
                let status = reap_until_end_of(Pid::from_raw(child.id() as i32));
                log::error!("the network process ended: {status:?}; starting it again");
            }
            Err(error) => log::error!("the network process cannot be started: {error}"),
        }
        std::thread::sleep(pause);
        pause = (pause * 2).min(BACK_OFF_MAX);
    }
}

/// Reaps every child that ends, up to and including `awaited`.
fn reap_until_end_of(awaited: Pid) -> Option<WaitStatus> {
    loop {
        match waitpid(None, None) {
            Ok(status) if status.pid() == Some(awaited) => return Some(status),
            Ok(_) | Err(Errno::EINTR) => {}
            // There are no children left.
            Err(_) => return None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_passed_on_with_their_severity() {
        let long = "x".repeat(LINE_BYTES_MAX + 1);
        let output = format!(
            "INFO: network: eth0 has 10.0.2.15/24\r\nERROR: none: at all\n\nthread panicked\n{long}\n"
        );
        let mut told = Vec::new();
        pass_on(output.as_bytes(), |level, text| told.push((level, text.to_owned())));
        let expected = [
            (log::Level::Info, "network: eth0 has 10.0.2.15/24"),
            (log::Level::Error, "none: at all"),
            (log::Level::Warn, "thread panicked"),
            (log::Level::Warn, &long[1..]),
            (log::Level::Warn, "x"),
        ];
        assert_eq!(told, expected.map(|(level, text)| (level, text.to_owned())));
    }

    #[test]
    fn both_outputs_are_read() {
        let mut command = Command::new("sh");
        command.args(["-c", "echo INFO: one; echo WARN: two >&2"]);
        let output = listen_to(&mut command).unwrap();
        assert!(command.status().unwrap().success());
        // The command holds the pipe open for the next start.
        drop(command);
        let mut told = Vec::new();
        pass_on(output, |level, text| told.push((level, text.to_owned())));
        let expected = [(log::Level::Info, "one".into()), (log::Level::Warn, "two".into())];
        assert_eq!(told, expected);
    }
}
