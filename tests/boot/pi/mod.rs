//! The SD card in an emulated Raspberry Pi 4: from power to a recorded trial over the serial line,
//! and back from a program that hangs.

mod card;
mod firmware;
mod machine;
mod mailbox;
mod power_management;
mod qmp;

use std::thread::sleep;
use std::time::{Duration, Instant};

use ::image::{Rgb, RgbImage};
use plumbline::config::{Config, SerialLink};
use plumbline::packet::{Action, CameraState, Hello, LinkKind, Message, ResetReason};
use plumbline::seal::{BoxState, KEY_FILE_NAME, Key};
use plumbline_board::boot::panel::Panel;
use plumbline_board::logger::Latest;
use plumbline_board::status::Status;
use plumbline_stream::link::BoxLink;
use plumbline_stream::transport::{Link, Serial};
use plumbline_test_support::evidence;
use plumbline_update::card::{SETTINGS, Slot};

use crate::machine::{PATIENCE, healths, is_measured, logs, poses, read};
use crate::provisioning::{Computer, assert_power_cuts_leave_one, known_box, two_of};
use crate::scene::{self, Position, SCENE, distance_mm, file_on, files_on};
pub use card::{chosen, place};
use common::{binary, keys};
use machine::{LINE, Lent, Pi};

/// What a box says of its network where there is none: QEMU has no Ethernet for this machine.
const NO_NETWORK: &str = "no Ethernet interface found: plug in an adapter";

/// As in the test of the other board: the same frames, but others before them.
const DIFFERENCE_MM_MAX: f64 = 0.1;

