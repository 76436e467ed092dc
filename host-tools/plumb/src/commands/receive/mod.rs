//! `plumb receive`: checks a box, listens to it, shows what it says and records it.

use std::cell::RefCell;
use std::io::Write as _;
use std::net::SocketAddr;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use plumbline::packet::{Action, TriggerState};
use plumbline_bedside::doctor::{Check, Verdict, examine};
use plumbline_bedside::recording::marks::{self, MarkFrom, Strangers, Uncounted};
use plumbline_bedside::recording::modem_line::{self, ModemLine, Watch};
use plumbline_bedside::recording::{Course, Here, Recorded, Zeroing, amiss, check_heard};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_publish::MarkFeed;
use plumbline_publish::lsl::Lsl;
use plumbline_publish::lsl::markers::Markers;
use plumbline_stream::link::BoxLink;
use plumbline_stream::questions::Questions;
use plumbline_stream::receiver::Receiver;
use plumbline_stream::reception::{Tap, receive};
use plumbline_stream::recorder::Recorder;
use plumbline_trial::manifest::{CheckSeen, Manifest, Zero};
use plumbline_trial::mark::{Mark, MarkSender, Marks, Source};
use plumbline_trial::recording::{Recording, exists_already};
use plumbline_trial::verdict::Criteria;

use super::doctor;
use crate::arguments::streams::{StreamArguments, library};
use crate::arguments::{LinkArguments, seconds};
use crate::ui::stop::{stop_on_signals, until_stopped};
use crate::ui::waiting;

mod keys;
mod screen;
mod streams;
mod words;

use keys::Keys;
use screen::Screen;
use streams::Streams;

/// Receive the poses of a box, show them and record them.
///
/// With --out it makes a folder for the trial: every packet as it came (packets.bin), the poses
/// as tables (samples.csv, samples.parquet), the box's configuration, and trial.toml, which says
/// who was measured and how, how the box's clock relates to this computer's, and which events were
/// marked. However the recording ends, no more than its last second is lost.
///
/// Before it records, it checks the box as `plumb doctor` does, with the targets in sight, and says
/// what is amiss. If a check fails it records nothing and leaves no folder, unless --anyway is given:
/// then the recording begins with the first packet, and the checks look at what is recorded. What
/// failed, was warned of or was skipped stands in trial.toml. To see whether the camera was moved since `plumb
/// scene`, it asks for one small picture, in set-up mode; with --anyway it does not. A recording that
/// the box replays needs --anyway if it is to be recorded from its first frame.
///
/// Counts what is lost, repeated, late, corrupt or implausible. When the box restarts, the recording
/// goes on, with a gap. Another box that sends here is left out and counted; once it has taken this
/// one's place, the recording ends with an error and is kept.
///
/// A terminal becomes a screen that can be read from two metres, if it has 80 x 24 characters or
/// more. It shows GOOD, LOOK or STOP: by its criteria the trial would now be good, doubtful or
/// unusable. WAIT stands there for the first three seconds. What only the end can tell, the duration
/// and the mark, is left to the end. Movement is in mm from where the trunk was on average in the
/// second before t = 0 and, until t = 0 comes, in the last second: as bars, from above and, with 38
/// rows or more, over the last half minute. Path and RMS are those of `plumb report`, with its
/// filter, from t = 0 until a quarter of a second ago; beside the path stands what noise alone would
/// have given. Elsewhere a line is written every ten seconds.
///
/// Press Enter to mark an event; type its name first if it has one. An edge at the box's trigger line,
/// if it has one, is a mark too. The mark called zero, or else the first mark, is the trial's t = 0.
/// Each mark is shown with its time. Ends --duration after t = 0, after --frames or with Ctrl-C, and
/// prints a summary and the verdict on the trial: good, doubtful or unusable, with the reasons.
///
/// Other programs can have the poses while they come: by the Lab Streaming Layer (--lsl), as lines of
/// JSON (--json) or by OSC (--osc). What they do, or do not do, never touches the recording.
///
/// Exit code 0: done; 1: a check failed, or Ctrl-C came before the checks were over, and nothing was
/// recorded; 2: an input or the link could not be used, or nothing came.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(after_help = "Examples:\n  plumb receive --out trials/p01-control\n  \
    plumb receive --out trials/p01-control --participant P01 --condition control --duration 60\n  \
    plumb receive --out trials/replayed --anyway  # whatever the checks say, from the first packet on\n  \
    plumb receive --serial /dev/ttyUSB0 --out trials/p02 --mark-udp 0.0.0.0:5000\n  \
    echo stands | nc -u -w0 127.0.0.1 5000        # a mark from another program\n  \
    plumb receive --out trials/p03 --lsl --mark-lsl Stimuli    # for LSL's recorder, marks from a stimulus program\n  \
    plumb receive --json 4217                     # and: nc 127.0.0.1 4217")]
