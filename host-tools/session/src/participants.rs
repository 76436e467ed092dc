//! The participants of a study, by codes alone: `participants.tsv` in the study's folder.
//!
//! The table is the one that the Brain Imaging Data Structure knows and `plumb export --format bids`
//! adds to: tab-separated, `participant_id` is `sub-` and the code, `n/a` stands where nothing is
//! known, and `participants.json` describes the columns.
//!
//! | column | holds |
//! |---|---|
//! | `participant_id` | `sub-P01` |
//! | `number` | the participant's number in the study, from 1, by which conditions are ordered |
//! | `age` | years |
//! | `sex` | `F`, `M` or `O` |
//! | `height` | cm |
//! | `weight` | the mass in kg, under the name that such tables use |
//!
//! Columns and rows of other programs stay as they are. The standard asks that ages of 89 and more be
//! published as `89+`.
//!
//! **A code is not a name.** It has 2 to 12 letters A to Z, a to z, and digits, with at least one
//! digit: `P01`, `s7b`. Six and more digits one after the other are refused: they may be a date of
//! birth or a hospital's number. Two codes differ by more than small and capital letters. So a code
//! is at the same time its label in a data set, and a part of folders' names.

use std::collections::HashSet;
use std::path::Path;

use plumbline_files::BadInput;
use plumbline_trial::export::{MISSING, Table};
use serde::{Deserialize, Serialize};

use crate::names;
use crate::words::{check_number, of_field};

/// The most participants of a study.
pub const PARTICIPANTS_MAX: usize = 5000;

const CODE_LETTERS_MIN: usize = 2;
const CODE_LETTERS_MAX: usize = 12;

/// So many digits one after the other may be a date or a number of a person.
const DIGITS_MAX: usize = 5;

const ID: &str = "participant_id";
const SUBJECT: &str = "sub-";

/// What the columns are, for other programs.
const DESCRIPTION: &str = r#"{
  "number": { "Description": "number of the participant in the study, by which conditions are ordered" },
  "age": { "Description": "age of the participant", "Units": "year" },
  "sex": { "Description": "sex of the participant", "Levels": { "F": "female", "M": "male", "O": "other" } },
  "height": { "Description": "height of the participant", "Units": "cm" },
  "weight": { "Description": "mass of the participant", "Units": "kg" }
}
"#;

/// A participant.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Participant {
    /// The code.
    pub code: String,
    /// Age, years.
    #[serde(default)]
    pub age_years: Option<f64>,
    /// Sex.
    #[serde(default)]
    pub sex: Option<Sex>,
    /// Height.
    #[serde(default)]
    pub height_cm: Option<f64>,
    /// Mass.
    #[serde(default)]
    pub mass_kg: Option<f64>,
}

/// The sex of a participant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sex {
    /// Female.
    Female,
    /// Male.
    Male,
    /// Other.
    Other,
}

impl Sex {
    const ALL: [Self; 3] = [Self::Female, Self::Male, Self::Other];

    /// As the table has it.
    #[must_use]
    pub fn letter(self) -> &'static str {
        match self {
            Self::Female => "F",
            Self::Male => "M",
            Self::Other => "O",
        }
    }

    /// The standard allows the letter and the word, small or capital.
    fn read(text: &str) -> Option<Self> {
        let word = |it: Self| match it {
            Self::Female => "female",
            Self::Male => "male",
            Self::Other => "other",
        };
        let mut all = Self::ALL.into_iter();
        all.find(|it| {
            text.eq_ignore_ascii_case(it.letter()) || text.eq_ignore_ascii_case(word(*it))
        })
    }
}

/// Checks that a text is a code.
pub(crate) fn check_code(code: &str) -> Result<(), (String, String)> {
    let remedy = |text: &str| Err((format!("{code:?} is not a code"), text.to_owned()));
    if !code.chars().all(|it| it.is_ascii_alphanumeric())
        || !(CODE_LETTERS_MIN..=CODE_LETTERS_MAX).contains(&code.len())
    {
        return remedy("use 2 to 12 letters A to Z, a to z, and digits, as in P01");
    }
    if !code.chars().any(|it| it.is_ascii_digit()) {
        return remedy("a code has at least one digit, as in P01: names do not belong here");
    }
    let digits = code.split(|it: char| !it.is_ascii_digit()).map(str::len).max();
    if digits.is_some_and(|it| it > DIGITS_MAX) {
        return remedy(
            "use at most 5 digits in a row: a date of birth or a hospital's number does not belong \
             here",
        );
    }
    Ok(())
}

