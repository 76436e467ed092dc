//! What the user sees: a live view on a terminal, plain lines elsewhere, and a
//! summary at the end.

use std::fmt::Write as _;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use comfy_table::{Table, presets};
use indicatif::{ProgressBar, ProgressStyle};

use super::receiver::Receiver;
use super::recorder::state_words;

/// A terminal is redrawn this often.
const REDRAW_EVERY: Duration = Duration::from_millis(100);

/// Where standard error is no terminal, a line is written this often.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// The live view, on standard error.
pub(super) struct Screen {
    bar: ProgressBar,
    place: String,
    quiet: bool,
    terminal: bool,
    last: Option<Instant>,
}

impl Screen {
    pub(super) fn new(place: &str, quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar =
            if quiet || !terminal { ProgressBar::hidden() } else { ProgressBar::new_spinner() };
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg}") {
            bar.set_style(style);
        }
        let mut screen = Self { bar, place: place.to_owned(), quiet, terminal, last: None };
        if !terminal {
            screen.say(&format!("listening at {place}"));
        }
        screen
    }

    pub(super) fn show<W: Write>(&mut self, receiver: &mut Receiver<W>) {
        for notice in receiver.take_notices() {
            self.say(&notice);
        }
        let now = Instant::now();
        let every = if self.terminal { REDRAW_EVERY } else { LINE_EVERY };
        if self.quiet || now.duration_since(*self.last.get_or_insert(now)) < every {
            return;
        }
        self.last = Some(now);
        let text = status(receiver, &self.place, now);
        if self.terminal {
            self.bar.set_message(text);
            self.bar.tick();
        } else {
            self.say(text.replace("\n ", ";").trim_end());
        }
    }

    pub(super) fn end(&mut self) {
        self.bar.finish_and_clear();
    }

    fn say(&mut self, text: &str) {
        if !self.quiet {
            // Standard error may be closed; there is nobody else to tell.
            self.bar.suspend(|| {
                let _ = writeln!(std::io::stderr(), "{text}");
            });
        }
    }
}

fn status<W: Write>(receiver: &Receiver<W>, place: &str, now: Instant) -> String {
    let counts = receiver.counts();
    let Some(latest) = receiver.latest() else {
        let bad = receiver.bad();
        let unusable = bad.corrupt + bad.other_version + bad.other_schema + bad.malformed;
        return format!("{place}: no pose yet, {unusable} unusable packets");
    };
    let mut text = format!(
        "{:.1} Hz, {} frames, {} lost, {} corrupt, latency {:.1} ms",
        receiver.rate_hz(now),
        counts.received,
        counts.lost,
        receiver.bad().corrupt,
        f64::from(latest.latency_us) / 1000.0,
    );
    for target in &latest.targets {
        let name = receiver.name(target.role);
        // Writing to a String does not fail.
        let _ = write!(text, "\n  {name:16} {}", state_words(target));
        if let Ok(pose) = &target.pose {
            let [x, y, z] = pose.translation_mm;
            let _ = write!(text, "  x {x:.2}  y {y:.2}  z {z:.2} mm  {} corners", pose.corners);
            let total = receiver.corners_total(target.role);
            if let Some(total) = total.filter(|total| *total != pose.corners) {
                let _ = write!(text, " of {total}");
            }
        }
    }
    text
}

/// The table at the end.
pub(super) fn summary<W: Write>(receiver: &Receiver<W>) -> String {
    let counts = receiver.counts();
    let bad = receiver.bad();
    let mut table = Table::new();
    table.load_style(presets::UTF8_BORDERS_ONLY);
    if let Some(hello) = receiver.hello() {
        let name = format!("{} ({})", hello.device, hello.serial_number);
        table.add_row(["box".to_owned(), name]);
        table.add_row(["its program".to_owned(), hello.firmware.to_string()]);
        table.add_row(["its configuration".to_owned(), format!("{:08x}", hello.config_crc)]);
    }
    let percent = |part: u64, whole: u64| 100.0 * part as f64 / (whole.max(1)) as f64;
    let lost = percent(counts.lost, counts.received + counts.lost);
    table.add_row(["frames received".to_owned(), counts.received.to_string()]);
    table.add_row(["lost".to_owned(), format!("{} ({lost:.2} %)", counts.lost)]);
    let mut rows = vec![
        ("repeated", counts.repeated),
        ("reordered", counts.reordered),
        ("corrupt", bad.corrupt),
        ("of another version", bad.other_version),
        ("of another schema", bad.other_schema),
        ("sessions", u64::from(counts.sessions)),
    ];
    // These are rare enough to be named only when they are there.
    for row in [
        ("malformed", bad.malformed),
        ("of another box", bad.other_sender),
        ("cut at the start", bad.fragments),
        ("serial line lost", receiver.line_losses()),
    ] {
        if row.1 > 0 {
            rows.push(row);
        }
    }
    if let Some(health) = receiver.health() {
        rows.push(("frames the box dropped", u64::from(health.frames_dropped)));
        rows.push(("frames the camera missed", u64::from(health.frames_missed)));
        rows.push(("camera losses", u64::from(health.camera_losses)));
        rows.push(("corners the box dropped", u64::from(health.corners_dropped)));
    }
    for (what, count) in rows {
        table.add_row([what.to_owned(), count.to_string()]);
    }
    for (name, share) in receiver.shares() {
        let percent = percent(share.poses, share.frames);
        table.add_row([
            format!("{name} with pose"),
            format!("{} of {} ({percent:.2} %)", share.poses, share.frames),
        ]);
    }
    table.to_string()
}
