//! What the user sees: a live view on a terminal, plain lines elsewhere, and a
//! summary at the end.

use std::fmt::Write as _;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use anstream::{AutoStream, ColorChoice};
use anstyle::AnsiColor;
use comfy_table::{Table, presets};
use indicatif::{ProgressBar, ProgressStyle};
use plumbline::packet::{CameraState, Hello};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_stream::receiver::Receiver;
use plumbline_trial::verdict::Criteria;

use super::course::Course;
use live::Live;

mod big;
mod live;

/// A terminal is redrawn this often.
const REDRAW_EVERY: Duration = Duration::from_millis(100);

/// Where standard error is no terminal, a line is written this often.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// The live view, on standard error.
pub(super) struct Screen {
    bar: ProgressBar,
    place: String,
    /// Which trial this is.
    title: String,
    quiet: bool,
    terminal: bool,
    last: Option<Instant>,
    live: Live,
    /// The t = 0 from which movement counts.
    zero: Option<Instant>,
    /// What a dot of the large digits is made of.
    dot: char,
    is_coloured: bool,
}

impl Screen {
    pub(super) fn new(place: &str, title: &str, criteria: Criteria, quiet: bool) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar =
            if quiet || !terminal { ProgressBar::hidden() } else { ProgressBar::new_spinner() };
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg}") {
            bar.set_style(style);
        }
        let mut screen = Self {
            bar,
            place: place.to_owned(),
            title: title.to_owned(),
            quiet,
            terminal,
            last: None,
            live: Live::new(criteria),
            zero: None,
            dot: dot(),
            is_coloured: AutoStream::choice(&std::io::stderr()) != ColorChoice::Never,
        };
        if !terminal {
            screen.say(&format!("listening at {place}"));
        }
        screen
    }

    /// What is drawn on the terminal, to be put aside while something else is written there.
    pub(super) fn bar(&self) -> ProgressBar {
        self.bar.clone()
    }

    pub(super) fn show<W: Write>(&mut self, receiver: &mut Receiver<W>, course: &mut Course) {
        for notice in receiver.take_notices().into_iter().chain(course.news()) {
            self.say(&notice);
        }
        let now = Instant::now();
        if std::mem::replace(&mut self.zero, course.zero()) != course.zero() {
            self.live.start_over();
        }
        if let Some(latest) = receiver.latest(now) {
            self.live.take(latest, now);
        }
        let every = if self.terminal { REDRAW_EVERY } else { LINE_EVERY };
        if self.quiet || now.duration_since(*self.last.get_or_insert(now)) < every {
            return;
        }
        self.last = Some(now);
        let text =
            format!("{}\n{}", time(course, now), status(receiver, &self.live, &self.place, now));
        if self.terminal {
            let large = clock(course, self.dot, now).join("\n");
            let text = if self.is_coloured { coloured(&text) } else { text };
            self.bar.set_message(format!("{}\n{large}\n{text}", self.title));
            self.bar.tick();
        } else {
            self.say(text.replace("\n ", ";").replace('\n', "; ").trim_end());
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

/// The same with the line of the verdict in the colour of its word.
fn coloured(text: &str) -> String {
    let line = |line: &str| {
        let colour = match line.get(..4) {
            Some("GOOD") => AnsiColor::Green,
            Some("LOOK") => AnsiColor::Yellow,
            Some("STOP") => AnsiColor::Red,
            _ => return line.to_owned(),
        };
        let style = colour.on_default().bold().invert();
        format!("{style} {line} {style:#}")
    };
    text.lines().map(line).collect::<Vec<_>>().join("\n")
}

/// The time since t = 0 or the start, and what remains of it, in large digits.
fn clock(course: &Course, dot: char, now: Instant) -> [String; 5] {
    let minutes = |time: Duration| format!("{}:{:02}", time.as_secs() / 60, time.as_secs() % 60);
    let mut text = minutes(course.elapsed(now).0);
    if let Some((to_go, _)) = course.remaining(now).filter(|_| !course.awaits_mark()) {
        // Rounded up: 0 is the end.
        let to_go = minutes(to_go + Duration::from_millis(999));
        text += &format!(" {to_go}");
    }
    big::lines(&text, dot)
}

/// A block, where the terminal has one.
fn dot() -> char {
    let locale = ["LC_ALL", "LC_CTYPE", "LANG"]
        .into_iter()
        .find_map(|name| std::env::var(name).ok().filter(|value| !value.is_empty()));
    let is_utf8 = locale.is_some_and(|it| it.to_lowercase().replace('-', "").contains("utf8"));
    if is_utf8 { '█' } else { '#' }
}

/// How far the recording has come.
fn time(course: &Course, now: Instant) -> String {
    let (elapsed, since) = course.elapsed(now);
    let mut words = vec![format!("{:.0} s {since}", elapsed.as_secs_f64())];
    words.extend(
        course.remaining(now).map(|(to_go, until)| format!("{} s {until}", to_go.as_secs())),
    );
    words.extend(course.note().map(str::to_owned));
    words.join(", ")
}

fn status<W: Write>(receiver: &Receiver<W>, live: &Live, place: &str, now: Instant) -> String {
    let counts = receiver.counts();
    let Some(latest) = receiver.latest(now) else {
        return status_without_pose(receiver, place, now);
    };
    let lost_percent = 100.0 * counts.lost as f64 / (counts.received + counts.lost).max(1) as f64;
    let mut lines = vec![format!(
        "{:.1} Hz, {}, {} lost, {} late, {} corrupt, latency {:.1} ms",
        receiver.rate_hz(now),
        counted(counts.received, "frame"),
        counts.lost,
        counts.late,
        receiver.bad().corrupt,
        f64::from(latest.latency_us) / 1000.0,
    )];
    let movement = live.movement(latest);
    if !movement.is_empty() {
        lines.insert(0, live.verdict(lost_percent, now));
    }
    lines.extend(movement);
    lines.join("\n  ")
}

fn status_without_pose<W: Write>(receiver: &Receiver<W>, place: &str, now: Instant) -> String {
    let counts = receiver.counts();
    let camera = camera_now(receiver, now).map(|camera| format!(", {camera}"));
    let camera = camera.unwrap_or_default();
    let bad = receiver.bad();
    let so_far = format!(
        "{}, {} lost, {} corrupt",
        counted(counts.received, "frame"),
        counts.lost,
        bad.corrupt
    );
    if let Some(silence) = receiver.unheard(now) {
        return format!("the box is no longer heard, for {} s; {so_far}", silence.as_secs());
    }
    if let Some(silence) = receiver.silence(now) {
        return format!("no pose for {} s{camera}; {so_far}", silence.as_secs());
    }
    if is_heard(receiver) {
        return format!("{place}: the box is heard, no pose yet{camera}");
    }
    let unusable = bad.corrupt + bad.other_version + bad.other_schema + bad.malformed + bad.numbers;
    format!("{place}: no pose yet, {}", counted(unusable, "unusable packet"))
}

/// Whether anything has come from a box.
fn is_heard<W: Write>(receiver: &Receiver<W>) -> bool {
    receiver.is_heard()
}

/// The state of the box's camera, and since when.
fn camera_now<W: Write>(receiver: &Receiver<W>, now: Instant) -> Option<String> {
    let (camera, health) = (receiver.camera()?, receiver.health()?);
    let state = match camera.state {
        _ if camera.ended => return Some("the box's program has ended".into()),
        CameraState::Starting => return Some("camera starting".into()),
        CameraState::Running | CameraState::Ended => return Some("camera running".into()),
        CameraState::Stalled => "stalled",
        CameraState::Lost => "lost",
    };
    if health.frames == 0 {
        let uptime_s = health.uptime_ms / 1000;
        return Some(format!("camera {state}: no frame since the box's start {uptime_s} s ago"));
    }
    let more = if camera.from_before { "more than " } else { "" };
    let lost_s = now.saturating_duration_since(camera.since).as_secs();
    Some(format!("camera {state} for {more}{lost_s} s"))
}

/// Why no pose was received, as far as can be told from here.
pub(super) fn no_pose<W: Write>(receiver: &Receiver<W>, place: String, now: Instant) -> BadInput {
    if !is_heard(receiver) {
        return BadInput::whole(
            place,
            "no pose packet came",
            "check that the box is on, and that it sends to this computer's address and port \
             (or on this line, at this rate)",
        );
    }
    let mut found = "no pose packet came, although the box is heard".to_owned();
    // Writing to a String does not fail.
    if let Some(camera) = camera_now(receiver, now) {
        let _ = write!(found, ": {camera}");
    }
    let faults = receiver.faults();
    if !faults.is_empty() {
        let _ = write!(found, "; it says: {faults}");
    }
    let remedy = match receiver.camera() {
        Some(camera) if camera.is_absent() => {
            "check the camera's plug, and its settings in the box file"
        }
        _ if !faults.is_empty() => "correct what the box names",
        _ => "wait until its camera delivers frames",
    };
    BadInput::whole(place, found, remedy)
}

/// The table at the end.
pub(super) fn summary<W: Write>(receiver: &Receiver<W>) -> String {
    let counts = receiver.counts();
    let (bad, left_out) = (receiver.bad(), receiver.left_out());
    let mut table = Table::new();
    table.load_style(presets::UTF8_BORDERS_ONLY);
    for (what, value) in boxes(receiver) {
        table.add_row([what.to_owned(), value]);
    }
    let percent = |part: u64, whole: u64| 100.0 * part as f64 / (whole.max(1)) as f64;
    let lost = percent(counts.lost, counts.received + counts.lost);
    table.add_row(["frames received".to_owned(), counts.received.to_string()]);
    table.add_row(["lost".to_owned(), format!("{} ({lost:.2} %)", counts.lost)]);
    let mut rows = vec![
        ("repeated", counts.repeated),
        ("late", counts.late),
        ("corrupt", bad.corrupt),
        ("of another version", bad.other_version),
        ("of another schema", bad.other_schema),
        ("starts of the box", u64::from(receiver.sessions())),
    ];
    // These are rare enough to be named only when they are there.
    for row in [
        ("malformed", bad.malformed),
        ("implausible", counts.implausible + bad.numbers),
        ("of another box", left_out.other_box),
        ("of a second box of this name", left_out.conflicting),
        ("of a start without a name", left_out.unknown_start),
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
        rows.push(("corners the box dropped", u64::from(health.corners_dropped)));
    }
    for (what, count) in rows {
        table.add_row([what.to_owned(), count.to_string()]);
    }
    if let Some(camera) = camera_at_the_end(receiver) {
        table.add_row(["the box's camera".to_owned(), camera]);
    }
    for (what, is_so, word) in [
        ("the box's power supply", receiver.power().undervoltage, "too weak"),
        ("the box's processor", receiver.power().throttled, "slowed down"),
    ] {
        if is_so == Some(true) {
            table.add_row([what, word]);
        }
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

/// Who was heard. Where it was not one box in one configuration all the time,
/// also how many frames came from each.
fn boxes<W: Write>(receiver: &Receiver<W>) -> Vec<(&'static str, String)> {
    let identity = |hello: &Hello| {
        let name = format!("{} ({})", hello.device, hello.serial_number);
        [name, hello.firmware.to_string(), format!("{:08x}", hello.config_crc)]
    };
    let mut boxes: Vec<(Option<[String; 3]>, u64)> = Vec::new();
    for run in receiver.runs() {
        let who = run.hello.as_ref().map(identity);
        match boxes.iter_mut().find(|(known, _)| *known == who) {
            Some((_, frames)) => *frames += run.frames,
            // Nothing is to be said of a start that was only heard of.
            None if who.is_none() && run.frames == 0 => {}
            None => boxes.push((who, run.frames)),
        }
    }
    if let [(who, _)] = &boxes[..] {
        let Some([name, program, configuration]) = who.clone() else { return Vec::new() };
        return vec![("box", name), ("its program", program), ("its configuration", configuration)];
    }
    let described = boxes.into_iter().map(|(who, frames)| match who {
        Some([name, program, configuration]) => {
            let frames = counted(frames, "frame");
            format!("{name}, {program}, configuration {configuration}: {frames}")
        }
        None => format!("one that did not give its name: {}", counted(frames, "frame")),
    });
    described.map(|text| ("box", text)).collect()
}

/// What became of the camera in the last run.
fn camera_at_the_end<W: Write>(receiver: &Receiver<W>) -> Option<String> {
    let (camera, health) = (receiver.camera()?, receiver.health()?);
    let losses = counted(health.camera_losses, "time");
    Some(match camera.state {
        CameraState::Lost | CameraState::Stalled if health.frames == 0 => {
            "never gave a frame".into()
        }
        CameraState::Lost | CameraState::Stalled => {
            format!("lost {losses}, absent at the end")
        }
        _ => format!("lost {losses}"),
    })
}

#[cfg(test)]
mod tests;
