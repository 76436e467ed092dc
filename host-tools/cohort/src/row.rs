//! The table of trials: one row for each.

use plumbline_analysis::series::Series;
use plumbline_files::BadInput;
use plumbline_files::lens_id::LensId;
use plumbline_study::choose::Known;
use plumbline_trial::Trial;
use plumbline_trial::frame::Trunk;
use plumbline_trial::parquet::{Table, Values};
use plumbline_trial::points::{Point, Points};
use plumbline_trial::verdict::{Grade, Reason, Verdict};

use crate::key::Key;

/// What the table says of a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Its key.
    pub key: Key,
    /// The SHA-256 of its content, hexadecimal.
    pub trial: String,
    /// When it began, microseconds since 1970 UTC.
    pub started_us: Option<i64>,
    /// From the first frame to the last.
    pub duration_s: f64,
    /// The camera's frames per second.
    pub rate_hz: Option<f64>,
    /// The frames that came.
    pub frames: i64,
    /// The frames that never came.
    pub lost: Option<i64>,
    /// The lower trunk, and the upper.
    pub seen: [Seen; 2],
    /// What t = 0 is, in words.
    pub zero: String,
    /// Whether a mark or the stand onset has set it.
    pub is_zero_set: bool,
    /// It on the trial's clock: seconds since the first frame.
    pub zero_s: f64,
    /// Its time of day, seconds since 1970 UTC.
    pub zero_utc_s: Option<f64>,
    /// The verdict. Its reasons are one, in words.
    pub verdict: Verdict,
    /// What a user should know.
    pub warnings: Vec<String>,
    /// The box's name, serial number and firmware, and the checksum of its configuration.
    pub the_box: [Option<String>; 4],
    /// The lens, by size, focal length and checksum.
    pub calibration: Option<String>,
    /// What is known of the participant.
    pub person: Person,
    /// The name of the folder that it was added from.
    pub folder: String,
    /// The program that added it.
    pub program: String,
    /// When, microseconds since 1970 UTC.
    pub added_us: i64,
}

/// How well a trunk point was seen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Seen {
    /// The number of its samples.
    pub samples: i64,
    /// The number of gaps between them.
    pub gaps: i64,
    /// How long these are together.
    pub gaps_s: f64,
}

impl Seen {
    fn of(series: &Series) -> Self {
        let gaps = series.gaps_s().map(|it| it.end - it.start);
        let (gaps, gaps_s) = gaps.fold((0, 0.0), |(gaps, sum_s), it| (gaps + 1, sum_s + it));
        Self { samples: series.samples() as i64, gaps, gaps_s }
    }
}

/// A participant, as the participants' file has it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Person {
    /// Years.
    pub age_years: Option<f64>,
    /// `F`, `M` or `O`.
    pub sex: Option<String>,
    /// Height.
    pub height_cm: Option<f64>,
    /// Mass.
    pub mass_kg: Option<f64>,
}

/// When, by which program, and from which folder a trial is added.
#[derive(Debug, Clone)]
pub struct Addition {
    /// Microseconds since 1970 UTC.
    pub added_us: i64,
    /// The program.
    pub program: String,
}

impl Row {
    /// The row of a trial that was read.
    #[must_use]
    pub fn of(
        key: Key,
        trial_sha256: String,
        person: Person,
        trial: &Trial,
        points: &Points,
        addition: &Addition,
    ) -> Self {
        let manifest = &trial.manifest;
        let started = manifest.started.parse::<jiff::Timestamp>().ok();
        let seen = Trunk::ALL.map(|trunk| {
            let point = points.points.iter().find(|it| it.name == trunk.word());
            point.map_or_else(Seen::default, |it| Seen::of(&it.series))
        });
        let the_box = manifest.the_box.as_ref();
        let config = trial.config.as_ref();
        let folder = trial.folder.canonicalize().unwrap_or_else(|_| trial.folder.clone());
        Self {
            key,
            trial: trial_sha256,
            started_us: started.map(|it| it.as_microsecond()),
            duration_s: trial.length_s(),
            rate_hz: trial.rate_hz(),
            frames: trial.frames.len() as i64,
            lost: manifest.packets.map(|it| it.lost.cast_signed()),
            seen,
            zero: points.zero.clone(),
            is_zero_set: points.is_zero_set,
            zero_s: points.zero_s,
            zero_utc_s: points.zero_utc_s,
            verdict: manifest.verdict(),
            warnings: points.warnings.clone(),
            the_box: [
                the_box.map(|it| it.device.clone()),
                the_box.map(|it| it.serial_number.clone()),
                the_box.map(|it| it.firmware.clone()),
                the_box.map(|it| it.config_crc.clone()),
            ],
            calibration: config.map(|it| LensId::of(&it.lens).to_string()),
            person,
            folder: folder.file_name().map_or_else(String::new, |it| it.to_string_lossy().into()),
            program: addition.program.clone(),
            added_us: addition.added_us,
        }
    }

