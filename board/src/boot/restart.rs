//! Restarts the computer, and finds out why it has started.
//!
//! On a Raspberry Pi the watchdog's driver never says that the watchdog has restarted the
//! computer (mainline `bcm2835_wdt` sets no boot status). The boot firmware passes on the register
//! with the reason, PM_RSTS, in the device tree; but there every restart looks like one by the
//! watchdog, because the kernel uses the watchdog to restart the computer. Therefore an orderly
//! restart leaves a mark on the card, which the next start removes.
//!
//! | PM_RSTS | mark | reason |
//! |---|---|---|
//! | reset by the watchdog | none | the watchdog, or a kernel that panicked |
//! | reset by the watchdog | present | an orderly restart |
//! | the power was switched on | any | power, but unknown on a board of revision 1.1, whose boot loader switches the power off and on after every reset |

use std::ffi::CStr;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use nix::libc;
use nix::sys::reboot::{RebootMode, reboot};
use plumbline::packet::ResetReason;

use crate::machine::read_only_partition::{ReadOnlyPartition, sync_disk_of};
use crate::machine::watchdog::Watchdog;

/// The mark's name on the card.
const MARK: &str = "restart";

/// The mark's text, for a person who finds it.
const MARK_TEXT: &str =
    "The box was restarted in good order. It removes this file when it starts.\r\n";

/// Where the boot firmware leaves its information.
const DEVICE_TREE: &str = "/proc/device-tree";

/// In PM_RSTS: the watchdog has reset the whole chip (HADWRF).
const RESET_BY_WATCHDOG: u32 = 0x20;

/// In PM_RSTS: the power was switched on (HADPOR).
const POWER_CAME_ON: u32 = 0x1000;

/// What the restart's system call is told for a try: the partition to start from, of which 0 leaves
/// the choice to the firmware, and the word for which the kernel module of `board/image/tryboot` sets
/// the firmware's flag.
const TRY: &CStr = c"0 tryboot";

/// Restarts the computer because a host has asked for it.
pub fn in_good_order(card: Option<&ReadOnlyPartition>) -> ! {
    mark_on(card);
    now()
}

/// Restarts the computer in good order, and has a Raspberry Pi's firmware start the other slot, this
/// once. Where there is no such firmware, this is an ordinary restart.
#[allow(unsafe_code, reason = "nix's reboot takes no argument for the firmware")]
pub fn to_try(card: Option<&ReadOnlyPartition>) -> ! {
    mark_on(card);
    log::info!("restarting into one try of the other slot");
    nix::unistd::sync();
    // SAFETY: reboot(2) with this command reads the text up to its end, which lives for ever, and
    // writes nothing. It returns only if it has done nothing.
    unsafe {
        libc::syscall(
            libc::SYS_reboot,
            libc::LINUX_REBOOT_MAGIC1,
            libc::LINUX_REBOOT_MAGIC2,
            libc::LINUX_REBOOT_CMD_RESTART2,
            TRY.as_ptr(),
        )
    };
    log::error!("the restart into the other slot is refused: {}", std::io::Error::last_os_error());
    now()
}

fn mark_on(card: Option<&ReadOnlyPartition>) {
    if let Some(card) = card
        && let Err(error) = leave_mark(card)
    {
        // On a Raspberry Pi the next start then takes this for a restart by the watchdog.
        log::warn!("the restart leaves no mark on the card: {error:#}");
    }
}

/// Restarts the computer.
pub fn now() -> ! {
    log::info!("restarting");
    nix::unistd::sync();
    let Err(error) = reboot(RebootMode::RB_AUTOBOOT);
    // When process 1 ends the kernel panics, and then restarts.
    log::error!("the computer cannot be restarted: {error}");
    std::process::exit(1)
}

fn leave_mark(card: &ReadOnlyPartition) -> Result<()> {
    let mark = card.file(MARK);
    card.while_writable(|| {
        fs::write(&mark, MARK_TEXT).with_context(|| mark.display().to_string())?;
        sync_disk_of(&mark)
    })
}

