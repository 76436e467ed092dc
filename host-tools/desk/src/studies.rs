//! The studies in the desk's folder.
//!
//! Each is a folder in it, as [`plumbline_session`] has it. A page names it by its folder's name alone,
//! so that no page reaches anything else on the disk.

use std::path::{Path, PathBuf};

use plumbline_files::BadInput;
use plumbline_session::folder::StudyFolder;
use plumbline_session::names;
use plumbline_session::participants::{Participant, Sex};
use plumbline_session::protocol::{Protocol, SUPPLIED};
use plumbline_session::session::{Session, State, Status};
use plumbline_trial::manifest::Manifest;

use crate::station::Refusal;
use crate::station::show;
use crate::wire::{
    ParticipantRow, Problem, ProtocolChoice, ProtocolView, Protocols, SessionRow, Studies,
    StudyCreate, StudyDetails, StudyRow, SuppliedProtocol, TrialRow,
};

/// The most letters of a folder's name.
const NAME_LETTERS_MAX: usize = 64;

/// The most studies that are listed.
const STUDIES_MAX: usize = 500;

/// The folder of a study, by its name; nothing else can be named so.
fn folder_of(folder: &Path, name: &str) -> Result<PathBuf, Refusal> {
    let is_letter = |it: char| it.is_alphanumeric() || "-_ .".contains(it);
    let is_name = !name.is_empty()
        && name.chars().count() <= NAME_LETTERS_MAX
        && name.chars().all(is_letter)
        && !name.starts_with(['.', ' '])
        && !name.ends_with([' ', '.']);
    if !is_name {
        return Err(not_found(name));
    }
    Ok(folder.join(name))
}

fn not_found(name: &str) -> Refusal {
    let shown: String = plumbline_files::text::printable(name).chars().take(80).collect();
    Refusal {
        status: 404,
        problem: Problem::new(
            format!("the study {shown:?}"),
            "there is none of this name",
            "choose one that is listed",
        ),
    }
}

/// Opens a study.
///
/// # Errors
/// When there is none of this name, or its protocol has a fault.
pub fn open(folder: &Path, name: &str) -> Result<StudyFolder, Refusal> {
    let path = folder_of(folder, name)?;
    if !path.join(names::PROTOCOL).exists() {
        return Err(not_found(name));
    }
    Ok(StudyFolder::open(&path)?)
}

/// The title of a study: as `study.toml` has it or, where that cannot be read, the name of its folder.
#[must_use]
pub fn title(study: &StudyFolder) -> String {
    #[derive(serde::Deserialize)]
    struct Title {
        title: String,
    }
    let text = plumbline_files::read_text(&study.path().join(names::STUDY)).ok();
    let read = text.and_then(|text| toml::from_str::<Title>(&text).ok()).map(|it| it.title);
    read.unwrap_or_else(|| {
        study.path().file_name().unwrap_or_default().to_string_lossy().into_owned()
    })
}

/// The studies that are there.
///
/// # Errors
/// When the folder cannot be read.
pub fn list(folder: &Path) -> Result<Studies, BadInput> {
    let failed = |error: std::io::Error| BadInput::io(folder.display(), &error);
    let mut list = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if !path.join(names::PROTOCOL).exists() || folder_of(folder, &name).is_err() {
            continue;
        }
        let (title, problem) = match StudyFolder::open(&path) {
            Ok(study) => (title(&study), None),
            Err(error) => (name.clone(), Some(error.into())),
        };
        list.push(StudyRow { folder: name, title, problem });
    }
    list.sort_by(|one, other| one.folder.cmp(&other.folder));
    list.truncate(STUDIES_MAX);
    Ok(Studies { list })
}

/// Makes a study.
///
/// # Errors
/// When its name, its title or its protocol has a fault, or there is one already.
pub fn create(folder: &Path, create: &StudyCreate) -> Result<(), Refusal> {
    if let Err((found, remedy)) = plumbline_session::check_short(&create.folder) {
        return Err(Refusal::bad(Problem::new("the study: folder", found, remedy)));
    }
    let protocol = chosen(&create.protocol)?;
    let path = folder_of(folder, &create.folder)?;
    StudyFolder::create(&path, &create.title, &protocol)?;
    Ok(())
}

/// The protocol that is meant.
///
/// # Errors
/// When it has a fault.
pub fn chosen(choice: &ProtocolChoice) -> Result<Protocol, Refusal> {
    const PLACE: &str = "the protocol";
    match choice {
        ProtocolChoice::Supplied(word) => {
            let supplied = SUPPLIED.iter().find(|it| it.word == word);
            let words = SUPPLIED.map(|it| it.word).join(", ");
            supplied.map(plumbline_session::protocol::Supplied::protocol).ok_or_else(|| {
                let remedy = format!("supplied are: {words}");
                Refusal::bad(Problem::new(PLACE, format!("{word:?} is not supplied"), remedy))
            })
        }
        ProtocolChoice::Text(text) => Ok(Protocol::parse(text, PLACE)?),
        ProtocolChoice::Fields(fields) => {
            let protocol: Protocol = serde_json::from_value(fields.clone()).map_err(|error| {
                let remedy = "correct it, or begin with one of the supplied protocols";
                Refusal::bad(Problem::new(PLACE, error.to_string(), remedy))
            })?;
            protocol.check(PLACE)?;
            Ok(protocol)
        }
    }
}