pub struct Arguments {
    /// Where the box sends to.
    #[command(flatten)]
    link: LinkArguments,

    /// Record into this new folder; it is removed again if no frame comes
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,

    /// Who is measured: a code, not a name
    #[arg(long, value_name = "CODE", requires = "out")]
    participant: Option<String>,

    /// Under which condition
    #[arg(long, value_name = "WORD", requires = "out")]
    condition: Option<String>,

    /// Anything else that trial.toml should say
    #[arg(long, value_name = "TEXT", requires = "out")]
    note: Option<String>,

    /// What t = 0 is
    #[arg(long, value_enum, default_value_t, requires = "out")]
    zero: Zero,

    /// Judge the trial by these criteria (`plumb replay --new-criteria` writes them, explained)
    #[arg(long, value_name = "FILE", requires = "out")]
    criteria: Option<PathBuf>,

    /// Take marks from datagrams to this address: the text of each is its name
    ///
    /// Only from this computer, unless others are named with --mark-from.
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = crate::arguments::address, requires = "out")]
    mark_udp: Option<SocketAddr>,

    /// Take marks from this computer too, whose name is written beside them; may be repeated
    ///
    /// Whoever can send under a false address in this network can make marks then.
    #[arg(long, value_name = "NAME=ADDRESS", value_parser = MarkFrom::parse, requires = "mark_udp")]
    mark_from: Vec<MarkFrom>,

    /// Take marks from this serial device: each line is a mark
    #[arg(long, value_name = "DEVICE[:BAUD]", requires = "out")]
    mark_serial: Option<String>,

    /// Take marks from a modem line of this serial device: cts (default), dsr, dcd or ri
    ///
    /// Each time the line is asserted is a mark, named after the line. Its time is known to a
    /// millisecond or, where the driver does not tell of changes and has to be asked, to the time
    /// between two questions; an adapter on USB may add its own interval, 1 to 32 ms. Either is stored
    /// with the mark. A trigger at the box's own line ([trigger] in box.toml) is known ten times better.
    #[arg(long, value_name = "DEVICE[:LINE]", value_parser = ModemLine::parse, requires = "out")]
    mark_line: Option<ModemLine>,

    /// Take marks from the Lab Streaming Layer: the markers of the stream with this name
    ///
    /// A mark has the time that its sender gave it, corrected by LSL. The stream may begin later. As
    /// for --lsl, liblsl must be installed.
    #[arg(long, value_name = "NAME", requires = "out")]
    mark_lsl: Option<String>,

    /// Streams for other programs.
    #[command(flatten)]
    streams: StreamArguments,

    /// End this many seconds after t = 0: the mark's, where one can come; otherwise the first frame's
    ///
    /// With --zero mark, the default, the recording waits for the mark, no longer than 10 minutes.
    /// Without a keyboard, --mark-udp, --mark-serial, --mark-line, --mark-lsl and a trigger of the box no
    /// mark can come, and the time counts from the first frame, as it does with --zero start and with
    /// --zero onset, whose t = 0 is found afterwards.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    duration: Option<Duration>,

    /// End after this many frames
    #[arg(long, value_name = "NUMBER", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,

    /// Record even if a check of the box fails, and from the first packet on
    #[arg(long, requires = "out")]
    anyway: bool,

    /// Take also what the box has kept of the last minute
    ///
    /// For what a box replays, and has begun to send before this program listened; needs --anyway
    /// with --out.
    #[arg(long)]
    past: bool,

    /// How long the box is checked
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = "3", requires = "out")]
    check_seconds: Duration,

    /// Show nothing but errors, what the checks find, and the summary
    #[arg(long)]
    quiet: bool,
}