/// Whether the last restart was orderly; removes its mark.
pub fn take_mark(card: &ReadOnlyPartition) -> bool {
    let mark = card.file(MARK);
    let there = mark.exists();
    if there && let Err(error) = card.while_writable(|| Ok(fs::remove_file(&mark)?)) {
        log::warn!("{}: the mark of the last restart stays: {error:#}", mark.display());
    }
    there
}

/// Why the computer has started; `marked` if its last restart was orderly.
pub fn reason(watchdog: Option<&Watchdog>, marked: bool) -> ResetReason {
    let by_driver = watchdog.map_or(ResetReason::Unknown, Watchdog::reset_reason);
    match Firmware::read(Path::new(DEVICE_TREE)) {
        Some(firmware) if by_driver != ResetReason::Watchdog => firmware.reason(marked),
        _ => by_driver,
    }
}

/// What the firmware of a Raspberry Pi reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Firmware {
    /// PM_RSTS at the firmware's start.
    status: u32,
    /// The board's revision code, if known.
    board: Option<u32>,
}

impl Firmware {
    fn read(device_tree: &Path) -> Option<Self> {
        let cell = |name: &str| {
            let bytes = fs::read(device_tree.join(name)).ok()?;
            Some(u32::from_be_bytes(bytes.try_into().ok()?))
        };
        // Its name depends on the firmware's version.
        let status = ["chosen/bootloader/rsts", "chosen/bootloader/pm_rsts"];
        let status = status.into_iter().find_map(cell)?;
        Some(Self { status, board: cell("system/linux,revision") })
    }

    fn reason(self, marked: bool) -> ResetReason {
        if self.status & RESET_BY_WATCHDOG != 0 {
            if marked { ResetReason::PowerOn } else { ResetReason::Watchdog }
        } else if self.status & POWER_CAME_ON != 0 && (marked || !self.board_always_says_power()) {
            ResetReason::PowerOn
        } else {
            ResetReason::Unknown
        }
    }

    /// A Pi 4 Model B of revision 1.1. The code has the model in bits 4 to 11 and the revision in
    /// bits 0 to 3.
    fn board_always_says_power(self) -> bool {
        self.board.is_some_and(|code| (code >> 4) & 0xff == 0x11 && code & 0xf <= 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_register_and_the_mark_tell_the_reason() {
        let (first, later) = (Some(0x00c0_3111), Some(0x00b0_3115));
        let table = [
            (0x20, later, false, ResetReason::Watchdog),
            (0x1020, later, false, ResetReason::Watchdog),
            (0x20, later, true, ResetReason::PowerOn),
            (0x1000, later, false, ResetReason::PowerOn),
            (0x1000, None, false, ResetReason::PowerOn),
            (0x1000, later, true, ResetReason::PowerOn),
            (0x1000, first, false, ResetReason::Unknown),
            (0x1000, first, true, ResetReason::PowerOn),
            (0x20, first, false, ResetReason::Watchdog),
            (0, later, false, ResetReason::Unknown),
        ];
        for (status, board, marked, expected) in table {
            let found = Firmware { status, board }.reason(marked);
            assert_eq!(found, expected, "{status:#x} {board:x?} {marked}");
        }
    }

    #[test]
    fn what_the_firmware_says_is_read_by_either_name() {
        for name in ["rsts", "pm_rsts"] {
            let tree = tempfile::tempdir().unwrap();
            assert_eq!(Firmware::read(tree.path()), None);
            fs::create_dir_all(tree.path().join("chosen/bootloader")).unwrap();
            fs::write(tree.path().join("chosen/bootloader").join(name), [0, 0, 0, 0x20]).unwrap();
            let found = Firmware::read(tree.path()).unwrap();
            assert_eq!(found, Firmware { status: 0x20, board: None });
            fs::create_dir(tree.path().join("system")).unwrap();
            fs::write(tree.path().join("system/linux,revision"), [0, 0xb0, 0x31, 0x15]).unwrap();
            assert_eq!(Firmware::read(tree.path()).unwrap().board, Some(0x00b0_3115));
        }
    }
}
