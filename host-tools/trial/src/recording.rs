//! Records a trial: the packets as they come, what relates the box's clock to this computer's, how the
//! targets look every few seconds, the box's configuration, and the marks. The table is
//! [`Receiver`](plumbline_stream::receiver::Receiver)'s.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use plumbline::config::{BLOB_BYTES_MAX, Config};
use plumbline::packet::{Action, Document, Message, Reply, ReplyOutcome};
use plumbline_files::{BadInput, Made};
use plumbline_stream::link::Download;
use plumbline_stream::questions::Questions;
use plumbline_stream::reception::Tap;
use plumbline_stream::transport::Event;

use super::correction::{Corrected, Correction, Replacements};
use super::journal::{Content, Entry, Writer};
use super::manifest::{CheckSeen, Manifest, State};
use super::mark::{Mark, Marks};
use super::reading::builder::Builder;
use super::reading::{FRAMES_MAX, check_folder, read_config, too_long};
use super::verdict::{Criteria, Verdict};
use super::{Trial, names, tables};

/// The box's clock is asked for this often.
const PING_EVERY: Duration = Duration::from_secs(1);

/// The box is asked this often how the targets look: their light and their focus are in the trial.
const VIEW_EVERY: Duration = Duration::from_secs(10);

/// The configuration, or a view, is asked for again after this time without an answer: what is asked
/// before the box was first heard never reaches it.
const ASK_AGAIN: Duration = Duration::from_secs(2);

/// The box is told this often that a trial is being recorded.
const TELL_EVERY: Duration = Duration::from_secs(5);

/// What is counted and not kept is noted at most this often.
const NOTE_EVERY: Duration = Duration::from_secs(1);

/// How far the box's configuration has come.
enum Fetch {
    /// It is asked for again at this time.
    Ask(Instant),
    Coming(Download),
    /// It is there, or the box does not send it.
    Done,
}

/// Is called for each mark that is written, and for each trigger of the box as it comes, with the
/// seconds since the recording began.
pub type Heard = Box<dyn FnMut(&Mark, f64)>;

/// A trial that is being recorded.
pub struct Recording {
    folder: PathBuf,
    /// The folder and those above it that were made for it.
    made: Made,
    journal: Writer,
    /// The trial as far as it has come.
    builder: Builder,
    begun: Instant,
    marks: Marks,
    heard: Heard,
    questions: Questions,
    ping_at: Instant,
    view_at: Instant,
    fetch: Fetch,
    /// Whether the box has said anything.
    is_heard: bool,
    /// When the box is told again that a trial is being recorded.
    tell_at: Instant,
    /// Packets that came damaged or were not the box's; how many of them the journal knows of, and
    /// when it may be told of more.
    not_authentic: u64,
    noted: u64,
    note_at: Instant,
}

impl Recording {
    /// Makes the folder and begins to record at `now`. `heard` is called for each mark.
    ///
    /// # Errors
    /// When the folder exists, or cannot be written to.
    pub fn begin(
        folder: &Path,
        manifest: &Manifest,
        marks: Marks,
        now: Instant,
        heard: Heard,
    ) -> Result<Self, BadInput> {
        if folder.exists() {
            return Err(exists_already(folder));
        }
        let made = Made::directories(folder)?;
        let mut journal = Writer::create(&folder.join(names::JOURNAL))?;
        for content in manifest.said() {
            journal.write(&Entry { host_ns: 0, content })?;
        }
        manifest.write(folder)?;
        plumbline_files::sync_directory(plumbline_files::directory_of(folder));
        let as_if_over = Manifest { state: State::Finished, ..manifest.clone() };
        Ok(Self {
            folder: folder.to_owned(),
            made,
            journal,
            builder: Builder::new(folder, as_if_over, None, None),
            begun: now,
            marks,
            heard,
            questions: Questions::of_tap(),
            ping_at: now,
            view_at: now,
            fetch: Fetch::Ask(now),
            is_heard: false,
            tell_at: now,
            not_authentic: 0,
            noted: 0,
            note_at: now,
        })
    }

