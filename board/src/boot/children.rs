//! The first process of a computer is the parent of every orphan, and must take
//! note of the end of each. A thread of its own does, asleep until one ends.
//!
//! It also starts the process that looks after the network, again if that ends.
//! Only starting takes heap. What that process and its own children say comes
//! through a pipe, so that it reaches the hosts and not the console alone.

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

/// Pause before the network process is started again; doubled each time.
const BACK_OFF_MIN: Duration = Duration::from_secs(1);

/// The longest such pause.
const BACK_OFF_MAX: Duration = Duration::from_secs(60);

/// Starting a process needs little; the pages are locked in memory.
const STACK_BYTES: usize = 128 << 10;

/// A longer line is passed on in pieces.
const LINE_BYTES_MAX: usize = 256;

/// Starts the network's process and looks after all children from now on.
pub fn look_after(network: Network) {
    let mut command = Command::new("/proc/self/exe");
    command.arg0(network::NAME).args(network::arguments(network));
    match listen_to(&mut command) {
        Ok(said) => spawn("network's words", move || pass_on(said, tell)),
        // It is still on the console.
        Err(error) => log::error!("the network's process cannot be listened to: {error}"),
    }
    spawn("children", move || run(command));
}

fn spawn(name: &str, body: impl FnOnce() + Send + 'static) {
    let thread = std::thread::Builder::new().name(name.into()).stack_size(STACK_BYTES);
    if let Err(error) = thread.spawn(body) {
        // A box with a serial line measures all the same.
        log::error!("no network: no thread can be started: {error}");
    }
}

/// What the program says, on either output.
fn listen_to(command: &mut Command) -> std::io::Result<PipeReader> {
    let (reader, writer) = std::io::pipe()?;
    command.stdout(writer.try_clone()?).stderr(writer);
    Ok(reader)
}

/// Hands each line to `tell`, with its weight. Takes no heap, as it goes on
/// while frames are measured.
fn pass_on(mut said: impl Read, mut tell: impl FnMut(log::Level, &str)) {
    let (mut line, mut byte) = (heapless::Vec::<u8, LINE_BYTES_MAX>::new(), [0]);
    while let Ok(1) = said.read(&mut byte) {
        let [byte] = byte;
        if byte != b'\n' {
            // There is room: a full line has been handed on.
            let _ = line.push(byte);
        }
        if byte == b'\n' || line.is_full() {
            let text = str::from_utf8(&line).unwrap_or("(something that is no text)").trim();
            if !text.is_empty() {
                // As the logger and the DHCP client's program write it; anything else
                // is the end of a panic.
                let known = text.split_once(": ");
                let known = known.and_then(|(level, text)| Some((level.parse().ok()?, text)));
                let (level, text) = known.unwrap_or((log::Level::Warn, text));
                tell(level, text);
            }
            line.clear();
        }
    }
}

fn tell(level: log::Level, text: &str) {
    log::log!(target: logger::NETWORK, level, "{text}");
}

fn run(mut command: Command) {
    let mut pause = BACK_OFF_MIN;
    loop {
        match command.spawn() {
            Ok(child) => {
                // A process number fits, as the system's own type is an i32.
                let status = reap_until_end_of(Pid::from_raw(child.id() as i32));
                log::error!("the network's process ended: {status:?}; starting it again");
            }
            Err(error) => log::error!("the network's process cannot be started: {error}"),
        }
        std::thread::sleep(pause);
        pause = (pause * 2).min(BACK_OFF_MAX);
    }
}

/// Takes note of every child that ends, until it is this one.
fn reap_until_end_of(awaited: Pid) -> Option<WaitStatus> {
    loop {
        match waitpid(None, None) {
            Ok(status) if status.pid() == Some(awaited) => return Some(status),
            Ok(_) | Err(Errno::EINTR) => {}
            // No child at all is left.
            Err(_) => return None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_passed_on_with_their_weight() {
        let long = "x".repeat(LINE_BYTES_MAX + 1);
        let said = format!(
            "INFO: network: eth0 has 10.0.2.15/24\r\nERROR: none: at all\n\nthread panicked\n{long}\n"
        );
        let mut told = Vec::new();
        pass_on(said.as_bytes(), |level, text| told.push((level, text.to_owned())));
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
    fn both_outputs_are_listened_to() {
        let mut command = Command::new("sh");
        command.args(["-c", "echo INFO: one; echo WARN: two >&2"]);
        let said = listen_to(&mut command).unwrap();
        assert!(command.status().unwrap().success());
        // The command holds the pipe open for the next start.
        drop(command);
        let mut told = Vec::new();
        pass_on(said, |level, text| told.push((level, text.to_owned())));
        let expected = [(log::Level::Info, "one".into()), (log::Level::Warn, "two".into())];
        assert_eq!(told, expected);
    }
}
