//! A protocol: the conditions under which a participant is measured, and how.
//!
//! It is a TOML file, `protocol.toml` in a study's folder, that a page may edit: what was read and is
//! written again gives the same protocol, except for comments. `trial.toml`, and through it
//! `study.toml`, have the conditions by their names. All numbers are bounded, and no text has a
//! character that cannot be seen.
//!
//! ```toml
//! name = "Two stances"
//! about = "Where it comes from."            # may be absent
//! order = { by = "latin_square" }           # or fixed, or { by = "random", seed = 1 }: see `order`
//! repeats = 2                               # how often each condition is measured
//! rest_s = 60                               # between two trials
//! countdown_s = 3                           # before each
//! tones = { start = true, end = true }
//! zero = "start"                            # t = 0 of a trial: start, mark or onset, as in trial.toml
//! bins_s = [[0, 30]]                        # the times that the study compares
//!
//! [[condition]]
//! name = "eyes-open"                        # in trial.toml, study.toml and the folders' names
//! label = "Eyes open"                       # on the screen
//! instruction = "Stand still and look straight ahead."    # is read out
//! duration_s = 30                           # from t = 0
//! ```
//!
//! **What t = 0 is** decides how long a trial lasts. `start`: `duration_s` from the first frame on.
//! `mark`: `marks` lists what the operator may mark, `baseline_s` of a condition says how long the
//! recording goes on before the mark is due, and the trial ends `duration_s` after it. If there are
//! several marks, one must be called zero, because that one is then t = 0 of the trial, whichever
//! comes first. `onset`: t = 0 is found afterwards, when the person stands; `baseline_s` says how much
//! time there is for rising, and the trial ends `baseline_s + duration_s` after the first frame.

use std::cmp::Ordering;
use std::path::Path;

use plumbline_files::{BadInput, from_toml, read_text};
use plumbline_trial::manifest::Zero;
use plumbline_trial::mark::{Mark, Source};
use serde::{Deserialize, Serialize};

use crate::order::Order;
use crate::words::{
    NAME_LETTERS_MAX, TEXT_LETTERS_MAX, check_number, check_short, check_text, of_field,
};

/// The most conditions of a protocol.
pub const CONDITIONS_MAX: usize = 16;

/// The most planned trials of a session: all conditions with all their repeats.
pub const TRIALS_MAX: usize = 64;

/// The longest time after t = 0, and the longest baseline, seconds.
pub const SECONDS_MAX: f64 = 3600.0;

/// The shortest time after t = 0, seconds.
pub const DURATION_S_MIN: f64 = 1.0;

/// The longest countdown, seconds.
pub const COUNTDOWN_S_MAX: f64 = 60.0;

/// The most times that a study compares.
pub const BINS_MAX: usize = 20;

/// The most marks among which an operator chooses.
pub const MARKS_MAX: usize = 9;

/// The label by which a mark is t = 0, whichever comes first.
const ZERO_LABEL: &str = "zero";

/// The most characters of a mark's label; a recording cuts longer ones.
const MARK_LETTERS_MAX: usize = 64;

const REMEDY: &str = "correct it, or begin with one of the supplied protocols";

/// How participants are measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Protocol {
    /// Its name.
    pub name: String,
    /// Where it comes from, and what else an operator should know.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub about: Option<String>,
    /// How the conditions are ordered.
    pub order: Order,
    /// How often each condition is measured.
    #[serde(default = "once")]
    pub repeats: u32,
    /// The pause between two trials, seconds.
    #[serde(default)]
    pub rest_s: f64,
    /// The time from when the participant is ready until the recording begins, seconds.
    #[serde(default)]
    pub countdown_s: f64,
    /// The tones that a participant hears.
    #[serde(default)]
    pub tones: Tones,
    /// What t = 0 of a trial is.
    pub zero: Zero,
    /// The labels of the marks among which an operator chooses.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub marks: Vec<String>,
    /// The times that the study compares, seconds from t = 0.
    pub bins_s: Vec<[f64; 2]>,
    /// The conditions.
    #[serde(rename = "condition")]
    pub conditions: Vec<Condition>,
}

/// The tones that a participant hears.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tones {
    /// When the recording begins.
    pub start: bool,
    /// When it has lasted as long as the protocol says.
    pub end: bool,
}