impl Arguments {
    /// Which trial this is, for people.
    fn title(&self, place: &str) -> Vec<String> {
        let Some(out) = &self.out else { return vec![place.to_owned()] };
        let of = |name: &str, text: &Option<String>| text.as_ref().map(|it| format!("{name} {it}"));
        let participant = of("participant", &self.participant);
        let condition = of("condition", &self.condition);
        [Some(out.display().to_string()), participant, condition].into_iter().flatten().collect()
    }

    /// By what the trial is judged.
    fn criteria(&self) -> Result<Criteria, BadInput> {
        Ok(self.criteria.as_deref().map(Criteria::read).transpose()?.unwrap_or_default())
    }

    /// Whether a mark is t = 0, if one comes.
    fn awaits_mark(&self) -> bool {
        self.out.is_some() && self.zero == Zero::Mark
    }

    /// From when --duration counts, as far as it depends on this computer.
    fn zeroing(&self) -> Zeroing {
        let can_be_marked = self.out.is_some()
            && (self.mark_udp.is_some()
                || self.mark_serial.is_some()
                || self.mark_line.is_some()
                || self.mark_lsl.is_some()
                || keys::is_there());
        match self.zero {
            Zero::Mark if can_be_marked => Zeroing::Mark,
            Zero::Mark | Zero::Start => Zeroing::Start,
            Zero::Onset => Zeroing::Onset,
        }
    }
}