/// The numbers of a participant: column, value, bounds, unit.
type Number = (&'static str, f64, f64, &'static str);

const AGE: Number = ("age", 0.0, 120.0, "years");
const HEIGHT: Number = ("height", 30.0, 250.0, "cm");
const MASS: Number = ("weight", 1.0, 400.0, "kg");

impl Participant {
    /// Checks the code and the numbers; `place` names their source in errors.
    ///
    /// # Errors
    /// The first fault: the field, what was found, and the remedy.
    pub fn check(&self, place: &str) -> Result<(), BadInput> {
        of_field(place, "code", check_code(&self.code))?;
        for ((name, from, to, unit), value) in self.numbers() {
            if let Some(value) = value {
                of_field(place, name, check_number(value, from, to, unit))?;
            }
        }
        Ok(())
    }

    fn numbers(&self) -> [(Number, Option<f64>); 3] {
        [(AGE, self.age_years), (HEIGHT, self.height_cm), (MASS, self.mass_kg)]
    }
}

/// The participants of a study.
#[derive(Debug, Clone)]
pub struct Participants {
    place: String,
    table: Table,
    /// In the order of the table, each with the number in the study.
    list: Vec<(u32, Participant)>,
}

impl Participants {
    /// Reads the participants of a study's folder; without a table there are none.
    ///
    /// # Errors
    /// When the table cannot be read; the error names the row.
    pub fn read(study: &Path) -> Result<Self, BadInput> {
        let path = study.join(names::PARTICIPANTS);
        let table = Table::read(&path, ID)?;
        Self::of(table, path.display().to_string())
    }

    fn of(table: Table, place: String) -> Result<Self, BadInput> {
        if table.rows() > PARTICIPANTS_MAX {
            let remedy = format!("a study has at most {PARTICIPANTS_MAX} participants");
            return Err(BadInput::whole(&place, format!("{} rows", table.rows()), remedy));
        }
        let mut list: Vec<(Option<u32>, Participant)> = Vec::new();
        let (mut codes, mut numbers) = (HashSet::new(), HashSet::new());
        for row in 0..table.rows() {
            let field = |column: &str| format!("participant {}, {column}", row + 1);
            let read = participant(&table, row).map_err(|(column, found, remedy)| {
                BadInput::new(&place, field(column), found, remedy)
            })?;
            let is_new_code = codes.insert(read.1.code.to_ascii_lowercase());
            let is_new_number = read.0.is_none_or(|number| numbers.insert(number));
            if !(is_new_code && is_new_number) {
                return Err(BadInput::new(
                    &place,
                    field(if is_new_code { "number" } else { ID }),
                    "another one has the same",
                    "give each participant a code and a number of their own",
                ));
            }
            list.push(read);
        }
        // Rows of other programs have no number; they get the next ones, in their order.
        let mut next = list.iter().filter_map(|it| it.0).max().unwrap_or(0);
        let list = list.into_iter().map(|(number, participant)| {
            let number = number.unwrap_or_else(|| {
                next += 1;
                next
            });
            (number, participant)
        });
        let list = list.collect();
        Ok(Self { place, table, list })
    }

    /// All, in the order of the table, each with the number in the study.
    pub fn iter(&self) -> impl Iterator<Item = (u32, &Participant)> {
        self.list.iter().map(|(number, participant)| (*number, participant))
    }

    /// The participant with this code, and the number in the study.
    #[must_use]
    pub fn get(&self, code: &str) -> Option<(u32, &Participant)> {
        self.iter().find(|(_, it)| it.code == code)
    }

    /// Adds a participant, who gets the next number, or replaces what is known of one with the same
    /// code, and returns the number. Nothing is written yet.
    ///
    /// # Errors
    /// When the code or a number cannot be used, or the study is full.
    pub fn set(&mut self, participant: Participant) -> Result<u32, BadInput> {
        participant.check(&self.place)?;
        let same = |it: &Participant| it.code.eq_ignore_ascii_case(&participant.code);
        let at = self.list.iter().position(|(_, it)| same(it));
        if let Some(other) = at.map(|at| &self.list[at].1).filter(|it| it.code != participant.code)
        {
            return Err(BadInput::new(
                &self.place,
                "code",
                format!("{:?}, and there is {:?} already", participant.code, other.code),
                "give a code that differs by more than small and capital letters",
            ));
        }
        let Some(at) = at else {
            if self.list.len() >= PARTICIPANTS_MAX {
                let remedy = "begin another study";
                return Err(BadInput::whole(&self.place, "the study is full", remedy));
            }
            let number = self.list.iter().map(|it| it.0).max().unwrap_or(0) + 1;
            self.list.push((number, participant));
            return Ok(number);
        };
        self.list[at].1 = participant;
        Ok(self.list[at].0)
    }