    /// Writes down what was found amiss of the box meanwhile.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn note(&mut self, checks: Vec<CheckSeen>) -> Result<(), BadInput> {
        for check in checks.iter().filter_map(CheckSeen::said) {
            self.write(Instant::now(), check)?;
        }
        let mut manifest = Manifest::read(&self.folder)?;
        manifest.checks.extend(checks);
        manifest.write(&self.folder)
    }

    /// A question to the box; its number is none of those that wait for an answer here.
    pub fn ask(&mut self, action: Action) -> Message {
        self.questions.ask(action).1
    }

    /// The box's configuration, once it has come.
    #[must_use]
    pub fn config(&self) -> Option<&Config> {
        self.builder.trial().config.as_ref()
    }

    /// The verdict on the trial, if it ended now: the one that [`end`](Self::end) then writes. It
    /// looks at all frames until now.
    pub fn verdict(&mut self) -> Verdict {
        self.builder.judged()
    }

    /// The trial's folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The file for the table of samples.
    #[must_use]
    pub fn csv(&self) -> PathBuf {
        self.folder.join(names::CSV)
    }

    /// The number of marks for which there was no room.
    #[must_use]
    pub fn marks_dropped(&self) -> u64 {
        self.marks.dropped()
    }

    /// Ends the recording: everything is on the disk, and the manifest says what came. A trial
    /// without a frame leaves no folder.
    ///
    /// # Errors
    /// When the operating system refuses; what was recorded stays.
    pub fn end(mut self, frames: u64) -> Result<Option<Trial>, BadInput> {
        if frames == 0 {
            self.discard()?;
            return Ok(None);
        }
        let manifest = Manifest { state: State::Finished, ..Manifest::read(&self.folder)? };
        if let Some(about) = manifest.about() {
            self.write(Instant::now(), Content::About(about))?;
        }
        self.journal.sync()?;
        self.made.keep();
        // All frames are read once more: there need not be room for them twice.
        drop(self.builder);
        make(&self.folder, manifest).map(Some)
    }

    fn discard(self) -> Result<(), BadInput> {
        let Self { folder, made, journal, .. } = self;
        drop(journal);
        // Only the files that were made here: somebody may have put others beside them.
        for name in [names::JOURNAL, names::MANIFEST, names::CONFIG] {
            let path = folder.join(name);
            if path.exists() {
                std::fs::remove_file(&path)
                    .map_err(|error| BadInput::io(path.display(), &error))?;
            }
        }
        drop(made);
        Ok(())
    }

    fn write(&mut self, at: Instant, content: Content) -> Result<(), BadInput> {
        let entry = Entry { host_ns: self.host_ns(at), content };
        self.journal.write(&entry)?;
        self.builder.take(entry);
        // A trial of more frames could not be read.
        if self.builder.trial().frames.len() >= FRAMES_MAX {
            return Err(too_long(&self.folder));
        }
        Ok(())
    }

    fn host_ns(&self, at: Instant) -> u64 {
        at.saturating_duration_since(self.begun).as_nanos() as u64
    }

    fn message(&mut self, message: &Message, now: Instant) -> Result<(), BadInput> {
        if matches!(message, Message::View(_)) {
            self.view_at = now + VIEW_EVERY;
        }
        match (&mut self.fetch, message) {
            (
                Fetch::Ask(_),
                Message::Reply(Reply { outcome: ReplyOutcome::Config { bytes, .. }, .. }),
            ) if *bytes as usize <= BLOB_BYTES_MAX => {
                self.fetch = Fetch::Coming(Download::new(Document::Config, *bytes as usize));
            }
            (Fetch::Coming(download), message) => {
                // A box that refuses is not asked again.
                if download.take(message, now).is_err() {
                    self.fetch = Fetch::Done;
                } else if let Some(blob) = download.file() {
                    plumbline_files::replace(&self.folder.join(names::CONFIG), blob)?;
                    if let Ok(config) = Config::decode(blob) {
                        self.builder.take_config(config);
                    }
                    self.fetch = Fetch::Done;
                }
            }
            _ => {}
        }
        Ok(())
    }
}