/// A condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Condition {
    /// Its name in files: small letters, digits and hyphens.
    pub name: String,
    /// Its name on the screen.
    pub label: String,
    /// What is read out to the participant before each trial.
    pub instruction: String,
    /// How long the recording goes on before the mark is due or, where t = 0 is the onset of
    /// standing, before the person is expected to stand, seconds.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub baseline_s: f64,
    /// The time that is measured from t = 0 on, seconds.
    pub duration_s: f64,
}

fn once() -> u32 {
    1
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands a reference")]
fn is_zero(seconds: &f64) -> bool {
    *seconds == 0.0
}

/// A protocol that comes with this program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Supplied {
    /// The word by which it is chosen.
    pub word: &'static str,
    /// Its file's text.
    pub text: &'static str,
}

/// The supplied protocols.
pub const SUPPLIED: [Supplied; 3] = [
    Supplied { word: "mctsib", text: include_str!("mctsib.toml") },
    Supplied { word: "stand", text: include_str!("stand.toml") },
    Supplied { word: "eyes-open-closed", text: include_str!("eyes_open_closed.toml") },
];

impl Supplied {
    /// The protocol.
    ///
    /// # Panics
    /// Never: a test reads each.
    #[must_use]
    pub fn protocol(&self) -> Protocol {
        Protocol::parse(self.text, self.word).expect("a supplied protocol can be read")
    }
}

impl Protocol {
    /// Reads a protocol's file.
    ///
    /// # Errors
    /// When it cannot be read, or [`check`](Self::check) finds a fault.
    pub fn read(path: &Path) -> Result<Self, BadInput> {
        Self::parse(&read_text(path)?, &path.display().to_string())
    }

    /// The protocol of a text; `place` names it in errors.
    ///
    /// # Errors
    /// When it is not TOML of this form, or [`check`](Self::check) finds a fault.
    pub fn parse(text: &str, place: &str) -> Result<Self, BadInput> {
        let protocol: Self = from_toml(text, place, REMEDY)?;
        protocol.check(place)?;
        Ok(protocol)
    }

    /// Its text, from which [`parse`](Self::parse) makes it again.
    ///
    /// # Panics
    /// Never: every protocol is a TOML table.
    #[must_use]
    pub fn text(&self) -> String {
        toml::to_string(self).expect("a protocol is a TOML table")
    }

    /// Writes its file atomically, in place of one that exists.
    ///
    /// # Errors
    /// When [`check`](Self::check) finds a fault, or the operating system refuses.
    pub fn write(&self, path: &Path) -> Result<(), BadInput> {
        self.check(&path.display().to_string())?;
        plumbline_files::replace(path, self.text().as_bytes())
    }

    /// Checks that it can be carried out, and that a study can read what it leaves; `place` names it
    /// in errors.
    ///
    /// # Errors
    /// The first fault: the field, what was found, and the remedy.
    pub fn check(&self, place: &str) -> Result<(), BadInput> {
        let field = |field: &str, checked| of_field(place, field, checked);
        let wrong = |field: &str, found: String, remedy: &str| {
            Err(BadInput::new(place, field, found, remedy))
        };
        field("name", check_text(&self.name, NAME_LETTERS_MAX))?;
        if let Some(about) = &self.about {
            field("about", check_text(about, TEXT_LETTERS_MAX))?;
        }
        field("rest_s", check_number(self.rest_s, 0.0, SECONDS_MAX, "s"))?;
        field("countdown_s", check_number(self.countdown_s, 0.0, COUNTDOWN_S_MAX, "s"))?;
        if !(1..=CONDITIONS_MAX).contains(&self.conditions.len()) {
            let remedy =
                format!("give from 1 to {CONDITIONS_MAX}, each in a [[condition]] of its own");
            return wrong("condition", format!("there are {}", self.conditions.len()), &remedy);
        }
        let trials = u64::from(self.repeats) * self.conditions.len() as u64;
        if !(1..=TRIALS_MAX as u64).contains(&trials) {
            return wrong(
                "repeats",
                format!(
                    "{} of {} conditions, {trials} trials",
                    self.repeats,
                    self.conditions.len()
                ),
                &format!("a session has from 1 to {TRIALS_MAX} trials"),
            );
        }
        for (at, condition) in self.conditions.iter().enumerate() {
            condition.check(place, at, self.zero)?;
            let letters = |name: &str| name.replace('-', "");
            let same = |it: &&Condition| letters(&it.name) == letters(&condition.name);
            if let Some(same) = self.conditions[..at].iter().find(same) {
                return wrong(
                    &format!("[[condition]] {}, name", at + 1),
                    format!("{:?}, and there is {:?} already", condition.name, same.name),
                    "give each condition letters and digits of its own: other programs leave out the \
                     hyphens",
                );
            }
        }
        self.check_marks(place)?;
        self.check_bins(place)
    }