    /// Writes the table, and what describes its columns if that is not there.
    ///
    /// # Errors
    /// When the operating system refuses.
    pub fn write(&self, study: &Path) -> Result<(), BadInput> {
        let mut table = self.table.clone();
        for (number, it) in &self.list {
            let text = |value: Option<f64>| value.map_or(MISSING.to_owned(), |it| it.to_string());
            table.add(&[
                (ID, &format!("{SUBJECT}{}", it.code)),
                ("number", &number.to_string()),
                ("age", &text(it.age_years)),
                ("sex", it.sex.map_or(MISSING, Sex::letter)),
                ("height", &text(it.height_cm)),
                ("weight", &text(it.mass_kg)),
            ]);
        }
        let description = study.join(names::PARTICIPANTS_COLUMNS);
        if !description.exists() {
            plumbline_files::replace(&description, DESCRIPTION.as_bytes())?;
        }
        plumbline_files::replace(&study.join(names::PARTICIPANTS), table.text().as_bytes())
    }
}

/// The participant of a row, or the column, what is wrong in it, and the remedy.
fn participant(
    table: &Table,
    row: usize,
) -> Result<(Option<u32>, Participant), (&'static str, String, String)> {
    let known = |name| table.get(row, name).map(str::trim).filter(|it| !["", MISSING].contains(it));
    let id = known(ID).unwrap_or_default();
    let code = id.strip_prefix(SUBJECT).unwrap_or_default().to_owned();
    let named = |(_, remedy)| (ID, format!("{id:?} is not sub- and a code"), remedy);
    check_code(&code).map_err(named)?;
    let number_of = |(name, from, to, unit): Number| {
        let Some(text) = known(name) else { return Ok(None) };
        let wrong = |(_, remedy)| (name, format!("{text:?} in {unit}"), remedy);
        let value = text.parse().unwrap_or(f64::NAN);
        check_number(value, from, to, unit).map_err(wrong)?;
        Ok(Some(value))
    };
    let sex = known("sex").map(|text| {
        let wrong = || ("sex", format!("{text:?}"), "write F, M, O or n/a".to_owned());
        Sex::read(text).ok_or_else(wrong)
    });
    let number = known("number").map(|text| {
        let wrong = || {
            let remedy = "write the number in the study, from 1, or n/a".to_owned();
            ("number", format!("{text:?}"), remedy)
        };
        text.parse().ok().filter(|it| (1..=1_000_000).contains(it)).ok_or_else(wrong)
    });
    let participant = Participant {
        code,
        age_years: number_of(AGE)?,
        sex: sex.transpose()?,
        height_cm: number_of(HEIGHT)?,
        mass_kg: number_of(MASS)?,
    };
    Ok((number.transpose()?, participant))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Participants, String> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(names::PARTICIPANTS), text).unwrap();
        Participants::read(folder.path()).map_err(|error| error.to_string())
    }

    #[test]
    fn a_code_is_neither_a_name_nor_a_date_nor_a_path() {
        for code in ["P01", "s7b", "12", "A1B2C3D4E5F6", "99999"] {
            assert_eq!(check_code(code), Ok(()), "{code}");
        }
        for code in [
            "",
            "1",
            "Smith",
            "P 01",
            "P-01",
            "P.01",
            "../1",
            "P01\n",
            "Ä1",
            "１２",
            "19480312",
            "id123456",
            "P1234567890123",
        ] {
            assert!(check_code(code).is_err(), "{code:?}");
        }
    }

    #[test]
    fn what_is_written_is_read_again_and_numbers_stay() {
        let folder = tempfile::tempdir().unwrap();
        let whole = Participant {
            code: "P02".into(),
            age_years: Some(71.5),
            sex: Some(Sex::Other),
            height_cm: Some(168.0),
            mass_kg: Some(0.1 + 70.2),
        };
        let mut participants = Participants::read(folder.path()).unwrap();
        let only = |code: &str| Participant { code: code.into(), ..Participant::default() };
        assert_eq!(participants.set(whole.clone()), Ok(1));
        assert_eq!(participants.set(only("P01")), Ok(2));
        participants.write(folder.path()).unwrap();
        let mut again = Participants::read(folder.path()).unwrap();
        let found: Vec<_> = again.iter().map(|(number, it)| (number, it.clone())).collect();
        assert_eq!(found, [(1, whole), (2, only("P01"))]);
        // What is known changes, and the number does not.
        assert_eq!(again.set(Participant { sex: Some(Sex::Male), ..only("P02") }), Ok(1));
        assert!(again.set(only("p02")).unwrap_err().to_string().contains("\"P02\" already"));
        assert_eq!(again.get("P02").unwrap().1.sex, Some(Sex::Male));
        let path = folder.path().join(names::PARTICIPANTS_COLUMNS);
        let described: serde_json::Value =
            serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
        let text = std::fs::read_to_string(folder.path().join(names::PARTICIPANTS)).unwrap();
        for column in text.lines().next().unwrap().split('\t').skip(1) {
            assert!(described[column].is_object(), "{column}");
        }
    }

    #[test]
    fn what_others_have_written_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(names::PARTICIPANTS);
        let text = "handedness\tparticipant_id\tsex\nleft\tsub-X9\tfemale\nn/a\tsub-X8\tn/a\n";
        std::fs::write(&path, text).unwrap();
        std::fs::write(folder.path().join(names::PARTICIPANTS_COLUMNS), "{}").unwrap();
        let mut participants = Participants::read(folder.path()).unwrap();
        assert_eq!(participants.get("X8").unwrap().0, 2);
        let new = Participant { code: "P01".into(), ..Participant::default() };
        assert_eq!(participants.set(new), Ok(3));
        participants.write(folder.path()).unwrap();
        let written = std::fs::read_to_string(&path).unwrap();
        let wanted = "handedness\tparticipant_id\tsex\tnumber\tage\theight\tweight\n\
                      left\tsub-X9\tF\t1\tn/a\tn/a\tn/a\n\
                      n/a\tsub-X8\tn/a\t2\tn/a\tn/a\tn/a\n\
                      n/a\tsub-P01\tn/a\t3\tn/a\tn/a\tn/a\n";
        assert_eq!(written, wanted);
        let columns = folder.path().join(names::PARTICIPANTS_COLUMNS);
        assert_eq!(std::fs::read_to_string(columns).unwrap(), "{}");
    }

    #[test]
    fn a_row_that_cannot_be_meant_is_named() {
        let row = |row: &str| read(&format!("participant_id\tnumber\tage\tsex\theight\n{row}\n"));
        for (text, part) in [
            ("P01\tn/a\tn/a\tn/a\tn/a", "participant 1, participant_id: \"P01\" is not sub-"),
            ("sub-Smith\tn/a\tn/a\tn/a\tn/a", "names do not belong here"),
            ("sub-P01\t0\tn/a\tn/a\tn/a", "number: \"0\""),
            ("sub-P01\tn/a\told\tn/a\tn/a", "age: \"old\" in years; give a number from 0 to 120"),
            ("sub-P01\tn/a\tNaN\tn/a\tn/a", "age: \"NaN\""),
            ("sub-P01\tn/a\tn/a\tyes\tn/a", "sex: \"yes\"; write F, M, O or n/a"),
            ("sub-P01\tn/a\tn/a\tn/a\t1.71", "height: \"1.71\" in cm"),
            ("sub-P01\t1\tn/a\tn/a\tn/a\nsub-P02\t1\tn/a\tn/a\tn/a", "participant 2, number"),
            (
                "sub-P01\t1\tn/a\tn/a\tn/a\nsub-p01\t2\tn/a\tn/a\tn/a",
                "participant 2, participant_id",
            ),
        ] {
            let error = row(text).unwrap_err();
            assert!(error.contains(part), "no {part}: {error}");
        }
        let many: String = (0..=PARTICIPANTS_MAX).map(|at| format!("sub-P{at}\n")).collect();
        assert!(read(&format!("participant_id\n{many}")).unwrap_err().contains("5001 rows"));
    }
}
