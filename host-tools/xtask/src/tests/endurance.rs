//! What a box and its host meet in years, in hours. Each thing that is tried can be tried by itself, in the
//! time that there is.

use std::path::PathBuf;

use clap::ValueEnum;

use super::journal::Journal;
use super::named::{of_released, released};
use super::{BOOT_TESTS, IMAGES};
use crate::command::word;
use crate::image;

/// One thing that is tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Ordeal {
    /// Laws and state machines with far more inputs than every day; ten minutes.
    Models,
    /// Each step of an update from every state, against what is obviously right; a minute.
    Update,
    /// A million frames, and a thousand losses of the camera, through the box's program; half an hour.
    Frames,
    /// At the host: recordings that are killed, links that die, full disks, clocks that jump; half an hour.
    Recording,
    /// A booted box whose camera is unplugged a hundred times; a quarter of an hour.
    Unplugged,
    /// A booted box whose card is full, or slow; minutes.
    Card,
    /// A booted box whose clock jumps; minutes.
    Clock,
    /// The power of a booted box cut a hundred times while configurations are stored; an hour.
    Storing,
    /// A booted box that gets updates that do not work, and its power cut a hundred times while it is
    /// updated; two hours.
    Updating,
    /// The latency of a booted box beside programs that never rest; an hour.
    Load,
}

impl Ordeal {
    const fn place(self) -> Place {
        match self {
            Self::Models | Self::Update => Place::Tests,
            Self::Frames | Self::Recording => Place::Programs,
            _ => Place::Box,
        }
    }

    /// The test program, as cargo wants to be told, and which of its tests.
    const fn tests(self) -> (&'static [&'static str], &'static [&'static str]) {
        match self {
            Self::Models => (&["--workspace", "--test", "models"], &["--ignored"]),
            Self::Update => (
                &["--package", "plumbline-board", "--lib"],
                &["--exact", "update::model::every_step_from_every_state_is_as_it_must_be"],
            ),
            // One of its tests is the box that another one starts.
            Self::Frames => {
                (&["--workspace", "--test", "endurance"], &["--ignored", "--skip", "the_box"])
            }
            Self::Recording => (&["--workspace", "--test", "link"], &["--ignored"]),
            Self::Unplugged => (&BOOT_TESTS, &["--ignored", "endurance::unplugged"]),
            Self::Card => (&BOOT_TESTS, &["--ignored", "endurance::card"]),
            Self::Clock => (&BOOT_TESTS, &["--ignored", "endurance::clock"]),
            Self::Storing => (&BOOT_TESTS, &["--ignored", "endurance::cuts"]),
            Self::Updating => (&BOOT_TESTS, &["--ignored", "another_system"]),
            Self::Load => (&BOOT_TESTS, &["--ignored", "endurance::load"]),
        }
    }
}

/// What a thing is tried with.
#[derive(PartialEq, Eq)]
enum Place {
    /// The tests alone.
    Tests,
    /// The programs as users have them.
    Programs,
    /// A booted box, and the programs.
    Box,
}

/// Tries these things one after the other, or all: a watched box must not wait for another one's processor.
pub fn endurance(journal: &mut Journal, only: &[Ordeal]) {
    let chosen = if only.is_empty() { Ordeal::value_variants() } else { only };
    let needs = |place| chosen.iter().any(|it| it.place() == place);
    let (has_programs, has_box) = (needs(Place::Programs), needs(Place::Box));
    if (has_programs || has_box) && !released(journal, &["plumb", "plumbline-board"]) {
        return;
    }
    let mut images = PathBuf::new();
    let make = || {
        images = image::make_for_tests(image::Profile::Release)?;
        Ok(())
    };
    if has_box && !journal.check("images", make) {
        return;
    }
    for ordeal in chosen {
        let (test, which) = ordeal.tests();
        let task = of_released(journal, test, which).env(IMAGES, &images.to_string_lossy());
        journal.tests(&word(ordeal), |each_line| task.run_and_read(each_line));
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::command::root;

    #[test]
    fn every_test_of_a_booted_box_that_takes_long_is_tried() {
        let boot = root().join("tests/boot");
        let tried: Vec<_> = Ordeal::value_variants()
            .iter()
            .filter(|it| it.place() == Place::Box)
            .map(|it| boot.join(it.tests().1[1].replace("::", "/")).with_extension("rs"))
            .collect();
        let directories =
            ["", "endurance", "pi"].map(|name| fs::read_dir(boot.join(name)).unwrap());
        let mut found = 0;
        for file in directories.into_iter().flatten().map(|entry| entry.unwrap().path()) {
            let text = fs::read_to_string(&file).unwrap_or_default();
            let is_long = text.contains("#[ignore = ");
            assert_eq!(is_long, tried.contains(&file), "{}", file.display());
            found += usize::from(is_long);
        }
        assert_eq!(found, tried.len());
    }
}
