//! The Windows program that people download, under Wine with real files and sockets, beside the one for
//! Linux. `cargo xtask test dist` makes both, and says in [`DIST`] where they are.

mod windows;

/// The directory of `cargo xtask dist`.
pub const DIST: &str = "PLUMBLINE_DIST";

/// The directory of a Debian with Wine.
pub const WINE: &str = "PLUMBLINE_WINE";
