//! The green LED, which blinks the [status](crate::status) as the table there says.
//!
//! The patterns can be told apart by eye, without counting, and differ from those with which a
//! Raspberry Pi's firmware shows why it cannot start, which are three or more equal flashes.

use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;

use super::files::Root;
use crate::status::Status;

/// The LED next to the power LED, and the only LED of a Raspberry Pi 400.
const NAMES: [&str; 2] = ["ACT", "PWR"];

/// Whether the LED is lit in a tick of 100 ms.
pub fn lit(status: Status, tick: u64) -> bool {
    const NONE: Range<u64> = 0..0;
    let (period, flashes) = match status {
        Status::Starting => (2, [0..1, NONE]),
        Status::Tracking => (10, [0..1, NONE]),
        Status::Searching => (20, [0..1, 3..4]),
        Status::NoCamera => (20, [0..6, 9..10]),
        Status::NoConfiguration => (20, [0..10, NONE]),
        Status::Refused => (20, [0..18, NONE]),
        Status::Failed => (1, [0..1, NONE]),
    };
    flashes.iter().any(|flash| flash.contains(&(tick % period)))
}

/// The LED, as soon as there is one.
pub struct Lamp<'a> {
    root: Root<'a>,
    brightness: Option<File>,
    is_lit: Option<bool>,
}

impl<'a> Lamp<'a> {
    pub fn new(root: Root<'a>) -> Self {
        Self { root, brightness: None, is_lit: None }
    }

    /// Takes control of the LED, unless that is done already, from whatever blinks it now.
    pub fn look(&mut self) {
        if self.brightness.is_none() {
            self.brightness = NAMES.into_iter().find_map(|name| {
                let folder = format_args!("/sys/class/leds/{name}/");
                self.root.write(format_args!("{folder}trigger"), "none").ok()?;
                self.root.open_to_write(format_args!("{folder}brightness")).ok()
            });
        }
    }

    /// Switches it on or off, unless it is so already.
    pub fn show(&mut self, lit: bool) {
        if self.is_lit == Some(lit) {
            return;
        }
        if let Some(brightness) = &self.brightness {
            let written = brightness.write_all_at(if lit { b"1" } else { b"0" }, 0);
            self.is_lit = written.is_ok().then_some(lit);
            if written.is_err() {
                self.brightness = None;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{create_dir_all, read_to_string, write};

    use super::*;

    /// 2 s of each; `#` is lit.
    const PATTERNS: [(Status, &str); 7] = [
        (Status::Starting, "#.#.#.#.#.#.#.#.#.#."),
        (Status::Tracking, "#.........#........."),
        (Status::Searching, "#..#................"),
        (Status::NoCamera, "######...#.........."),
        (Status::NoConfiguration, "##########.........."),
        (Status::Refused, "##################.."),
        (Status::Failed, "####################"),
    ];

    #[test]
    fn every_status_has_its_pattern() {
        assert_eq!(PATTERNS.map(|(status, _)| status), Status::ALL);
        for (status, pattern) in PATTERNS {
            let seen: String =
                (0..60).map(|tick| if lit(status, tick) { '#' } else { '.' }).collect();
            assert_eq!(seen, pattern.repeat(3), "{status:?}");
        }
    }

    fn add(root: &std::path::Path, name: &str) {
        let folder = root.join("sys/class/leds").join(name);
        create_dir_all(&folder).unwrap();
        write(folder.join("trigger"), "xxxx").unwrap();
        write(folder.join("brightness"), "x").unwrap();
    }

    #[test]
    fn the_green_led_is_taken_when_it_appears_and_written_when_it_changes() {
        let folder = tempfile::tempdir().unwrap();
        let read = |path: &str| read_to_string(folder.path().join("sys/class/leds").join(path));
        let mut lamp = Lamp::new(Root::new(folder.path().to_str().unwrap()));
        lamp.look();
        lamp.show(true);
        add(folder.path(), "PWR");
        add(folder.path(), "ACT");
        lamp.look();
        lamp.show(true);
        assert_eq!(read("ACT/trigger").unwrap(), "none");
        assert_eq!(read("ACT/brightness").unwrap(), "1");
        write(folder.path().join("sys/class/leds/ACT/brightness"), "x").unwrap();
        lamp.show(true);
        assert_eq!(read("ACT/brightness").unwrap(), "x");
        lamp.show(false);
        assert_eq!(read("ACT/brightness").unwrap(), "0");
        assert_eq!(read("PWR/trigger").unwrap(), "xxxx");
    }

    #[test]
    fn the_only_led_of_a_pi_400_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        add(folder.path(), "PWR");
        let mut lamp = Lamp::new(Root::new(folder.path().to_str().unwrap()));
        lamp.look();
        lamp.show(true);
        let brightness = folder.path().join("sys/class/leds/PWR/brightness");
        assert_eq!(read_to_string(brightness).unwrap(), "1");
    }
}
