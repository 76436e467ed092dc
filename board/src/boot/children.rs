//! The first process of a computer is the parent of every orphan, and must take
//! note of the end of each. A thread of its own does, asleep until one ends.
//!
//! It also starts the process that looks after the network, again if that ends.
//! Only starting takes heap.

use std::os::unix::process::CommandExt;
use std::process::Command;
use std::time::Duration;

use nix::errno::Errno;
use nix::sys::wait::{WaitStatus, waitpid};
use nix::unistd::Pid;
use plumbline::config::Network;

use super::network;

/// Pause before the network process is started again; doubled each time.
const BACK_OFF_MIN: Duration = Duration::from_secs(1);

/// The longest such pause.
const BACK_OFF_MAX: Duration = Duration::from_secs(60);

/// Starting a process needs little; the pages are locked in memory.
const STACK_BYTES: usize = 128 << 10;

/// Starts the network's process and looks after all children from now on.
pub fn look_after(network: Network) {
    let thread = std::thread::Builder::new().name("children".into()).stack_size(STACK_BYTES);
    if let Err(error) = thread.spawn(move || run(network)) {
        // A box with a serial line measures all the same.
        log::error!("no network: no thread can be started: {error}");
    }
}

fn run(network: Network) {
    let mut command = Command::new("/proc/self/exe");
    command.arg0(network::NAME).args(network::arguments(network));
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