/// A folder that exists is not recorded into.
#[must_use]
pub fn exists_already(folder: &Path) -> BadInput {
    BadInput::whole(
        folder.display(),
        "exists already",
        "give another --out: nothing that was recorded is overwritten",
    )
}

/// What is to change where a trial's tables are made again.
#[derive(Debug, Clone, Default)]
pub struct Changes {
    /// Other criteria for the verdict.
    pub criteria: Option<Criteria>,
    /// Files that replace what the box was told.
    pub replaced: Option<Replacements>,
    /// Earlier replacements are taken back.
    pub as_recorded: bool,
}

/// Makes everything that is derived from a trial's packets once more: the tables, and what the
/// manifest says of them. A recording that was cut off is still marked as such. Files that replace
/// what the box was told replace earlier ones too: they always start from what was recorded.
///
/// # Errors
/// When there is no trial, a file cannot replace what was recorded, or the operating system
/// refuses; the packets stay.
pub fn remake(folder: &Path, changes: &Changes) -> Result<Trial, BadInput> {
    check_folder(folder)?;
    // Before anything is changed: the files may not suit.
    let mut warnings = Vec::new();
    let replaced = changes.replaced.as_ref();
    let replaced = replaced.map(|it| correction_by(folder, it, &mut warnings)).transpose()?;
    let (mut manifest, restored) = Manifest::restore(folder)?;
    warnings.extend(restored);
    if let Some(criteria) = &changes.criteria {
        manifest.criteria = criteria.clone();
    }
    if let Some((correction, corrected)) = replaced {
        plumbline_files::replace(&folder.join(names::CORRECTED), &correction.blob())?;
        manifest.corrected = Some(corrected);
    } else if changes.as_recorded {
        take_back(folder)?;
        manifest.corrected = None;
    }
    let mut trial = make(folder, manifest)?;
    trial.warnings.splice(0..0, warnings);
    Ok(trial)
}

fn correction_by(
    folder: &Path,
    replacements: &Replacements,
    warnings: &mut Vec<String>,
) -> Result<(Correction, Corrected), BadInput> {
    let Some(recorded) = read_config(folder, &mut Vec::new())? else {
        return Err(BadInput::whole(
            folder.join(names::CONFIG).display(),
            "what the box was told is not in the trial, so that nothing of it can be replaced",
            "copy the box's config.plb, as `plumb provision` wrote it, to this place first",
        ));
    };
    Correction::of(replacements, &recorded, warnings)
}

fn take_back(folder: &Path) -> Result<(), BadInput> {
    let path = folder.join(names::CORRECTED);
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(BadInput::io(path.display(), &error))
        }
        _ => Ok(()),
    }
}

fn make(folder: &Path, manifest: Manifest) -> Result<Trial, BadInput> {
    // First of all what a person has said, whatever comes of the rest.
    manifest.write(folder)?;
    let (trial, correction) = Trial::open_as(folder, manifest)?;
    tables::write(folder, correction.as_ref(), &trial.manifest.verdict())?;
    trial.manifest.write(folder)?;
    Ok(trial)
}

