//! Gives the measurement priority over the computer's other work: none of its pages is
//! ever swapped out, no ordinary program delays it, and it stays on one core if asked to.

// Two system calls have no safe wrapper; both take plain numbers.
#![allow(unsafe_code)]

use std::hint::black_box;

use nix::libc;
use nix::sched::{CpuSet, sched_setaffinity};
use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::unistd::Pid;
use plumbline::config::Machine;

/// The size of the stack that is touched beforehand: the frame path needs at most 64 KiB,
/// the rest of the loop far less.
const STACK_BYTES: usize = 256 * 1024;

/// Applies the configuration's settings to the calling thread, which must be the one that
/// runs the loop, before the first frame. A setting that the computer does not grant is
/// logged with the remedy; the measurement runs without it.
pub fn set_up(machine: &Machine) {
    if let Some(cpu) = machine.cpu {
        pin(cpu);
    }
    let Some(priority) = machine.realtime_priority else { return };
    if let Err(error) = mlockall(MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE) {
        log::warn!("memory is not locked: {error}; allow it (ulimit -l unlimited, or root)");
    }
    touch_stack();
    prioritise(priority);
}

fn pin(cpu: u8) {
    let mut cpus = CpuSet::new();
    let pinned = cpus.set(cpu.into()).and_then(|()| sched_setaffinity(Pid::from_raw(0), &cpus));
    if let Err(error) = pinned {
        let count = std::thread::available_parallelism().map_or(1, usize::from);
        log::warn!("machine.cpu: core {cpu} is not available: {error}; this computer has {count}");
    }
}

/// Takes back from the calling thread what it has inherited from the one that measures: it waits like
/// any other program, and on any core.
pub fn be_ordinary() {
    // What is not granted leaves it as it is: with a disk it spends its time waiting anyway.
    let _ = schedule(libc::SCHED_OTHER, 0);
    let mut cpus = CpuSet::new();
    for cpu in 0..CpuSet::count() {
        let _ = cpus.set(cpu);
    }
    let _ = sched_setaffinity(Pid::from_raw(0), &cpus);
}

fn schedule(policy: libc::c_int, priority: u8) -> std::io::Result<()> {
    // SAFETY: an all-zero sched_param is valid: it consists of integers.
    let mut parameters: libc::sched_param = unsafe { std::mem::zeroed() };
    parameters.sched_priority = priority.into();
    // SAFETY: the pointer is to a local that outlives the call; 0 is this thread.
    let done = unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) };
    if done == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}

fn prioritise(priority: u8) {
    if let Err(error) = schedule(libc::SCHED_FIFO, priority) {
        log::warn!(
            "machine.realtime_priority: {priority} is not granted: {error}; allow it \
             (CAP_SYS_NICE, or ulimit -r {priority})"
        );
    }
}

/// Makes the kernel allocate the stack's pages now.
#[inline(never)]
fn touch_stack() {
    black_box([0_u8; STACK_BYTES]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_core_that_does_not_exist_is_no_reason_to_stop() {
        set_up(&Machine { cpu: Some(255), ..Machine::default() });
    }
}
