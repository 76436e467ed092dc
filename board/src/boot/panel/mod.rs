//! What a person at the box sees: its green LED blinks the [status], and a
//! screen, if one is plugged in, shows the box's name, its network, its status, and what is
//! wrong.
//!
//! ```text
//!   status, logger ─▶ panel, ten times a second ─▶ lamp   ─▶ /sys/class/leds
//!                                               └─▶ screen ─▶ picture ─▶ /dev/fb0
//! ```
//!
//! This is done by a thread of normal priority, which does not allocate after its start and
//! reports faults only through the log. It never makes the box fail: an LED or a screen that is
//! missing is searched for again every second, as drivers are loaded after this starts.
//!
//! A box that hangs looks like one that has failed: that is shown when the main loop has not
//! refreshed the status for [`HUNG_AFTER`].

mod files;
mod lamp;
mod picture;
mod screen;
mod text;

use std::fmt::Write as _;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use heapless::String;
use plumbline::config::Config;

use crate::logger::{self, Latest};
use crate::status::{self, Status};
use files::Root;
use lamp::Lamp;
use picture::{NAME_BYTES_MAX, Shown};
use screen::Screen;

/// How often the status is read.
const TICK: Duration = Duration::from_millis(100);

/// The number of ticks between two searches for a missing LED or screen.
const TICKS_PER_LOOK: u64 = 10;

/// The smallest number of ticks between two pictures on the screen.
const TICKS_PER_PICTURE: u64 = 5;

/// The main loop is taken to hang when it has not set the status for this long. An iteration
/// takes 20 ms, and opening a camera seldom more than a second.
pub const HUNG_AFTER: Duration = Duration::from_secs(3);

/// A complaint that is not repeated is shown for this long; one about an absent camera is
/// repeated every five seconds.
const COMPLAINT_AGE_MAX: Duration = Duration::from_secs(30);

/// The name of a box without a configuration.
const NAMELESS: &str = "Plumbline";

const HANGS: &str = "the program hangs";

const STACK_BYTES: usize = 128 << 10;

static NAME: OnceLock<String<NAME_BYTES_MAX>> = OnceLock::new();

/// Starts showing what the box is doing.
pub fn start() {
    let thread = std::thread::Builder::new().name("panel".into()).stack_size(STACK_BYTES);
    if let Err(error) = thread.spawn(run) {
        log::warn!("neither the LED nor a screen shows the status: no thread: {error}");
    }
}

/// Sets the box's name, once.
pub fn name(config: &Config) {
    let mut name = String::new();
    // There is room for both.
    let _ = write!(name, "{} ({})", config.device, config.serial_number);
    let _ = NAME.set(name);
}

fn run() {
    let mut panel = Panel::new("");
    let mut next = Instant::now();
    loop {
        let name = NAME.get().map_or(NAMELESS, String::as_str);
        panel.tick(status::current(), name, logger::latest().as_ref());
        // Ticks that were missed are not made up for.
        next = (next + TICK).max(Instant::now());
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
}

/// The LED and the screen.
pub struct Panel<'a> {
    lamp: Lamp<'a>,
    screen: Screen<'a>,
    ticks: u64,
}

impl<'a> Panel<'a> {
    /// The LED and the screen of the computer whose `/sys` and `/dev` are in the folder `root`.
    #[must_use]
    pub fn new(root: &'a str) -> Self {
        let root = Root::new(root);
        Self { lamp: Lamp::new(root), screen: Screen::new(root), ticks: 0 }
    }

    /// Shows what the box is doing: the status, with the time since it was set, the box's
    /// name, and the latest texts of the log, if they could be read.
    pub fn tick(&mut self, current: (Status, Duration), name: &str, latest: Option<&Latest>) {
        if self.ticks.is_multiple_of(TICKS_PER_LOOK) {
            self.lamp.look();
            self.screen.look();
        }
        let (status, age) = current;
        let hangs = status.is_refreshed() && age > HUNG_AFTER;
        let status = if hangs { Status::Failed } else { status };
        // The lamp first: a fault must be seen whatever the screen does.
        self.lamp.show(lamp::lit(status, self.ticks));
        if self.ticks.is_multiple_of(TICKS_PER_PICTURE)
            && let Some(latest) = latest
        {
            let detail = if hangs { HANGS } else { detail(status, latest) };
            self.screen.show(&Shown::new(name, &latest.network, status, detail));
        }
        self.ticks += 1;
    }
}

/// What is wrong, from the log, without the words of the status itself.
fn detail(status: Status, latest: &Latest) -> &str {
    let is_recent = latest.complained_at.is_some_and(|at| at.elapsed() <= COMPLAINT_AGE_MAX);
    if status == Status::Tracking || !(is_recent || status.is_final()) {
        return "";
    }
    let text = latest.complaint.as_str();
    let rest = text.strip_prefix(status.words()).and_then(|rest| rest.strip_prefix(": "));
    rest.unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complaint(text: &str, age: Duration) -> Latest {
        Latest {
            complaint: text.try_into().unwrap(),
            complained_at: Some(Instant::now() - age),
            ..Latest::default()
        }
    }

    #[test]
    fn what_is_wrong_is_shown_as_long_as_it_matters() {
        let (now, long_ago) = (Duration::ZERO, COMPLAINT_AGE_MAX + Duration::from_secs(1));
        let camera = "camera: no frame for a second: reopening it";
        let refused = "configuration refused: links.udp: the port may not be 0";
        let table = [
            (Status::NoCamera, camera, now, camera),
            (Status::NoCamera, camera, long_ago, ""),
            (Status::Tracking, camera, now, ""),
            (Status::Refused, refused, long_ago, "links.udp: the port may not be 0"),
        ];
        for (status, text, age, expected) in table {
            assert_eq!(detail(status, &complaint(text, age)), expected, "{status:?} {text}");
        }
        assert_eq!(detail(Status::Starting, &Latest::default()), "");
    }

    /// A folder with an LED in it, and its brightness after a tick.
    fn led(folder: &std::path::Path) -> impl Fn() -> bool {
        let led = folder.join("sys/class/leds/ACT");
        std::fs::create_dir_all(&led).unwrap();
        std::fs::write(led.join("trigger"), "").unwrap();
        std::fs::write(led.join("brightness"), "").unwrap();
        move || std::fs::read(led.join("brightness")).unwrap() == b"1"
    }

    #[test]
    fn a_main_loop_that_hangs_is_shown_as_failed() {
        let folder = tempfile::tempdir().unwrap();
        let is_lit = led(folder.path());
        let mut panel = Panel::new(folder.path().to_str().unwrap());
        let mut share = |said| {
            let tick = |_: &i32| {
                panel.tick(said, "ward 3", Some(&Latest::default()));
                is_lit()
            };
            (0..40).filter(tick).count()
        };
        assert_eq!(share((Status::Tracking, HUNG_AFTER)), 4);
        assert_eq!(share((Status::Tracking, HUNG_AFTER + Duration::from_millis(1))), 40);
        // A box that waits for a configuration does not refresh its status.
        assert_eq!(share((Status::NoConfiguration, Duration::from_secs(3600))), 20);
    }

    #[test]
    fn a_computer_without_led_and_screen_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let mut panel = Panel::new(folder.path().to_str().unwrap());
        for _ in 0..30 {
            panel.tick((Status::Tracking, Duration::ZERO), "ward 3", Some(&Latest::default()));
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
