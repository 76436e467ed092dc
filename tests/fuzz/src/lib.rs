//! What holds for any bytes from outside: the laws that `cargo xtask fuzz` tries with the inputs that
//! libFuzzer makes up, and the usual tests with those that are stored.
//!
//! A target is a plain function of an input: it panics where a law does not hold. Each module says which
//! laws it has and what its inputs mean. What is stored lies beside this crate:
//!
//! ```text
//! corpus/TARGET.txt   inputs that together reach all the code that has been reached so far, minimised
//! finds/TARGET/       inputs for which a law did not hold once
//! runner/             the programs that libFuzzer runs, one for each target
//! ```

mod camera;
mod config;
mod frames;
mod input;
mod link;
mod packets;
mod pictures;
mod requests;
mod tables;
mod trials;

use std::path::{Path, PathBuf};
use std::{env, fs};

use plumbline_test_support::fuzz::SEEDS;

/// Something that is given bytes from outside.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Its name, as in [`plumbline_test_support::fuzz::TARGETS`].
    pub name: &'static str,
    /// Checks the laws for an input.
    pub check: fn(&[u8]),
    /// Inputs to begin with, made by the project's own encoders.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

impl Target {
    /// Before a run: writes the seeds into the directory that [`SEEDS`] names, if it names one.
    ///
    /// # Panics
    /// When they cannot be written.
    pub fn begin(&self) {
        let Some(folder) = env::var_os(SEEDS).map(PathBuf::from) else { return };
        for (number, seed) in (self.seeds)().iter().enumerate() {
            fs::write(folder.join(format!("seed-{number}")), seed).expect("a seed can be written");
        }
    }
}

// Each has a name of its own, so that a program that tries one of them has the code of this one alone.

/// See the module `packets`.
pub const PACKETS: Target =
    Target { name: "packets", check: packets::check, seeds: packets::seeds };

/// See the module `link`.
pub const LINK: Target = Target { name: "link", check: link::check, seeds: link::seeds };

/// See the module `config`.
pub const CONFIG: Target = Target { name: "config", check: config::check, seeds: config::seeds };

/// See the module `trials`.
pub const TRIALS: Target = Target { name: "trials", check: trials::check, seeds: trials::seeds };

/// See the module `pictures`.
pub const PICTURES: Target =
    Target { name: "pictures", check: pictures::check, seeds: pictures::seeds };

/// See the module `tables`.
pub const TABLES: Target = Target { name: "tables", check: tables::check, seeds: tables::seeds };

/// See the module `frames`.
pub const FRAMES: Target = Target { name: "frames", check: frames::check, seeds: frames::seeds };

/// See the module `camera`.
pub const CAMERA: Target = Target { name: "camera", check: camera::check, seeds: camera::seeds };

/// See the module `requests`.
pub const REQUESTS: Target =
    Target { name: "requests", check: requests::check, seeds: requests::seeds };

/// All targets.
pub const TARGETS: [Target; 9] =
    [PACKETS, LINK, CONFIG, TRIALS, PICTURES, TABLES, FRAMES, CAMERA, REQUESTS];

/// The target with this name.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn target(name: &str) -> Target {
    let found = TARGETS.into_iter().find(|target| target.name == name);
    found.unwrap_or_else(|| panic!("there is no target {name}"))
}

/// The directory of this crate, with what is stored.
#[must_use]
pub fn directory() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_owned()
}