impl Tap for Recording {
    fn event(&mut self, event: &Event, now: Instant) -> Result<(), BadInput> {
        match event {
            Event::Raw(raw) => self.write(now, Content::Raw(raw.clone())),
            Event::Packet(packet) => {
                self.is_heard = true;
                if let Message::Trigger(trigger) = &packet.message {
                    let since_s = now.saturating_duration_since(self.begun).as_secs_f64();
                    (self.heard)(&Mark::of_trigger(trigger), since_s);
                }
                self.message(&packet.message, now)
            }
            Event::NotAuthentic | Event::Bad(_) => {
                self.not_authentic += 1;
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn turn(&mut self, now: Instant) -> Result<Option<Message>, BadInput> {
        self.builder.pass(self.host_ns(now));
        while let Some((at, mark)) = self.marks.next() {
            let since_s = at.saturating_duration_since(self.begun).as_secs_f64();
            (self.heard)(&mark, since_s);
            self.write(at, Content::Mark(mark))?;
        }
        if self.noted != self.not_authentic && now >= self.note_at {
            self.note_at = now + NOTE_EVERY;
            self.noted = self.not_authentic;
            self.write(now, Content::NotAuthentic(self.not_authentic))?;
        }
        // Without a session there is nobody to ask.
        if !self.is_heard {
            return Ok(None);
        }
        if now >= self.tell_at {
            self.tell_at = now + TELL_EVERY;
            return Ok(Some(self.questions.ask(Action::Record { on: true }).1));
        }
        match &mut self.fetch {
            Fetch::Ask(at) if now >= *at => {
                *at = now + ASK_AGAIN;
                return Ok(Some(self.questions.ask(Action::QueryConfig).1));
            }
            Fetch::Coming(download) => match download.due(now) {
                Ok(Some(action)) => {
                    let (id, question) = self.questions.ask(action);
                    download.asked(id, now);
                    return Ok(Some(question));
                }
                Ok(None) => {}
                // The network may be down for any time.
                Err(_) => self.fetch = Fetch::Ask(now + ASK_AGAIN),
            },
            Fetch::Ask(_) | Fetch::Done => {}
        }
        if now >= self.view_at {
            self.view_at = now + ASK_AGAIN;
            return Ok(Some(self.questions.ask(Action::SendView).1));
        }
        if now < self.ping_at {
            return Ok(None);
        }
        self.ping_at = now + PING_EVERY;
        let host_sent_ns = self.host_ns(now);
        Ok(Some(self.questions.ask(Action::Ping { host_sent_ns }).1))
    }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::{Command, Deframer, Health, Hello, PART_BYTES_MAX, Part, PosePacket};
    use plumbline::report::NoPose;
    use plumbline_stream::fixture::{config, event, health, hello, pose_packet, view};

    use super::*;
    use crate::manifest::Zero;
    use crate::mark;
    use crate::test_trial::{Made, raw};
    use crate::verdict::Grade;

    /// The box tells its configuration.
    fn tell(recording: &mut Recording, config: &Config, now: Instant) {
        let mut blob = vec![0; BLOB_BYTES_MAX];
        let blob = config.encode(&mut blob).unwrap();
        let (bytes, crc) = (blob.len() as u32, config.crc());
        let outcome = ReplyOutcome::Config { bytes, crc, next_crc: crc };
        let mut messages = vec![Message::Reply(Reply { id: 1, outcome })];
        messages.extend(blob.chunks(PART_BYTES_MAX).enumerate().map(|(at, piece)| {
            let offset = (at * PART_BYTES_MAX) as u32;
            let bytes = piece.iter().copied().collect();
            Message::Part(Part { document: Document::Config, offset, bytes })
        }));
        for message in messages {
            recording.event(&event(message), now).unwrap();
        }
        assert_eq!(recording.config().map(Config::crc), Some(config.crc()));
    }

    /// Records this trial as if it came from a box: what the verdict was five seconds after its
    /// last packet, and the one of the trial on the disk.
    fn recorded(made: &Made) -> (Verdict, Verdict) {
        let folder = tempfile::tempdir().unwrap();
        let start = Instant::now();
        let (sender, marks) = mark::channel();
        let manifest = Manifest { state: State::Recording, ..made.manifest.clone() };
        let path = folder.path().join("p01");
        let heard = Box::new(|_: &Mark, _| {});
        let mut recording = Recording::begin(&path, &manifest, marks, start, heard).unwrap();
        let mut deframer = Deframer::new();
        for (at, Entry { host_ns, content }) in made.entries.iter().enumerate() {
            let now = start + Duration::from_nanos(*host_ns);
            match content {
                Content::Mark(mark) => assert!(sender.send(now, mark.clone())),
                Content::About(_) | Content::Check(_) | Content::NotAuthentic(_) => {}
                Content::Raw(raw) => {
                    recording.event(&Event::Raw(raw.clone()), now).unwrap();
                    recording.event(&Event::of(raw.decode(&mut deframer)), now).unwrap();
                }
            }
            recording.turn(now).unwrap();
            // As late as a slow line has it.
            if let Some(config) = made.config.as_ref().filter(|_| at == 100) {
                tell(&mut recording, config, now);
            }
        }
        // A box is believed to have restarted once the start before is silent.
        let last_ns = made.entries.last().unwrap().host_ns;
        recording.turn(start + Duration::from_nanos(last_ns) + Duration::from_secs(5)).unwrap();
        let live = recording.verdict();
        (live, recording.end(1).unwrap().unwrap().manifest.verdict())
    }

    #[test]
    fn the_verdict_while_it_is_recorded_is_the_one_in_the_folder() {
        let spoiled = |change: &dyn Fn(&mut Made)| {
            let mut made = Made::good();
            change(&mut made);
            made
        };
        let thinned = |keep: fn(u32) -> bool| {
            spoiled(&|made| {
                made.each_pose(|packet| keep(packet.sequence).then_some(packet));
            })
        };
        let half_the_rate = spoiled(&|made| {
            made.each_pose(|packet| {
                let PosePacket { sequence, .. } = packet;
                let slower = PosePacket { sequence: sequence / 2, ..packet };
                (sequence % 2 == 0).then_some(slower)
            });
        });
        let covered = spoiled(&|made| {
            made.each_pose(|mut packet| {
                if packet.sequence > 1000 {
                    packet.lower_trunk = None;
                    packet.targets.iter_mut().for_each(|it| it.pose = Err(NoPose::Searching));
                }
                Some(packet)
            });
        });
        let exchanged = spoiled(&|made| {
            made.each_pose(|mut packet| {
                std::mem::swap(&mut packet.upper_trunk, &mut packet.lower_trunk);
                Some(packet)
            });
        });
        let with = |message: Message| {
            let mut made = Made::good();
            made.push(&message);
            made
        };
        let without_scene = Config { cam_from_scene_theta: None, ..config() };
        let serial_number = "PL-0002".try_into().unwrap();
        let cases = [
            ("good", Made::good(), vec![]),
            ("loss", thinned(|it| it % 4 != 3), vec!["lost_percent"]),
            ("late frames", late(), vec![]),
            ("half the rate", half_the_rate, vec!["rate_percent", "rate_hz"]),
            ("covered", covered, vec!["gap_s", "poses_percent", "gaps_percent"]),
            ("exchanged", exchanged, vec!["upper_above_lower_mm"]),
            ("no scene", Made::of(&without_scene, 1800), vec!["no_scene"]),
            ("short", Made::of(&config(), 600), vec!["duration_s"]),
            ("unmarked", unmarked(), vec!["no_mark"]),
            (
                "restarted",
                with(Message::Hello(Hello { boot_id: 8, ..hello(&config()) })),
                vec!["starts"],
            ),
            (
                "another box",
                with(Message::Hello(Hello { serial_number, boot_id: 9, ..hello(&config()) })),
                vec!["others"],
            ),
            (
                "another configuration",
                with(Message::Hello(Hello { config_crc: 1, ..hello(&config()) })),
                vec!["configuration_changed"],
            ),
            (
                "weak supply",
                with(Message::Health(Health { undervoltage: Some(true), ..health() })),
                vec!["undervoltage"],
            ),
        ];
        for (name, made, wanted) in cases {
            let (live, written) = recorded(&made);
            assert_eq!(live, written, "{name}");
            let keys: Vec<&str> = live.reasons.iter().map(|it| &*it.key).collect();
            for key in &wanted {
                assert!(keys.contains(key), "{name}: no {key} in {keys:?}");
            }
            assert_eq!(live.is == Grade::Good, wanted.is_empty(), "{name}: {keys:?}");
            // What the rest of the recording can mend is no reason to look up yet.
            let is_open = matches!(wanted[..], ["duration_s" | "no_mark"]);
            let so_far = |awaits_mark| live.clone().so_far(awaits_mark).is == Grade::Good;
            assert_eq!(so_far(true), wanted.is_empty() || is_open, "{name}");
            // A mark that cannot come any more is.
            assert_eq!(so_far(false), so_far(true) && name != "unmarked", "{name}");
        }
    }

    /// Each hundredth frame comes half a second late.
    fn late() -> Made {
        let mut made = Made::good();
        for entry in &mut made.entries {
            let Content::Raw(raw) = &entry.content else { continue };
            let message = raw.decode(&mut Deframer::new()).unwrap().message;
            if matches!(message, Message::Pose(pose) if pose.sequence % 100 == 50) {
                entry.host_ns += 500_000_000;
            }
        }
        made.entries.sort_by_key(|entry| entry.host_ns);
        made
    }

    fn unmarked() -> Made {
        let mut made = Made::good();
        made.entries.retain(|entry| !matches!(entry.content, Content::Mark(_)));
        made
    }

    fn begun(folder: &Path, now: Instant) -> Recording {
        let (_, marks) = mark::channel();
        let manifest = Manifest::begin(
            "2026-01-01T00:00:00Z".to_owned(),
            Some("P07".to_owned()),
            None,
            None,
            Zero::Start,
        );
        Recording::begin(folder, &manifest, marks, now, Box::new(|_, _| {})).unwrap()
    }

    /// The network fails for a minute, between the answer to the first question and the first part.
    #[test]
    fn the_configuration_is_asked_for_until_it_has_come() {
        let folder = tempfile::tempdir().unwrap();
        let start = Instant::now();
        let path = folder.path().join("p07");
        let mut recording = begun(&path, start);
        recording.event(&event(Message::Health(health())), start).unwrap();
        let outcome = ReplyOutcome::Config { bytes: 1000, crc: 1, next_crc: 1 };
        let answer = event(Message::Reply(Reply { id: 1, outcome }));
        recording.event(&answer, start).unwrap();
        let mut asked = [0; 2];
        for at_ds in 0..600_u32 {
            let now = start + Duration::from_millis(100) * at_ds;
            if let Some(Message::Command(Command { action, .. })) = recording.turn(now).unwrap() {
                asked[0] += usize::from(matches!(action, Action::SendParts { .. }));
                asked[1] += usize::from(action == Action::QueryConfig);
            }
        }
        // Six times for the parts, as a document is, and then every two seconds what it is.
        assert!(asked[0] == 6 && (20..30).contains(&asked[1]), "{asked:?}");
        tell(&mut recording, &config(), start + Duration::from_secs(61));
        assert!(path.join(names::CONFIG).exists());
    }

    #[test]
    fn light_and_focus_are_asked_for_until_they_come_and_then_every_ten_seconds() {
        let folder = tempfile::tempdir().unwrap();
        let start = Instant::now();
        let mut recording = begun(&folder.path().join("p07"), start);
        // There is nobody to ask.
        assert_eq!(recording.turn(start).unwrap(), None);
        recording.event(&event(Message::Health(health())), start).unwrap();
        let mut asked_ds = Vec::new();
        for at_ds in 0..350_u32 {
            let now = start + Duration::from_millis(100) * at_ds;
            let question = recording.turn(now).unwrap();
            let Some(Message::Command(Command { action: Action::SendView, .. })) = question else {
                continue;
            };
            asked_ds.push(at_ds);
            // The box does not answer before the fourth second.
            if at_ds > 40 {
                recording.event(&event(Message::View(view())), now).unwrap();
            }
        }
        let steps_ds: Vec<u32> = asked_ds.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let expected_ds = [20, 20, 100, 100, 100];
        assert!(asked_ds[0] <= 3 && steps_ds.len() == expected_ds.len(), "{asked_ds:?}");
        for (step_ds, expected_ds) in steps_ds.into_iter().zip(expected_ds) {
            // Other questions go first, one in each turn.
            assert!((expected_ds..expected_ds + 3).contains(&step_ds), "{asked_ds:?}");
        }
    }

    #[test]
    fn views_other_boxes_and_who_was_measured_are_in_the_packets() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p07");
        let start = Instant::now();
        let mut recording = begun(&path, start);
        let serial_number = "PL-0002".try_into().unwrap();
        let other = Hello { serial_number, boot_id: 9, ..hello(&config()) };
        for at in 0..3_u32 {
            let now = start + Duration::from_secs(1) * (at + 1);
            for message in [
                Message::Hello(hello(&config())),
                Message::Hello(other.clone()),
                Message::View(view()),
                Message::Pose(pose_packet(at)),
            ] {
                let Content::Raw(bytes) = raw(&message) else { unreachable!() };
                recording.event(&Event::Raw(bytes), now).unwrap();
                recording.event(&event(message), now).unwrap();
            }
        }
        let check = CheckSeen {
            subject: "rate".to_owned(),
            verdict: crate::manifest::CheckVerdict::Warn,
            seen: "10 Hz of 60".to_owned(),
        };
        recording.note(vec![check.clone()]).unwrap();
        // However it goes on: the file is lost before the recording is over.
        let lost = path.join(names::MANIFEST);
        let written = std::fs::read(&lost).unwrap();
        std::fs::remove_file(&lost).unwrap();
        let after = remake(&path, &Changes::default()).unwrap();
        assert_eq!(after.manifest.participant.as_deref(), Some("P07"));
        assert_eq!(after.manifest.checks, [check]);
        assert_eq!((after.manifest.zero, after.manifest.state), (Zero::Start, State::Recording));
        std::fs::write(&lost, written).unwrap();

        let trial = recording.end(3).unwrap().unwrap();
        assert_eq!(trial.observed.views.len(), 3);
        assert_eq!(trial.observed.others, ["ward 3 (PL-0002)"]);
        let keys: Vec<String> =
            trial.manifest.verdict().reasons.into_iter().map(|it| it.key).collect();
        assert!(keys.contains(&"others".to_owned()), "{keys:?}");
        // After the end the packets tell that it ended.
        std::fs::remove_file(&lost).unwrap();
        assert_eq!(remake(&path, &Changes::default()).unwrap().manifest.state, State::Finished);
    }

    /// A copy that a full disk has cut off between two entries has no damaged byte; its
    /// `trial.toml`, which was copied whole, does not know of it.
    #[test]
    fn a_file_that_lacks_its_end_is_cut_off_whatever_the_manifest_says() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p07");
        let start = Instant::now();
        let mut recording = begun(&path, start);
        for at in 0..60 {
            let message = Message::Pose(pose_packet(at));
            let Content::Raw(bytes) = raw(&message) else { unreachable!() };
            recording.event(&Event::Raw(bytes), start + Duration::from_millis(16) * at).unwrap();
        }
        let whole = recording.end(60).unwrap().unwrap();
        assert_eq!(whole.manifest.state, State::Finished);

        let journal = path.join(names::JOURNAL);
        let bytes = std::fs::read(&journal).unwrap();
        // Before the last entry, which says that the recording has ended.
        let end = bytes.windows(2).rposition(|pair| pair == [0, 0]).unwrap() + 1;
        std::fs::write(&journal, &bytes[..end]).unwrap();
        let cut = Trial::open(&path).unwrap();
        assert_eq!((cut.frames.len(), cut.observed.damaged_bytes), (whole.frames.len(), 0));
        assert_eq!(cut.manifest.state, State::Recording);
        let reasons = cut.manifest.verdict().reasons;
        assert!(reasons.iter().any(|it| it.key == "cut_off"), "{reasons:?}");
        assert!(cut.warnings.iter().any(|it| it.contains("cut off")), "{:?}", cut.warnings);

        // The whole file is there again, and the trial is what it was.
        remake(&path, &Changes::default()).unwrap();
        std::fs::write(&journal, &bytes).unwrap();
        let again = remake(&path, &Changes::default()).unwrap();
        assert_eq!(again.manifest.state, State::Finished);
    }
}
