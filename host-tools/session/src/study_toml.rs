//! `study.toml`: what a session adds to it.
//!
//! A person may have written the file, or changed it: what is there stays, with its comments and its
//! order. Only what is missing is added: conditions, `repeats = "mean"` where the protocol repeats
//! conditions, and a `[[trial]]` with the folder of each accepted trial. Participant and condition
//! are in the trial's own `trial.toml`.

use std::path::{Component, Path, PathBuf};

use plumbline_files::{BadInput, from_toml};
use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, Value, value};

use crate::protocol::Protocol;

const HEADING: &str = "# The study, for `plumb study study.toml`. Sessions add conditions and trials; what is changed here\n\
                       # stays. `plumb study --new FILE` writes an example with every setting explained.\n";

const REMEDY: &str = "correct it; `plumb study --new FILE` writes an example with comments";

/// The text of a new study.
pub fn new(title: &str, protocol: &Protocol) -> String {
    let mut document = DocumentMut::new();
    document.insert("title", value(title));
    document.insert("conditions", value(Array::new()));
    document.insert("bins_s", value(bins_of(protocol)));
    let mut found = Found { document, place: String::new(), warnings: Vec::new() };
    found.add_conditions(protocol).expect("the list is there");
    found.add_repeats(protocol);
    format!("{HEADING}{}", found.document)
}

/// A study's text with what a protocol needs and with these trials, whose folders are relative to
/// `base`, the study's own; and what a user should know.
///
/// # Errors
/// When the text is not TOML, or a field is not what a study has.
pub fn updated(
    text: &str,
    base: &Path,
    place: &str,
    protocol: &Protocol,
    folders: &[PathBuf],
) -> Result<(String, Vec<String>), BadInput> {
    // The errors of this reader name the line.
    from_toml::<toml::Table>(text, place, REMEDY)?;
    let document = text.parse::<DocumentMut>();
    let document = document.map_err(|error| BadInput::whole(place, error.message(), REMEDY))?;
    let mut found = Found { document, place: place.to_owned(), warnings: Vec::new() };
    found.add_conditions(protocol)?;
    found.add_repeats(protocol);
    found.compare_bins(protocol);
    found.add_trials(base, folders)?;
    Ok((found.document.to_string(), found.warnings))
}

/// A study's text after its protocol was changed: the times that it compares follow the protocol's, unless
/// a person has chosen others.
///
/// # Errors
/// When the text is not TOML.
pub fn following(
    text: &str,
    place: &str,
    before: &Protocol,
    after: &Protocol,
) -> Result<String, BadInput> {
    let document = text.parse::<DocumentMut>();
    let document = document.map_err(|error| BadInput::whole(place, error.message(), REMEDY))?;
    let mut found = Found { document, place: place.to_owned(), warnings: Vec::new() };
    if !found.has_bins_of(before) || found.has_bins_of(after) {
        return Ok(text.to_owned());
    }
    found.document.insert("bins_s", value(bins_of(after)));
    Ok(found.document.to_string())
}

/// The times that a protocol compares.
fn bins_of(protocol: &Protocol) -> Array {
    protocol.bins_s.iter().map(|bin| Value::Array(bin.iter().copied().collect())).collect()
}

struct Found {
    document: DocumentMut,
    place: String,
    warnings: Vec<String>,
}

impl Found {
    fn wrong(&self, field: &str, found: &str) -> BadInput {
        BadInput::new(&self.place, field, found, REMEDY)
    }

    fn add_conditions(&mut self, protocol: &Protocol) -> Result<(), BadInput> {
        let wrong = self.wrong("conditions", "it is not a list of names");
        let item = self.document.entry("conditions").or_insert_with(|| value(Array::new()));
        let Some(list) = item.as_array_mut() else { return Err(wrong) };
        if list.iter().any(|it| it.as_str().is_none()) {
            return Err(wrong);
        }
        for condition in &protocol.conditions {
            let is_there =
                list.iter().any(|it| it.as_str().is_some_and(|it| it.trim() == condition.name));
            if !is_there {
                list.push(condition.name.as_str());
            }
        }
        Ok(())
    }

    fn add_repeats(&mut self, protocol: &Protocol) {
        if protocol.repeats > 1 && !self.document.contains_key("repeats") {
            self.document.insert("repeats", value("mean"));
        }
    }

    /// Whether it compares the times of this protocol.
    fn has_bins_of(&self, protocol: &Protocol) -> bool {
        let number = |it: &Value| it.as_float().or_else(|| it.as_integer().map(|it| it as f64));
        let bins: Option<Vec<Vec<Option<f64>>>> = self.document.get("bins_s").and_then(|item| {
            let pair = |it: &Value| Some(it.as_array()?.iter().map(number).collect());
            item.as_array()?.iter().map(pair).collect()
        });
        bins == Some(protocol.bins_s.iter().map(|it| it.map(Some).to_vec()).collect())
    }

    fn compare_bins(&mut self, protocol: &Protocol) {
        if !self.has_bins_of(protocol) {
            self.warnings.push(format!(
                "{}: bins_s are other times than the protocol's; the study compares its own",
                self.place
            ));
        }
    }