    fn check_marks(&self, place: &str) -> Result<(), BadInput> {
        let wrong = |found: String, remedy: &str| Err(BadInput::new(place, "marks", found, remedy));
        if self.marks.len() > MARKS_MAX {
            let remedy = format!("give at most {MARKS_MAX}: each has a key");
            return wrong(format!("there are {}", self.marks.len()), &remedy);
        }
        for (at, label) in self.marks.iter().enumerate() {
            of_field(place, "marks", check_text(label, MARK_LETTERS_MAX))?;
            if self.marks[..at].iter().any(|it| it.eq_ignore_ascii_case(label)) {
                return wrong(format!("{label:?} is there twice"), "give each once");
            }
        }
        match (self.zero, &*self.marks) {
            (Zero::Mark, []) => wrong(
                "there is none, and t = 0 is a mark".to_owned(),
                "write marks = [\"zero\"], or zero = \"start\" without a mark",
            ),
            (Zero::Mark, [_, _, ..]) if self.zero_mark().is_none() => wrong(
                "several, and none is called zero".to_owned(),
                "call the one that is t = 0 zero: otherwise it would be the first that is made",
            ),
            _ => Ok(()),
        }
    }

    fn check_bins(&self, place: &str) -> Result<(), BadInput> {
        let wrong =
            |found: String, remedy: &str| Err(BadInput::new(place, "bins_s", found, remedy));
        if !(1..=BINS_MAX).contains(&self.bins_s.len()) {
            let remedy = format!("give from 1 to {BINS_MAX} pairs of seconds, [[0, 20], [20, 40]]");
            return wrong(format!("there are {}", self.bins_s.len()), &remedy);
        }
        let duration_s = |it: &Condition| it.duration_s;
        let longest_s = self.conditions.iter().map(duration_s).fold(f64::INFINITY, f64::min);
        let baseline_s = |it: &Condition| it.baseline_s;
        let before_s = self.conditions.iter().map(baseline_s).fold(f64::INFINITY, f64::min);
        for (at, bin) in self.bins_s.iter().enumerate() {
            let [from, to] = *bin;
            if from.partial_cmp(&to) != Some(Ordering::Less) {
                return wrong(format!("[{from}, {to}] is not in order"), "give the earlier first");
            }
            if !(from >= -before_s && to <= longest_s) {
                let remedy = format!(
                    "every condition is measured from {} s to {longest_s} s: change the times, or \
                     the conditions' baseline_s and duration_s",
                    0.0 - before_s,
                );
                return wrong(format!("[{from}, {to}] is not measured"), &remedy);
            }
            if self.bins_s[..at].contains(bin) {
                return wrong(format!("[{from}, {to}] is there twice"), "give each once");
            }
        }
        Ok(())
    }

    /// The label of the mark that is t = 0, if a mark is: the one called zero, or else the only one.
    #[must_use]
    pub fn zero_mark(&self) -> Option<&str> {
        if self.zero != Zero::Mark {
            return None;
        }
        let named = self.marks.iter().find(|it| it.eq_ignore_ascii_case(ZERO_LABEL));
        let only = if let [only] = &*self.marks { Some(only) } else { None };
        named.or(only).map(String::as_str)
    }

    /// The condition with this name.
    #[must_use]
    pub fn condition(&self, name: &str) -> Option<&Condition> {
        self.conditions.iter().find(|it| it.name == name)
    }
}

impl Condition {
    fn check(&self, place: &str, at: usize, zero: Zero) -> Result<(), BadInput> {
        let field = |field: &str, checked| {
            of_field(place, &format!("[[condition]] {}, {field}", at + 1), checked)
        };
        field("name", check_short(&self.name))?;
        field("label", check_text(&self.label, NAME_LETTERS_MAX))?;
        field("instruction", check_text(&self.instruction, TEXT_LETTERS_MAX))?;
        field("duration_s", check_number(self.duration_s, DURATION_S_MIN, SECONDS_MAX, "s"))?;
        field("baseline_s", check_number(self.baseline_s, 0.0, SECONDS_MAX, "s"))?;
        let found = format!("{} s", self.baseline_s);
        let fits = match zero {
            Zero::Start if self.baseline_s != 0.0 => Err((
                found,
                "remove it: nothing is before t = 0 where that is the first frame".to_owned(),
            )),
            Zero::Onset if self.baseline_s == 0.0 => Err((
                found,
                "say how much time there is for rising, where t = 0 is the onset of standing"
                    .to_owned(),
            )),
            _ => Ok(()),
        };
        field("baseline_s", fits)
    }
}