/// A protocol, as a page has it.
#[must_use]
pub fn protocol_view(protocol: &Protocol) -> ProtocolView {
    let trials = protocol.conditions.len() * protocol.repeats as usize;
    let each_s = |it: &plumbline_session::protocol::Condition| it.baseline_s + it.duration_s;
    let measured_s: f64 = protocol.conditions.iter().map(each_s).sum();
    let lasts_s = f64::from(protocol.repeats) * measured_s
        + trials as f64 * protocol.countdown_s
        + trials.saturating_sub(1) as f64 * protocol.rest_s;
    ProtocolView {
        text: protocol.text(),
        fields: serde_json::to_value(protocol).unwrap_or_default(),
        trials,
        lasts_s,
    }
}

/// The supplied protocols.
#[must_use]
pub fn protocols() -> Protocols {
    let supplied = SUPPLIED.iter().map(|it| SuppliedProtocol {
        word: it.word.to_owned(),
        protocol: protocol_view(&it.protocol()),
    });
    Protocols { supplied: supplied.collect() }
}

/// Adds a participant, or changes what is known of one.
///
/// # Errors
/// When something of it cannot be used.
pub fn set_participant(study: &StudyFolder, row: ParticipantRow) -> Result<(), Refusal> {
    let ParticipantRow { code, age_years, sex, height_cm, mass_kg } = row;
    let sex = match sex.as_deref() {
        None => None,
        Some("female") => Some(Sex::Female),
        Some("male") => Some(Sex::Male),
        Some("other") => Some(Sex::Other),
        Some(word) => {
            return Err(Refusal::bad(Problem::new(
                "the participant: sex",
                format!("{word:?}"),
                "give female, male or other, or leave it out",
            )));
        }
    };
    study.set_participant(Participant { code, age_years, sex, height_cm, mass_kg })?;
    Ok(())
}

/// A study with everything in it; `open_with` says with which box a session goes on.
///
/// # Errors
/// When it cannot be read.
pub fn details(
    study: &StudyFolder,
    open_with: impl Fn(&str) -> Option<String>,
) -> Result<StudyDetails, BadInput> {
    let participants = study.participants()?;
    let participants = participants.iter().map(|(_, it)| ParticipantRow {
        code: it.code.clone(),
        age_years: it.age_years,
        sex: it.sex.map(|sex| {
            match sex {
                Sex::Female => "female",
                Sex::Male => "male",
                Sex::Other => "other",
            }
            .to_owned()
        }),
        height_cm: it.height_cm,
        mass_kg: it.mass_kg,
    });
    let participants = participants.collect();
    let mut sessions = Vec::new();
    for seen in study.sessions()? {
        let folder = study.path().join(names::SESSIONS).join(&seen.name);
        let open_with = open_with(&seen.name);
        sessions.push(match seen.session {
            Ok(session) => session_row(seen.name, &session, &folder, open_with),
            Err(error) => SessionRow {
                participant: String::new(),
                started: String::new(),
                state: "unreadable".to_owned(),
                can_resume: false,
                open_with,
                done: 0,
                planned: 0,
                trials: Vec::new(),
                problem: Some(error.into()),
                name: seen.name,
            },
        });
    }
    let accepted = sessions.iter().flat_map(|it| &it.trials);
    Ok(StudyDetails {
        folder: study.path().file_name().unwrap_or_default().to_string_lossy().into_owned(),
        title: title(study),
        path: study.path().display().to_string(),
        protocol: protocol_view(&study.protocol()?),
        participants,
        accepted: accepted.filter(|it| it.outcome == "accepted").count(),
        sessions,
    })
}

fn session_row(
    name: String,
    session: &Session,
    folder: &Path,
    open_with: Option<String>,
) -> SessionRow {
    let places = 1..=session.plan.len();
    SessionRow {
        participant: session.participant.clone(),
        started: session.started.clone(),
        state: session.state.word().to_owned(),
        can_resume: session.state != State::Over && open_with.is_none(),
        open_with,
        done: places.filter(|place| session.status(*place) != Status::Open).count(),
        planned: session.plan.len(),
        trials: trials(folder, session),
        problem: None,
        name,
    }
}

/// The recordings of a session, whose folder is given.
#[must_use]
pub fn trials(folder: &Path, session: &Session) -> Vec<TrialRow> {
    let row = |attempt: &plumbline_session::session::Attempt| {
        let (outcome, why) = show::outcome(&attempt.outcome);
        let manifest = Manifest::read(&folder.join(&attempt.folder)).ok();
        let verdict = manifest.as_ref().and_then(|it| it.verdict.as_ref());
        let condition = session.plan.get(attempt.place - 1).map(|it| it.condition.clone());
        TrialRow {
            folder: attempt.folder.clone(),
            place: attempt.place,
            condition: condition.unwrap_or_default(),
            outcome: outcome.to_owned(),
            why,
            grade: verdict.map(|it| show::grade(it.grade())),
            has_report: verdict.is_some(),
        }
    };
    session.attempts.iter().map(row).collect()
}

/// The folder of a trial of a study.
///
/// # Errors
/// When the study has none of these names.
pub fn trial_folder(
    folder: &Path,
    study: &str,
    session: &str,
    trial: &str,
) -> Result<PathBuf, Refusal> {
    let study = open(folder, study)?;
    let none = || Refusal {
        status: 404,
        problem: Problem::new("the trial", "there is none of this name", "choose a listed one"),
    };
    let seen = study.sessions()?.into_iter().find(|it| it.name == session).ok_or_else(none)?;
    let known = seen.session?.attempts.iter().any(|it| it.folder == trial);
    if !known {
        return Err(none());
    }
    Ok(study.path().join(names::SESSIONS).join(session).join(trial))
}
