//! The SD card in an emulated Raspberry Pi 4: from power to a recorded trial over the serial line,
//! and back from a program that hangs.

mod card;
mod firmware;
mod machine;
mod power_management;
mod qmp;

use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

use plumb::files;
use plumb::link::{BoxLink, LinkArguments};
use plumbline::config::{Config, SerialLink};
use plumbline::packet::{Action, Hello, Message, ResetReason};

use crate::binary;
use crate::machine::{PATIENCE, is_measured, poses};
use crate::provisioning::{Computer, assert_power_cuts_leave_one, two_of};
use crate::scene::{self, Position, SCENE, distance_mm, run};
use card::START_BYTES;
use machine::{LINE, Pi};

/// As in the test of the other board: the same frames, but others before them.
const DIFFERENCE_MM_MAX: f64 = 0.1;

/// The serial line is all that the emulated machine has.
fn config() -> Config {
    // Of no host: the address of UDP is left out.
    let mut config = scene::config(([127, 0, 0, 1], 1).into());
    config.links.udp = None;
    let path = LINE.try_into().expect("a short path");
    config.links.serial = Some(SerialLink { path, baud: 115_200 });
    config
}

/// The Hello of the start of this number, counted from 1.
fn start_number(pi: &Pi, number: usize) -> Hello {
    pi.wait_for(&format!("the Hello of start {number}"), |seen| {
        let mut starts: Vec<&Hello> = Vec::new();
        for message in &seen.serial {
            if let Message::Hello(hello) = message
                && starts.iter().all(|it| it.boot_id != hello.boot_id)
            {
                starts.push(hello);
            }
        }
        starts.get(number - 1).map(|&hello| hello.clone())
    })
}

/// How often the LED is lit within a time of the machine's, in seconds, and for which share of it.
fn blinks(pi: &Pi, seconds: f64) -> (usize, f64) {
    let (began_us, mut was_lit) = pi.green_led();
    let (mut times, mut lit, mut looks) = (0, 0, 0);
    loop {
        let (now_us, is_lit) = pi.green_led();
        looks += 1;
        lit += usize::from(is_lit);
        times += usize::from(is_lit && !was_lit);
        was_lit = is_lit;
        if f64::from(now_us.wrapping_sub(began_us)) * 1e-6 >= seconds {
            return (times, lit as f64 / looks as f64);
        }
        sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_card_records_a_trial_over_the_serial_line() {
    let mut pi = Pi::new(Some(&scene::blob(&config())), "overlay.cpio", "");
    pi.switch_on();
    let hello = start_number(&pi, 1);
    assert_eq!((hello.device.as_str(), hello.config_crc), ("boot test", config().crc()));
    assert_eq!(hello.reset_reason, ResetReason::PowerOn);
    pi.wait_for("a pose", |seen| poses(&seen.serial).any(is_measured).then_some(()));

    let directory = tempfile::tempdir().unwrap();
    plumb(directory.path(), &format!("receive --frames 72 --out trial --serial {}", pi.line()));
    plumb(directory.path(), "analyze trial --json figures.json");
    let rows = files::poses::read(&directory.path().join("trial/samples.csv")).unwrap();
    let measured = rows.iter().filter(|row| row.z_mm.is_some()).count();
    assert_eq!((rows.len(), measured), (2 * 72, 2 * 72), "frames without a pose");
    // The card's own core on another processor: each pose is that of one of the frames.
    for row in &rows {
        let target = usize::from(row.target == "shoulder");
        let found = [row.x_mm, row.y_mm, row.z_mm].map(|value| value.unwrap());
        let off_mm = nearest_mm(&SCENE.offline_mm[target], &found);
        assert!(off_mm < DIFFERENCE_MM_MAX, "{} is {off_mm} mm off", row.target);
    }
    let (times, share) = blinks(&pi, 5.0);
    assert!((4..=6).contains(&times) && (0.05..0.2).contains(&share), "{times} {share}");
    pi.screen().save("/tmp/pi/screen.png").unwrap();
}

#[test]
fn a_program_that_hangs_is_reset_by_the_pis_watchdog_and_a_restart_is_not_taken_for_it() {
    let hang = "plumbline.hang_after=60";
    let mut pi = Pi::new(Some(&scene::blob(&config())), "overlay-fault.cpio", hang);
    pi.switch_on();
    assert_eq!(start_number(&pi, 1).reset_reason, ResetReason::PowerOn);
    // Reset in the middle of its work, the box says so.
    assert_eq!(start_number(&pi, 2).reset_reason, ResetReason::Watchdog);
    let last = pi.wait_for("poses", |seen| poses(&seen.serial).map(|pose| pose.sequence).max());
    assert!((30..60).contains(&last), "frame {last} was processed after the hang");

    // Restarted because a host has asked for it, it does not.
    let mut link = link(&pi);
    link.wait_until_heard_within(PATIENCE).unwrap();
    link.request(Action::Reboot, "to start anew").unwrap();
    assert_eq!(start_number(&pi, 3).reset_reason, ResetReason::PowerOn);
    // And that leaves nothing behind.
    let listing = run("mdir", &["-b", "-i", &pi.disk()]).to_lowercase();
    assert!(listing.contains("config.plb") && !listing.contains("restart"), "{listing}");
}

impl Computer for Pi {
    fn switch_on(&mut self) {
        Pi::switch_on(self);
    }

    fn cut_power(&mut self) {
        Pi::cut_power(self);
    }

    fn disk(&self) -> String {
        format!("{}@@{START_BYTES}", self.card().display())
    }
}

#[test]
fn a_power_cut_while_the_card_is_written_to_leaves_the_old_or_the_new_configuration() {
    let configs = two_of(&config());
    let mut pi = Pi::new(Some(&scene::blob(&configs[0])), "overlay.cpio", "");
    let mut link = link(&pi);
    assert_power_cuts_leave_one(&mut pi, &mut link, &configs, 2);
}

/// The host's end of the line.
fn link(pi: &Pi) -> BoxLink {
    let serial = Some(pi.line().to_owned());
    let link = LinkArguments { udp: None, serial, baud: 115_200 }.open();
    link.expect("the line is there")
}

fn nearest_mm(known: &[Position], found: &Position) -> f64 {
    known.iter().map(|known| distance_mm(known, found)).fold(f64::INFINITY, f64::min)
}

fn plumb(directory: &Path, arguments: &str) -> String {
    let output = binary::plumb()
        .args(arguments.split_whitespace())
        .current_dir(directory)
        .output()
        .expect("plumb runs");
    let said = binary::messages(&output) + &String::from_utf8_lossy(&output.stdout);
    println!("$ plumb {arguments}\n{said}");
    assert_eq!(output.status.code(), Some(0), "plumb {arguments}: {said}");
    said
}
