//! Compiles for other processors ahead of the parts that need it, several things at a time.
//!
//! Most of such a build is one crate, the core, which is compiled as one unit, or a program that is
//! linked with optimisation: one after the other, they would leave half of this machine idle. Those
//! that share compiled crates are built in one directory, and so one after the other. The parts build
//! them again and find them built, so that each part can be run by itself. Where this machine's own
//! part is run too, it is done beside that.

use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver};

use super::{ARMHF, Part, recordings, shipped};
use crate::bare_metal;
use crate::command::{Job, run_beside_each_other};
use crate::cross::{Linking, Target};
use crate::image::{self, DebianRoot, Profile};
use crate::tests::journal::Journal;

/// What `cargo test` is told to build tests only.
const BUILD: [&str; 2] = ["test", "--no-run"];

/// Builds what these parts need, those that take longest first.
pub fn build(journal: &mut Journal, parts: &[Part]) {
    journal.part = "ahead".into();
    let Some(recordings) = recordings(journal) else { return };
    let (rendered, receiver) = mpsc::channel();
    rendered.send(recordings).expect("the receiver is there");
    journal.check("build", || run_beside_each_other(jobs(parts, receiver)));
}

/// What to build, those that take longest first; the firmware once the recordings are rendered.
pub fn jobs(parts: &[Part], recordings: Receiver<PathBuf>) -> Vec<Job<'static>> {
    let mut jobs: Vec<Job<'static>> = Vec::new();
    let has = |part| parts.contains(&part);
    // Both are for the same processor: they share what they compile, and so take turns.
    let (has_arm, has_boot) = (has(Part::Arm), has(Part::Boot));
    if has_arm || has_boot {
        jobs.push(Box::new(move || {
            if has_arm {
                let debian = DebianRoot::for_checks()?;
                let cargo = Target::Aarch64.toolchain()?.cargo(Linking::Root(debian.path()));
                cargo.args(BUILD).args(shipped()).run()?;
            }
            if has_boot { image::build_ahead(Profile::Dev) } else { Ok(()) }
        }));
    }
    if has(Part::Armhf) {
        jobs.push(Box::new(|| {
            let cargo = Target::Armv7.toolchain()?.cargo(Linking::Static);
            cargo.args(BUILD).args(ARMHF).run()
        }));
    }
    if has(Part::BareMetal) {
        jobs.push(Box::new(move || {
            // Without recordings the part has failed already.
            let Ok(recordings) = recordings.recv() else { return Ok(()) };
            bare_metal::BOARDS.iter().try_for_each(|board| board.build_ahead(&recordings))
        }));
    }
    jobs
}