    /// The trial's points, from their series; t = 0 and the verdict are the row's. Its events are in
    /// the trial's folder alone.
    #[must_use]
    pub fn points(&self, points: Vec<Point>) -> Points {
        Points {
            place: self.key.to_string(),
            points,
            zero: self.zero.clone(),
            zero_s: self.zero_s,
            is_zero_set: self.is_zero_set,
            zero_utc_s: self.zero_utc_s,
            verdict: Some(self.verdict.clone()),
            events: Vec::new(),
            warnings: self.warnings.clone(),
        }
    }

    /// What it can be chosen by.
    #[must_use]
    pub fn known(&self) -> Known<'_> {
        Known {
            participant: &self.key.participant,
            session: &self.key.session,
            run: self.key.run,
            age_years: self.person.age_years,
            sex: self.person.sex.as_deref(),
        }
    }
}

const BOX: [&str; 4] = ["box", "box_serial_number", "box_firmware", "box_config_crc"];

/// The columns of rows.
#[must_use]
pub fn columns(rows: &[Row]) -> Vec<(String, Values)> {
    let texts = |of: &dyn Fn(&Row) -> String| Values::Texts(rows.iter().map(of).collect());
    let some_texts =
        |of: &dyn Fn(&Row) -> Option<String>| Values::SomeTexts(rows.iter().map(of).collect());
    let numbers = |of: &dyn Fn(&Row) -> f64| Values::Numbers(rows.iter().map(of).collect());
    let some_numbers =
        |of: &dyn Fn(&Row) -> Option<f64>| Values::SomeNumbers(rows.iter().map(of).collect());
    let whole = |of: &dyn Fn(&Row) -> i64| Values::Integers(rows.iter().map(of).collect());
    let instants =
        |of: &dyn Fn(&Row) -> Option<i64>| Values::SomeInstants(rows.iter().map(of).collect());
    let mut columns: Vec<(String, Values)> = Vec::new();
    let mut put = |name: &str, values: Values| columns.push((name.to_owned(), values));
    put("participant", texts(&|it| it.key.participant.clone()));
    put("session", texts(&|it| it.key.session.clone()));
    put("condition", texts(&|it| it.key.condition.clone()));
    put("run", whole(&|it| i64::from(it.key.run)));
    put("trial", texts(&|it| it.trial.clone()));
    put("started", instants(&|it| it.started_us));
    put("duration_s", numbers(&|it| it.duration_s));
    put("rate_hz", some_numbers(&|it| it.rate_hz));
    put("frames", whole(&|it| it.frames));
    put("lost_frames", Values::SomeIntegers(rows.iter().map(|it| it.lost).collect()));
    for (at, trunk) in Trunk::ALL.into_iter().enumerate() {
        let name = |what: &str| format!("{}_{what}", trunk.word());
        put(&name("samples"), whole(&|it| it.seen[at].samples));
        put(&name("gaps"), whole(&|it| it.seen[at].gaps));
        put(&name("gaps_s"), numbers(&|it| it.seen[at].gaps_s));
    }
    put("zero", texts(&|it| it.zero.clone()));
    put("is_zero_set", Values::Flags(rows.iter().map(|it| it.is_zero_set).collect()));
    put("zero_s", numbers(&|it| it.zero_s));
    put("zero_utc_s", some_numbers(&|it| it.zero_utc_s));
    put("verdict", texts(&|it| it.verdict.grade().word().to_owned()));
    put("verdict_by_criteria", texts(&|it| it.verdict.is.word().to_owned()));
    put("verdict_reasons", some_texts(&|it| reasons(&it.verdict)));
    put("overruled_by", some_texts(&|it| it.verdict.overruled.and(it.verdict.by.clone())));
    put("overruled_why", some_texts(&|it| it.verdict.overruled.and(it.verdict.why.clone())));
    put("warnings", some_texts(&|it| Some(it.warnings.join("\n")).filter(|text| !text.is_empty())));
    for (at, name) in BOX.into_iter().enumerate() {
        put(name, some_texts(&|it| it.the_box[at].clone()));
    }
    put("calibration", some_texts(&|it| it.calibration.clone()));
    put("age_years", some_numbers(&|it| it.person.age_years));
    put("sex", some_texts(&|it| it.person.sex.clone()));
    put("height_cm", some_numbers(&|it| it.person.height_cm));
    put("mass_kg", some_numbers(&|it| it.person.mass_kg));
    put("folder", texts(&|it| it.folder.clone()));
    put("program", texts(&|it| it.program.clone()));
    put("added", instants(&|it| Some(it.added_us)));
    columns
}