    fn add_trials(&mut self, base: &Path, folders: &[PathBuf]) -> Result<(), BadInput> {
        let wrong = self.wrong("trial", "it is not a list of trials");
        let none = || Item::ArrayOfTables(ArrayOfTables::new());
        let item = self.document.entry("trial").or_insert_with(none);
        let path = |folder: &str| real(base, folder.as_ref());
        let listed: Vec<PathBuf> = match &*item {
            Item::ArrayOfTables(trials) => {
                let folder = |it: &Table| it.get("folder")?.as_str().map(path);
                trials.iter().filter_map(folder).collect()
            }
            Item::Value(Value::Array(trials)) => {
                let folder = |it: &Value| it.as_inline_table()?.get("folder")?.as_str().map(path);
                trials.iter().filter_map(folder).collect()
            }
            _ => return Err(wrong),
        };
        for folder in folders.iter().filter(|it| !listed.contains(&real(base, it))) {
            let folder = folder.to_string_lossy().into_owned();
            match item {
                Item::ArrayOfTables(trials) => {
                    let mut trial = Table::new();
                    trial.insert("folder", value(folder));
                    trials.push(trial);
                }
                Item::Value(Value::Array(trials)) => {
                    let mut trial = InlineTable::new();
                    trial.insert("folder", folder.into());
                    trials.push(trial);
                }
                _ => return Err(wrong),
            }
        }
        Ok(())
    }
}

/// A path without its links and detours; of what is not there, without its detours.
fn real(base: &Path, path: &Path) -> PathBuf {
    let path = base.join(path);
    path.canonicalize().unwrap_or_else(|_| {
        let mut plain = PathBuf::new();
        for part in path.components() {
            match part {
                Component::CurDir => {}
                Component::ParentDir => {
                    plain.pop();
                }
                part => plain.push(part),
            }
        }
        plain
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::SUPPLIED;

    fn add(text: &str, folders: &[&str]) -> Result<(String, Vec<String>), String> {
        let folders: Vec<PathBuf> = folders.iter().map(PathBuf::from).collect();
        let protocol = SUPPLIED[1].protocol();
        updated(text, Path::new("/nowhere"), "study.toml", &protocol, &folders)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn a_new_study_has_what_the_protocol_has() {
        let text = new("A \"study\"", &SUPPLIED[1].protocol());
        let wanted = "title = 'A \"study\"'\nconditions = [\"control\", \"hypoperfusion\"]\n\
                      bins_s = [[0.0, 20.0], [20.0, 40.0], [40.0, 60.0]]\nrepeats = \"mean\"\n";
        assert_eq!(text.strip_prefix(HEADING), Some(wanted));
        let (again, warnings) = add(&text, &[]).unwrap();
        assert_eq!((again, warnings), (text, vec![]));
    }

    #[test]
    fn the_times_follow_the_protocol_unless_a_person_has_chosen_others() {
        let before = SUPPLIED[1].protocol();
        let after = Protocol { bins_s: vec![[0.0, 5.0]], ..before.clone() };
        let text = new("A study", &before);
        let followed = following(&text, "study.toml", &before, &after).unwrap();
        assert_eq!(followed, new("A study", &after));
        let chosen = text.replace("[40.0, 60.0]", "[40.0, 50.0]");
        assert_eq!(following(&chosen, "study.toml", &before, &after), Ok(chosen));
        assert!(following("[", "study.toml", &before, &after).is_err());
    }

    #[test]
    fn what_a_person_has_written_stays_to_the_letter() {
        let text = "# mine\ntitle   =  \"T\" # so\nbins_s = [[0,20], [20, 40.0], [ 40, 60 ]]\n\
                    conditions = [ \"hypoperfusion\", # first\n  \"rest\" ]\nrepeats = \"mean\"\n\
                    \n# of old\n[[trial]]\nfolder = \"./old/../sessions/P01-1/01-control\" # kept\n\
                    condition = \"rest\"\n";
        let folders = ["sessions/P01-1/01-control", "sessions/P01-1/02-hypoperfusion"];
        let (after, warnings) = add(text, &folders).unwrap();
        let wanted = text.replace("\"rest\" ]", "\"rest\" , \"control\"]")
            + "\n[[trial]]\nfolder = \"sessions/P01-1/02-hypoperfusion\"\n";
        assert_eq!(after, wanted);
        assert_eq!(warnings, [""; 0]);
        assert_eq!(add(&after, &folders).unwrap().0, after);
    }

    #[test]
    fn a_list_in_one_line_is_a_list_too() {
        let text = "title = \"T\"\ntrial = [{ folder = \"a\" }]\n";
        let (after, warnings) = add(text, &["a", "b"]).unwrap();
        assert!(after.contains("trial = [{ folder = \"a\" }, { folder = \"b\" }]"), "{after}");
        assert!(after.contains("conditions = [\"control\", \"hypoperfusion\"]"), "{after}");
        assert_eq!(warnings.len(), 1);
        assert_eq!(add(&after, &["a", "b"]).unwrap().0, after);
    }

    #[test]
    fn what_is_no_study_is_left_alone() {
        for (text, part) in [
            ("title = ", "title (line 1)"),
            ("conditions = \"control\"", "conditions: it is not a list"),
            ("conditions = [1]", "conditions: it is not a list"),
            ("trial = 3", "trial: it is not a list"),
            ("[trial]\nfolder = \"a\"", "trial: it is not a list"),
        ] {
            let error = add(text, &["a"]).unwrap_err();
            assert!(error.contains(part), "no {part}: {error}");
        }
    }
}