/// The serial line is all that the emulated machine has.
fn config() -> Config {
    // Of no host: the address of UDP is left out.
    let mut config = scene::config(([127, 0, 0, 1], 1).into());
    config.links.udp = None;
    let path = LINE.try_into().expect("a short path");
    config.links.serial = Some(SerialLink { path, baud: 115_200, one_way: false });
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

/// The LED blinks this status, and the screen shows it: every pixel is as it is drawn here, of
/// the same words.
fn assert_shows(pi: &Pi, status: Status, name: &str, complaint: &str) {
    let (blinks, share) = match status {
        Status::Tracking => (10, 0.1),
        Status::NoConfiguration => (5, 0.5),
        other => unreachable!("{other:?} is not looked for"),
    };
    let (blinks_seen, share_seen) = green_led(pi, 10.0);
    println!("{status:?}: the LED was lit {blinks_seen} times, {share_seen:.2} of the time");
    assert!(blinks_seen.abs_diff(blinks) <= 1, "{blinks_seen} times, not {blinks}");
    assert!((share_seen - share).abs() < 0.05, "{share_seen}, not {share} of the time");
    // The box draws twice a second, and looks for Ethernet for ten seconds before it says this.
    let (expected, give_up) =
        (drawn(status, name, NO_NETWORK, complaint), Instant::now() + PATIENCE);
    loop {
        let seen = pi.screen();
        let different = seen.pixels().zip(expected.pixels()).filter(|(a, b)| a != b).count();
        if different == 0 {
            return;
        }
        assert!(Instant::now() < give_up, "{different} pixels of the screen are others");
        sleep(Duration::from_millis(100));
    }
}

/// The screen as the box's program draws it on a computer with a frame buffer as QEMU has it.
fn drawn(status: Status, name: &str, network: &str, complaint: &str) -> RgbImage {
    let (width, height) = (640, 480);
    let root = tempfile::tempdir().expect("a temporary directory");
    let write = |name: &str, text: String| {
        let path = root.path().join(name);
        std::fs::create_dir_all(path.parent().expect("it is in a directory"))
            .expect("there is room");
        std::fs::write(path, text).expect("there is room");
    };
    let folder = "sys/class/graphics/fb0";
    write(&format!("{folder}/virtual_size"), format!("{width},{height}"));
    write(&format!("{folder}/bits_per_pixel"), "16".into());
    write(&format!("{folder}/stride"), (2 * width).to_string());
    write("dev/fb0", String::new());
    let latest = Latest {
        network: network.try_into().expect("a short text"),
        complaint: complaint.try_into().expect("a short text"),
        complained_at: Some(Instant::now()),
    };
    let mut panel = Panel::new(root.path().to_str().expect("a plain path"));
    panel.tick((status, Duration::ZERO), name, Some(&latest));
    let bytes = read(&root.path().join("dev/fb0"));
    RgbImage::from_fn(width, height, |x, y| {
        let at = 2 * (y * width + x) as usize;
        let word = u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        Rgb([(word >> 11 << 3) as u8, (word >> 5 << 2) as u8, (word << 3) as u8])
    })
}

/// How often the LED is lit within a time of the machine's, in seconds, and for which share of it.
fn green_led(pi: &Pi, seconds: f64) -> (usize, f64) {
    let (began_us, mut was_lit) = pi.green_led();
    let (mut before_us, mut times, mut lit_us) = (began_us, 0, 0);
    loop {
        let (now_us, is_lit) = pi.green_led();
        times += usize::from(is_lit && !was_lit);
        lit_us += if was_lit { now_us.saturating_sub(before_us) } else { 0 };
        (before_us, was_lit) = (now_us, is_lit);
        let passed_us = f64::from(now_us.saturating_sub(began_us));
        if passed_us * 1e-6 >= seconds {
            return (times, f64::from(lit_us) / passed_us);
        }
        sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_card_records_a_trial_over_the_serial_line() {
    let mut pi = Pi::new(Some(&scene::blob(&config())), "");
    pi.switch_on();
    let hello = start_number(&pi, 1);
    assert_eq!((hello.device.as_str(), hello.config_crc), ("boot test", config().crc()));
    assert_eq!(hello.reset_reason, ResetReason::PowerOn);
    pi.wait_for("a pose", |seen| poses(&seen.serial).any(is_measured).then_some(()));

    let directory = tempfile::tempdir().unwrap();
    keys::know(directory.path(), &scene::key());
    let line = pi.lend_line();
    let receive = format!("receive --anyway --frames 72 --out trial --serial {}", line.name());
    binary::plumb_in(directory.path(), &receive);
    drop(line);
    let rows = plumbline_files::poses::read(&directory.path().join("trial/samples.csv")).unwrap();
    let measured = rows.iter().filter(|row| row.z_mm.is_some()).count();
    assert_eq!((rows.len(), measured), (2 * 72, 2 * 72), "frames without a pose");
    // The card's own core on another processor: each pose is that of one of the frames.
    for row in &rows {
        let target = usize::from(row.target == "shoulder");
        let found = [row.x_mm, row.y_mm, row.z_mm].map(|value| value.unwrap());
        let off_mm = nearest_mm(&SCENE.offline_mm[target], &found);
        assert!(off_mm < DIFFERENCE_MM_MAX, "{} is {off_mm} mm off", row.target);
    }
    // A health comes every second. The machine's processor runs as fast as its firmware says.
    let health = pi.wait_for("a health", |seen| {
        healths(&seen.serial).find(|health| health.frames > 48).cloned()
    });
    assert_eq!((health.heap_allocations, health.camera), (Some(0), CameraState::Running));
    assert_eq!((health.throttled, health.undervoltage), (Some(false), None));
    // The log brings these words to the host too. (A box without a configuration sends no log.)
    pi.wait_for("the network's words", |seen| {
        logs(&seen.serial).contains(NO_NETWORK).then_some(())
    });
    let name = format!("{} ({})", config().device, config().serial_number);
    assert_shows(&pi, Status::Tracking, &name, "");
}

#[test]
fn a_card_without_a_configuration_shows_it_and_takes_one_over_the_line() {
    let options = format!("plumbline.serial={LINE}:115200");
    let mut pi = Pi::new(None, &options);
    pi.switch_on();
    let lacks = "no configuration: no config.plb in 10 s on a FAT partition (mmcblk0 mmcblk0p1 mmcblk0p2 mmcblk0p3 mmcblk0p4): \
                 send one with `plumb provision`, or copy it to the settings partition";
    pi.wait_for("what it lacks", |seen| logs(&seen.serial).contains(lacks).then_some(()));
    assert_shows(&pi, Status::NoConfiguration, "Plumbline", lacks);
    let line = pi.lend_line();
    let mut link = link(&line);
    link.wait_until_heard_within(PATIENCE).unwrap();
    assert_eq!(link.store_config(None, &config()).unwrap().1, config().crc());
    link.request(Action::Reboot, "to restart").unwrap();
    drop((link, line));
    // An ordinary restart is no try.
    assert!(!pi.wait_for_restart().to_try);
    // The kernel restarts a Pi by its watchdog, and the box knows that it was asked to.
    assert_eq!(start_number(&pi, 1).reset_reason, ResetReason::PowerOn);
    pi.wait_for("a pose", |seen| poses(&seen.serial).any(is_measured).then_some(()));
    let files = files_on(&pi.disk());
    let has = |name: &str| files.iter().any(|file| file.starts_with(name));
    assert!(has("config.plb") && !has("restart"), "{files:?}");
}

#[test]
fn a_card_without_a_key_gets_one_over_the_line_and_records() {
    let mut pi = Pi::unpaired(&scene::blob(&config()));
    pi.switch_on();
    let announcement = pi.wait_for("an announcement", |seen| {
        assert!(seen.serial_packets.are_announcements());
        seen.serial_packets.announcements().nth(3)
    });
    assert_eq!((announcement.state, announcement.key_id), (BoxState::Unpaired, None));
    let directory = tempfile::tempdir().unwrap();
    let line = pi.lend_line();
    let pair = format!("pair --serial-number PL-0001 --serial {}", line.name());
    let said = binary::plumb_in(directory.path(), &pair);
    assert!(said.contains("paired: "), "{said}");
    let receive = format!("receive --anyway --frames 48 --out trial --serial {}", line.name());
    binary::plumb_in(directory.path(), &receive);
    let rows = plumbline_files::poses::read(&directory.path().join("trial/samples.csv")).unwrap();
    let measured = rows.iter().filter(|row| row.z_mm.is_some()).count();
    assert_eq!((rows.len(), measured), (2 * 48, 2 * 48), "frames without a pose");
    // It is the key that the card has kept.
    let kept = file_on(&pi.disk(), KEY_FILE_NAME).expect("a key on the card");
    let kept = Key::from_text(str::from_utf8(&kept).unwrap()).unwrap();
    assert!(said.contains(&kept.id().to_string()), "{said}");
}

#[test]
fn a_program_that_hangs_is_reset_by_the_pis_watchdog_which_the_next_hello_says() {
    let hang = "plumbline.hang_after=60";
    let mut pi = Pi::new(Some(&scene::blob(&config())), hang);
    pi.switch_on();
    assert_eq!(start_number(&pi, 1).reset_reason, ResetReason::PowerOn);
    // Reset in the middle of its work, the box says so.
    assert_eq!(start_number(&pi, 2).reset_reason, ResetReason::Watchdog);
    let last = pi.wait_for("poses", |seen| poses(&seen.serial).map(|pose| pose.sequence).max());
    assert!((30..60).contains(&last), "frame {last} was processed after the hang");
}

#[test]
fn a_box_that_restarts_into_a_try_asks_the_firmware_for_it() {
    let mut pi = Pi::new(Some(&scene::blob(&config())), "plumbline.try_after=2");
    pi.switch_on();
    let restart = pi.wait_for_restart();
    assert!(restart.to_try, "{restart:?}");
    evidence(
        "a Pi that restarts to try its other slot",
        "1 restart",
        "the firmware got the flag before the restart",
    );
}

#[test]
fn a_first_program_that_hangs_is_reset_by_the_watchdog_that_the_firmware_has_started() {
    // Nobody loads the watchdog's driver.
    let options = "rdinit=/sbin/busybox -- sleep 3600";
    let mut pi = Pi::new(None, options);
    let slot = Slot::A.partition();
    let config = file_on(&place(pi.card(), &slot), "config.txt").expect("there is one");
    let config = String::from_utf8(config).expect("it is text");
    let sooner = config.replace("kernel_watchdog_timeout=15", "kernel_watchdog_timeout=8");
    assert_ne!(sooner, config);
    scene::copy(pi.card(), slot.start_bytes, "config.txt", sooner.as_bytes());
    pi.switch_on();
    let restart = pi.wait_for_restart();
    assert!((7.9..9.0).contains(&restart.at_s) && !restart.to_try, "{restart:?}");
    evidence(
        "a Pi whose first program hangs at once, with the watchdog that the firmware has started for 8 s",
        "1 start",
        &format!("reset after {:.1} s", restart.at_s),
    );
}

impl Computer for Pi {
    fn switch_on(&mut self) {
        Pi::switch_on(self);
    }

    fn cut_power(&mut self) {
        Pi::cut_power(self);
    }

    fn disk(&self) -> String {
        place(self.card(), &SETTINGS)
    }
}

#[test]
fn a_power_cut_while_the_card_is_written_to_leaves_the_old_or_the_new_configuration() {
    let configs = two_of(&config());
    let mut pi = Pi::new(Some(&scene::blob(&configs[0])), "");
    let line = pi.lend_line();
    let mut link = link(&line);
    let cut = assert_power_cuts_leave_one(&mut pi, &mut link, &configs, 2);
    println!("{cut:?}");
}

/// The host's end of the line.
fn link(line: &Lent) -> BoxLink {
    let serial = Serial::open(line.name(), 115_200).expect("the line is there");
    let link = Link::new(serial, vec![known_box()], "boot test");
    BoxLink::new(Box::new(link), line.name().to_owned(), LinkKind::Serial)
}

fn nearest_mm(known: &[Position], found: &Position) -> f64 {
    known.iter().map(|known| distance_mm(known, found)).fold(f64::INFINITY, f64::min)
}