/// Its reasons in words.
fn reasons(verdict: &Verdict) -> Option<String> {
    let words: Vec<&str> = verdict.reasons.iter().map(|it| &*it.words).collect();
    Some(words.join("; ")).filter(|it| !it.is_empty())
}

/// The rows of a table.
///
/// # Errors
/// When a column is absent, or a value cannot be meant; `place` is the file.
pub fn rows(table: &Table, place: &str) -> Result<Vec<Row>, BadInput> {
    let (participants, sessions) = (table.texts("participant")?, table.texts("session")?);
    let (conditions, runs) = (table.texts("condition")?, table.integers("run")?);
    let (trials, started) = (table.texts("trial")?, table.some_integers("started")?);
    let (duration_s, rate_hz) = (table.numbers("duration_s")?, table.some_numbers("rate_hz")?);
    let (frames, lost) = (table.integers("frames")?, table.some_integers("lost_frames")?);
    let mut seen = Vec::new();
    for trunk in Trunk::ALL {
        let name = |what: &str| format!("{}_{what}", trunk.word());
        seen.push((
            table.integers(&name("samples"))?,
            table.integers(&name("gaps"))?,
            table.numbers(&name("gaps_s"))?,
        ));
    }
    let (zero, is_zero_set) = (table.texts("zero")?, table.flags("is_zero_set")?);
    let (zero_s, zero_utc_s) = (table.numbers("zero_s")?, table.some_numbers("zero_utc_s")?);
    let (grades, criteria) = (table.texts("verdict")?, table.texts("verdict_by_criteria")?);
    let reasons = table.some_texts("verdict_reasons")?;
    let (by, why) = (table.some_texts("overruled_by")?, table.some_texts("overruled_why")?);
    let warnings = table.some_texts("warnings")?;
    let [the_box, serial, firmware, crc] = BOX.map(|name| table.some_texts(name));
    let the_box = [the_box?, serial?, firmware?, crc?];
    let calibration = table.some_texts("calibration")?;
    let (age_years, sex) = (table.some_numbers("age_years")?, table.some_texts("sex")?);
    let (height_cm, mass_kg) = (table.some_numbers("height_cm")?, table.some_numbers("mass_kg")?);
    let (folders, programs) = (table.texts("folder")?, table.texts("program")?);
    let added = table.some_integers("added")?;
    let mut rows = Vec::with_capacity(trials.len());
    for at in 0..trials.len() {
        let key = Key {
            participant: participants[at].clone(),
            session: sessions[at].clone(),
            condition: conditions[at].clone(),
            run: u32::try_from(runs[at]).unwrap_or(0),
        };
        key.check(&format!("{place}, row {}", at + 1))?;
        let verdict = Verdict {
            is: grade(&criteria[at], place)?,
            overruled: by[at].as_ref().map(|_| grade(&grades[at], place)).transpose()?,
            by: by[at].clone(),
            why: why[at].clone(),
            reasons: reasons[at]
                .iter()
                .map(|words| reason(words, &criteria[at], place))
                .collect::<Result<_, _>>()?,
        };
        rows.push(Row {
            key,
            trial: trials[at].clone(),
            started_us: started[at],
            duration_s: duration_s[at],
            rate_hz: rate_hz[at],
            frames: frames[at],
            lost: lost[at],
            seen: [0, 1].map(|trunk| {
                let (samples, gaps, gaps_s) = seen[trunk];
                Seen { samples: samples[at], gaps: gaps[at], gaps_s: gaps_s[at] }
            }),
            zero: zero[at].clone(),
            is_zero_set: is_zero_set[at],
            zero_s: zero_s[at],
            zero_utc_s: zero_utc_s[at],
            verdict,
            warnings: warnings[at].iter().flat_map(|it| it.lines()).map(str::to_owned).collect(),
            the_box: the_box.map(|column| column[at].clone()),
            calibration: calibration[at].clone(),
            person: Person {
                age_years: age_years[at],
                sex: sex[at].clone(),
                height_cm: height_cm[at],
                mass_kg: mass_kg[at],
            },
            folder: folders[at].clone(),
            program: programs[at].clone(),
            added_us: added[at].unwrap_or_default(),
        });
    }
    Ok(rows)
}

fn grade(word: &str, place: &str) -> Result<Grade, BadInput> {
    let all = [Grade::Good, Grade::Doubtful, Grade::Unusable];
    all.into_iter().find(|it| it.word() == word).ok_or_else(|| {
        BadInput::new(
            place,
            "verdict",
            format!("{word:?}"),
            "it was changed: make the cohort again",
        )
    })
}

/// All reasons of a verdict as one.
fn reason(words: &str, is: &str, place: &str) -> Result<Reason, BadInput> {
    Ok(Reason {
        key: String::new(),
        is: grade(is, place)?,
        found: None,
        bound: None,
        words: words.to_owned(),
        remedy: String::new(),
    })
}