/// Runs the subcommand; false if a check failed, or the program was ended, before anything was recorded.
///
/// # Errors
/// When the address, the device or the folder cannot be used, or nothing came.
pub fn run(arguments: &Arguments) -> anyhow::Result<bool> {
    // Before anybody waits for the box.
    let criteria = arguments.criteria()?;
    if let Some(out) = arguments.out.as_deref().filter(|out| out.exists()) {
        return Err(exists_already(out).into());
    }
    let ways = arguments.streams.ways();
    let lsl = library([ways.lsl.as_ref(), arguments.mark_lsl.as_ref()])?;
    let stop = stop_on_signals()?;
    let (mut link, is_prepared) = until_stopped(arguments.link.open_with(arguments.past)?, &stop);
    let place = link.place().to_owned();
    let prepared = match &arguments.out {
        None => None,
        Some(out) => {
            let prepared = prepare(arguments, out, lsl, &mut link);
            if stop.load(Ordering::Relaxed) {
                eprintln!("ended before anything was recorded");
                return Ok(false);
            }
            match prepared? {
                None => return Ok(false),
                prepared => prepared,
            }
        }
    };
    is_prepared.set(true);
    let now = Instant::now();
    let course = Rc::new(RefCell::new(Course::new(now, arguments.duration, arguments.zeroing())));
    let mut streams = Streams::open(&ways, lsl, now, prepared.is_none(), arguments.quiet)?;
    let judged_by = prepared.is_some().then(|| criteria.clone());
    let mut screen = Screen::new(&place, &arguments.title(&place), judged_by, arguments.quiet);
    let mut sender = None;
    let mut strangers = Strangers::default();
    let mut markers = None;
    let mut watch = None;
    let mut recorded = match prepared {
        None => None,
        Some(mut prepared) => {
            sender = prepared.sender.take();
            strangers = prepared.strangers.clone();
            markers = prepared.markers.take();
            watch = prepared.watch.take();
            let told = streams.as_ref().map(Streams::mark_feed);
            let recording = begin(arguments, prepared, criteria, now, (&course, told))?;
            let course = Rc::clone(&course);
            Some(if arguments.anyway {
                let duration = arguments.check_seconds;
                let voice = screen.voice();
                let say = move |checks: &[Check]| match &voice {
                    Some(voice) => voice.say(&doctor::amiss_in_words(checks)),
                    None => doctor::print_amiss(checks),
                };
                Recorded::unchecked(recording, course, &link, now, duration, say)
            } else {
                Recorded::checked(recording, course)
            })
        }
    };
    let marks_typed = sender.is_some();
    let keys = keyboard(sender, &stop, arguments.quiet);
    let recorder = match &recorded {
        Some(recorded) => {
            let csv = recorded.recording().csv();
            Some(Recorder::new(plumbline_files::Late::new(&csv, false)?, csv.display().to_string()))
        }
        None => None,
    };
    let mut receiver = Receiver::new(recorder);
    let tap: &mut dyn Tap = match &mut recorded {
        Some(recorded) => recorded,
        None => &mut (),
    };
    let mut nobody = ();
    let beside: &mut dyn Tap = match &mut streams {
        Some(streams) => streams.tap(),
        None => &mut nobody,
    };
    let mut taps = (tap, beside);
    let mut transport = link.into_transport();
    let result =
        receive(&mut *transport, &mut receiver, &mut taps, arguments.frames, &stop, |receiver| {
            let now = Instant::now();
            let mut course = course.borrow_mut();
            if receiver.counts().received > 0 {
                course.frame(now);
            }
            let has_trigger =
                receiver.health().is_some_and(|it| it.trigger.input != TriggerState::Off);
            if has_trigger && arguments.awaits_mark() {
                course.can_be_marked();
            }
            let typed = || keys.as_ref().filter(|_| marks_typed).map(Keys::typed);
            screen.show(receiver, &mut course, typed);
            if course.is_over(now) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
    if recorded.is_some() {
        // Whoever wants to change the box may do so now. One that gets none of these finds out by
        // itself.
        for _ in 0..3 {
            transport.send(&Questions::of_tap().ask(Action::Record { on: false }).1);
        }
    }
    let here = Here { dropped: transport.dropped_here(), obstacle: transport.obstacle() };
    // First of all the trial: a terminal that has stalled takes nothing now.
    let ended = recorded.map(|recorded| end(recorded, receiver.counts().received));
    drop(keys);
    drop(screen);
    let refused = markers.map_or(0, |it| it.refused());
    let mut text = words::summary(&receiver, &here);
    if let Some(Ok(words)) = &ended {
        text += &format!("\n{words}");
    }
    for amiss in (Uncounted { strangers, watch, refused }).amiss() {
        text += &format!("\nwarning: {amiss}");
    }
    for words in streams.map(Streams::finish).unwrap_or_default() {
        text += &format!("\n{words}");
    }
    // A closed pipe must not hide the result.
    let _ = writeln!(std::io::stdout(), "{text}");
    // The reason for the end matters more than a fault while closing.
    result?;
    ended.transpose()?;
    // Whoever ends it by hand has seen the screen.
    if !stop.load(Ordering::Relaxed) {
        check_heard(&receiver, &here, place, Instant::now())?;
    }
    Ok(true)
}

/// The keyboard of a terminal that is a screen.
fn keyboard(sender: Option<MarkSender>, stop: &Arc<AtomicBool>, is_quiet: bool) -> Option<Keys> {
    if !screen::is_screen(is_quiet) || !keys::is_there() {
        return None;
    }
    let keys = Keys::open(sender.clone(), Arc::clone(stop)).ok();
    // A terminal that takes no keys one by one gives lines; Ctrl-C is still a signal.
    if let Some(sender) = sender.filter(|_| keys.is_none()) {
        keys::listen_to_lines(sender);
    }
    keys
}

/// What is there before a recording begins.
struct Prepared<'a> {
    out: &'a Path,
    /// For marks from the keyboard, where the terminal is a screen.
    sender: Option<MarkSender>,
    marks: Marks,
    strangers: Strangers,
    markers: Option<Markers>,
    watch: Option<Watch>,
    amiss: Vec<CheckSeen>,
}

/// Checks the box, unless it is to be recorded anyway; `None` if a check failed.
fn prepare<'a>(
    arguments: &Arguments,
    out: &'a Path,
    lsl: Option<Lsl>,
    link: &mut BoxLink,
) -> Result<Option<Prepared<'a>>, BadInput> {
    let (sender, marks, strangers) =
        marks::listen(arguments.mark_udp, &arguments.mark_from, arguments.mark_serial.as_deref())?;
    let watch =
        arguments.mark_line.as_ref().map(|line| modem_line::watch(line, &sender)).transpose()?;
    let markers = streams::markers(arguments, lsl, &sender)?;
    let sender = if screen::is_screen(arguments.quiet) {
        Some(sender)
    } else {
        keys::listen_to_lines(sender);
        None
    };
    let mut amiss = Vec::new();
    if !arguments.anyway {
        let Some(found) = checked(link, arguments.check_seconds)? else { return Ok(None) };
        amiss = found;
        // What was marked meanwhile belongs to no recording.
        while marks.next().is_some() {}
    }
    Ok(Some(Prepared { out, sender, marks, strangers, markers, watch, amiss }))
}

