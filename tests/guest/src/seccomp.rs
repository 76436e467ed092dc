//! A driver that does not count the changes of modem lines: the kernel is told to refuse the call for
//! the counts, as such a driver does. (No driver of this kind has a device that can be emulated here.)

#![allow(unsafe_code)] // prctl cannot be called otherwise

use std::io;

use nix::errno::Errno;
use nix::libc::{
    self, BPF_ABS, BPF_JEQ, BPF_JMP, BPF_K, BPF_LD, BPF_RET, BPF_W, SECCOMP_RET_ALLOW,
    SECCOMP_RET_ERRNO, sock_filter, sock_fprog,
};

/// Where `struct seccomp_data` has the call's number, and the lower half of its second argument.
const NUMBER: u32 = 0;
const SECOND_ARGUMENT: u32 = 24;

const fn step(code: u32, jt: u8, jf: u8, k: u32) -> sock_filter {
    sock_filter { code: code as u16, jt, jf, k }
}

/// From now on this thread, and those that it starts, get no counts: ENOTTY.
///
/// # Errors
/// As the kernel reports them.
pub fn refuse_counts() -> io::Result<()> {
    let load = BPF_LD | BPF_W | BPF_ABS;
    let jump_if_equal = BPF_JMP | BPF_JEQ | BPF_K;
    let refuse = SECCOMP_RET_ERRNO | Errno::ENOTTY as u32;
    let mut filter = [
        step(load, 0, 0, NUMBER),
        step(jump_if_equal, 0, 3, libc::SYS_ioctl as u32),
        step(load, 0, 0, SECOND_ARGUMENT),
        step(jump_if_equal, 0, 1, libc::TIOCGICOUNT as u32),
        step(BPF_RET | BPF_K, 0, 0, refuse),
        step(BPF_RET | BPF_K, 0, 0, SECCOMP_RET_ALLOW),
    ];
    let program = sock_fprog { len: filter.len() as u16, filter: filter.as_mut_ptr() };
    // SAFETY: the kernel copies the program, which is borrowed for that long, and checks it.
    let done = unsafe {
        libc::prctl(
            libc::PR_SET_SECCOMP,
            libc::SECCOMP_MODE_FILTER as libc::c_ulong,
            &raw const program,
            0,
            0,
        )
    };
    Errno::result(done)?;
    Ok(())
}