/// A mark that an operator makes with a key; the label is one of [`Protocol::marks`].
#[must_use]
pub fn mark_by_key(label: &str) -> Mark {
    Mark::new(Source::Key, label)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stand() -> Protocol {
        SUPPLIED[1].protocol()
    }

    #[test]
    fn what_is_supplied_is_what_its_sources_say() {
        let mctsib = SUPPLIED[0].protocol();
        assert_eq!(mctsib.conditions.len(), 4);
        assert!(mctsib.conditions.iter().all(|it| (it.duration_s, it.baseline_s) == (30.0, 0.0)));
        assert_eq!((mctsib.order, mctsib.zero_mark()), (Order::Fixed, None));
        let eyes = SUPPLIED[2].protocol();
        let names: Vec<&str> = eyes.conditions.iter().map(|it| &*it.name).collect();
        assert_eq!(names, ["eyes-open", "eyes-closed"]);
        // Scoppa et al. 2013: 25 to 40 s suffice; Pinsault and Vuillerme 2009: three trials.
        assert!(eyes.conditions.iter().all(|it| it.duration_s == 30.0) && eyes.repeats == 3);
        assert_eq!((eyes.order, eyes.zero_mark()), (Order::LatinSquare, None));
        let stand = stand();
        assert_eq!(stand.bins_s, [[0.0, 20.0], [20.0, 40.0], [40.0, 60.0]]);
        assert_eq!((stand.repeats, stand.zero_mark()), (2, Some("zero")));
        // The paper's physiological baseline begins 45 s before the rise.
        assert!(stand.conditions.iter().all(|it| it.baseline_s >= 45.0 && it.duration_s == 60.0));
    }

    #[test]
    fn what_is_written_is_read_again() {
        let mut others = SUPPLIED.map(|it| it.protocol()).to_vec();
        others.push(Protocol {
            name: "\"'\\ # = [x] \u{2028}".trim().replace('\u{2028}', "µ"),
            about: None,
            order: Order::LatinSquare,
            rest_s: 0.1 + 0.2,
            countdown_s: 1e-9,
            zero: Zero::Onset,
            marks: Vec::new(),
            ..stand()
        });
        for protocol in others {
            let text = protocol.text();
            assert_eq!(Protocol::parse(&text, "p.toml").unwrap(), protocol, "{text}");
        }
    }

    #[test]
    fn what_is_left_out_has_the_obvious_value() {
        let text = "name = \"a\"\norder = { by = \"fixed\" }\nzero = \"start\"\nbins_s = [[0, 30]]\n\
                    [[condition]]\nname = \"a\"\nlabel = \"A\"\ninstruction = \"I\"\nduration_s = 30\n";
        let protocol = Protocol::parse(text, "p.toml").unwrap();
        assert_eq!((protocol.repeats, protocol.rest_s, protocol.countdown_s), (1, 0.0, 0.0));
        assert_eq!((protocol.tones, &*protocol.marks), (Tones::default(), &[][..]));
    }

    #[test]
    fn every_fault_is_named_with_its_field_and_remedy() {
        type Change = fn(&mut Protocol);
        let cases: [(Change, &[&str]); 27] = [
            (|it| it.name.clear(), &["name: it is empty"]),
            (|it| it.name = "a".repeat(81), &["name: it has 81 characters; use at most 80"]),
            (|it| it.name = "a\u{202e}b".into(), &["name: ", "U+202E"]),
            (|it| it.about = Some("\u{7}".into()), &["about: ", "U+0007"]),
            (|it| it.rest_s = f64::NAN, &["rest_s: NaN s; give a number from 0 to 3600"]),
            (|it| it.countdown_s = -1.0, &["countdown_s: -1 s"]),
            (|it| it.conditions.clear(), &["condition: there are 0"]),
            (|it| it.conditions = vec![it.conditions[0].clone(); 17], &["condition: there are 17"]),
            (|it| it.repeats = 0, &["repeats: 0 of 2 conditions"]),
            (|it| it.repeats = 33, &["repeats: 33 of 2 conditions, 66 trials", "from 1 to 64"]),
            (|it| it.repeats = u32::MAX, &["repeats: "]),
            (|it| it.conditions[1].name = "../x".into(), &["[[condition]] 2, name: \"../x\""]),
            (
                |it| it.conditions[1].name = "con-trol".into(),
                &["name: \"con-trol\"", "\"control\""],
            ),
            (|it| it.conditions[0].label = " ".into(), &["[[condition]] 1, label: it is empty"]),
            (
                |it| it.conditions[0].instruction = "a".repeat(1001),
                &["instruction: it has 1001 characters"],
            ),
            (|it| it.conditions[0].duration_s = 0.5, &["duration_s: 0.5 s"]),
            (|it| it.conditions[0].duration_s = f64::INFINITY, &["duration_s: inf s"]),
            (|it| it.conditions[0].baseline_s = 1e9, &["baseline_s: 1000000000 s"]),
            (|it| it.zero = Zero::Start, &["baseline_s: 60 s; remove it"]),
            (
                |it| {
                    it.zero = Zero::Onset;
                    it.conditions[1].baseline_s = 0.0;
                },
                &["[[condition]] 2, baseline_s: 0 s; say how much time"],
            ),
            (|it| it.marks.clear(), &["marks: there is none"]),
            (|it| it.marks[1] = "stands".into(), &["marks: several, and none is called zero"]),
            (|it| it.marks[1] = "RISES".into(), &["marks: \"RISES\" is there twice"]),
            (|it| it.bins_s.clear(), &["bins_s: there are 0"]),
            (|it| it.bins_s[0] = [20.0, 0.0], &["bins_s: [20, 0] is not in order"]),
            (|it| it.bins_s[0][0] = f64::NAN, &["bins_s: [NaN, 20] is not in order"]),
            (
                |it| it.bins_s[2] = [40.0, 61.0],
                &["bins_s: [40, 61] is not measured", "from -60 s to 60 s"],
            ),
        ];
        for (change, parts) in cases {
            let mut protocol = stand();
            change(&mut protocol);
            let error = protocol.check("p.toml").unwrap_err().to_string();
            assert!(error.starts_with("p.toml: "), "{error}");
            for part in parts {
                assert!(error.contains(part), "no {part}: {error}");
            }
            // A page that edits it cannot store it either.
            let folder = tempfile::tempdir().unwrap();
            assert!(protocol.write(&folder.path().join("p.toml")).is_err());
        }
    }

    #[test]
    fn what_is_no_protocol_is_refused_with_its_line() {
        for (text, part) in [
            ("", "missing field"),
            ("name = 3", "name (line 1)"),
            ("names = \"a\"", "names (line 1)"),
            ("order = { by = \"chance\" }", "chance"),
            ("order = { by = \"random\" }", "order (line 1): a random order needs a seed"),
            ("order = { by = \"random\", seed = -1 }", "order (line 1)"),
            ("order = { by = \"fixed\", seed = 1 }", "only a random order has a seed"),
            ("order = { by = \"fixed\", row = 1 }", "row"),
            ("rest_s = 3 s", "a number has no unit"),
            ("\u{0}", "line 1"),
        ] {
            let error = Protocol::parse(text, "p.toml").unwrap_err().to_string();
            assert!(error.contains(part), "no {part}: {error}");
        }
    }

    /// Each piece of a supplied protocol is left out, doubled or replaced: whatever comes of it is a
    /// protocol that passes the check, or an error.
    #[test]
    fn no_text_makes_it_panic() {
        let text = SUPPLIED[1].text;
        let letters: Vec<(usize, char)> = text.char_indices().collect();
        for (step, (at, letter)) in letters.iter().enumerate() {
            let (before, after) = (&text[..*at], &text[at + letter.len_utf8()..]);
            let put = ["", "-", "9e999", "\"", "\u{200b}", "[[0]]"][step % 6];
            if let Ok(protocol) = Protocol::parse(&format!("{before}{put}{after}"), "p.toml") {
                assert_eq!(protocol.check("p.toml"), Ok(()));
                assert_eq!(Protocol::parse(&protocol.text(), "p.toml"), Ok(protocol));
            }
            let _ = Protocol::parse(before, "p.toml");
        }
    }
}