/// Checks a box for this time and says what is amiss; `None` if it should not be recorded.
fn checked(link: &mut BoxLink, duration: Duration) -> Result<Option<Vec<CheckSeen>>, BadInput> {
    let checks = examine(link, duration, &mut waiting::shown())?;
    doctor::print_amiss(&checks);
    let failed = checks.iter().filter(|check| check.verdict == Verdict::Fail).count();
    if failed > 0 {
        eprintln!(
            "not recorded: {} failed. Do what is said there, or give --anyway to record all the same",
            counted(failed, "check")
        );
        return Ok(None);
    }
    Ok(Some(amiss(&checks)))
}

/// Begins to record, now. Who hears of marks: the course, and the streams if there are any.
fn begin(
    arguments: &Arguments,
    Prepared { out, marks, amiss, .. }: Prepared<'_>,
    criteria: Criteria,
    now: Instant,
    (course, told): (&Rc<RefCell<Course>>, Option<MarkFeed>),
) -> Result<Recording, BadInput> {
    let manifest = Manifest {
        checks: amiss,
        criteria,
        ..Manifest::begin(
            jiff::Timestamp::now().to_string(),
            arguments.participant.clone(),
            arguments.condition.clone(),
            arguments.note.clone(),
            arguments.zero,
        )
    };
    let heard = Rc::clone(course);
    let heard = move |mark: &Mark, since_s| {
        heard.borrow_mut().mark(mark, since_s);
        // Whoever publishes hears the box's triggers too, and knows their times better.
        if let Some(told) = told.as_ref().filter(|_| mark.source != Source::Trigger) {
            told.mark(&mark.label, mark.source.word(), since_s);
        }
    };
    Recording::begin(out, &manifest, marks, now, Box::new(heard))
}

/// Ends a recording; what is in it, in words.
fn end(recorded: Recorded, frames: u64) -> Result<String, BadInput> {
    let recording = recorded.end(Instant::now())?;
    let folder = recording.folder().display().to_string();
    let dropped = recording.marks_dropped();
    let mut text = format!("no frame came: {folder} was not written");
    if let Some(trial) = recording.end(frames)? {
        let events = counted(trial.manifest.events.len(), "mark");
        let frames = counted(trial.frames.len(), "frame");
        let rate = trial
            .rate_hz()
            .map_or(String::new(), |rate_hz| format!(" (the camera at {rate_hz:.1} Hz)"));
        let length_s = trial.length_s();
        text = format!("recorded in {folder}: {frames} in {length_s:.1} s{rate}, {events}");
        if dropped > 0 {
            text +=
                &format!("\nwarning: {} came at once and were dropped", counted(dropped, "mark"));
        }
        for warning in &trial.warnings {
            text += &format!("\nwarning: {warning}");
        }
        text += &format!("\n{}", trial.manifest.verdict().lines());
    }
    Ok(text)
}
