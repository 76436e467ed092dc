//! Mounts the kernel's own file systems, which every other step reads.

use anyhow::{Context, Result};
use nix::errno::Errno;
use nix::mount::{MsFlags, mount};

/// Type and mount point.
const FILE_SYSTEMS: [(&str, &str); 3] =
    [("proc", "/proc"), ("sysfs", "/sys"), ("devtmpfs", "/dev")];

/// Mounts them all, but for those that are mounted already.
///
/// # Errors
/// When the kernel refuses to mount one.
pub fn mount_all() -> Result<()> {
    for (kind, place) in FILE_SYSTEMS {
        std::fs::create_dir_all(place).with_context(|| format!("{place} cannot be made"))?;
        let flags = MsFlags::MS_NOSUID | MsFlags::MS_NOEXEC;
        match mount(Some(kind), place, Some(kind), flags, None::<&str>) {
            Ok(()) | Err(Errno::EBUSY) => {}
            Err(error) => {
                return Err(error)
                    .with_context(|| format!("the kernel's {kind} cannot be mounted on {place}"));
            }
        }
    }
    Ok(())
}

/// Asks the kernel to restart 10 s after a panic; otherwise it would halt.
pub fn restart_on_kernel_panic() {
    if let Err(error) = std::fs::write("/proc/sys/kernel/panic", "10") {
        log::warn!(
            "the computer will not restart after a kernel panic: /proc/sys/kernel/panic: {error}"
        );
    }
}
