//! The targets: the sheets that they are printed on, and how they are described to boxes.
//!
//! The description is `targets.toml` in the desk's folder, as soon as it is another one than that of the
//! standard pair and the standard board. What is printed is always the standard: a printer that is a
//! little off is described, and not corrected.

use std::path::{Path, PathBuf};

use plumbline::target::Role;
use plumbline_files::BadInput;
use plumbline_files::targets::{
    self, BOARD_PITCH_MM, STANDARD_PITCH_MM, TargetDescription, Targets,
};
use plumbline_render::sheet::{Paper, Print};

use crate::station::show;
use crate::wire::{PrintedTarget, Prints, PrintsChoice, Sheet};

/// The description's file.
const TARGETS: &str = "targets.toml";

/// What can be printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// The targets that a person wears.
    Pair,
    /// The board that the camera is calibrated with.
    Board,
}

impl What {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Pair, Self::Board];

    /// Its word in routes.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Pair => "pair",
            Self::Board => "board",
        }
    }

    fn title(self) -> &'static str {
        match self {
            Self::Pair => "The targets for lower back and shoulder",
            Self::Board => "The calibration board",
        }
    }

    fn pitch_mm(self) -> f64 {
        match self {
            Self::Pair => STANDARD_PITCH_MM,
            Self::Board => BOARD_PITCH_MM,
        }
    }

    /// On this paper.
    #[must_use]
    pub fn print(self, paper: Paper) -> Print {
        let descriptions = match self {
            Self::Pair => targets::standard_pair(),
            Self::Board => vec![targets::standard_board()],
        };
        Print::new(&descriptions, self.pitch_mm(), paper).expect("the standard can be printed")
    }
}

fn path(folder: &Path) -> PathBuf {
    folder.join(TARGETS)
}

/// The text of the description: the file's, or that of the standard.
///
/// # Errors
/// When the file cannot be read.
pub fn text(folder: &Path) -> Result<String, BadInput> {
    let path = path(folder);
    if path.exists() {
        return plumbline_files::read_text(&path);
    }
    let mut all = targets::standard_pair();
    all.push(targets::standard_board());
    Ok(targets::to_toml(&all))
}

/// The targets that are described.
///
/// # Errors
/// When the description cannot be read or used.
pub fn described(folder: &Path) -> Result<Targets, BadInput> {
    targets::parse(&text(folder)?, &path(folder).display().to_string())
}

/// What a person wears, as it is described; `None` where nobody has described anything, or nothing of
/// that kind.
///
/// # Errors
/// When the description cannot be read or used.
pub fn worn(folder: &Path) -> Result<Option<Vec<TargetDescription>>, BadInput> {
    if !path(folder).exists() {
        return Ok(None);
    }
    let described = described(folder)?;
    let worn = described.targets.iter().filter(|it| it.geometry.role() != Role::Scene);
    let worn: Vec<_> = worn.map(|it| targets::description(&it.name, &it.geometry)).collect();
    Ok(Some(worn).filter(|it| !it.is_empty()))
}

/// What a page shows.
///
/// # Errors
/// When the description cannot be read or used.
pub fn view(folder: &Path) -> Result<Prints, BadInput> {
    let described = described(folder)?;
    let targets = described.targets.iter().map(|it| {
        let TargetDescription { name, role, columns, rows, pitch_mm, .. } =
            targets::description(&it.name, &it.geometry);
        let role = show::role(role).to_owned();
        PrintedTarget { name, role, size: [columns, rows], pitch_mm }
    });
    let sheet = |what: What| Sheet {
        word: what.word().to_owned(),
        title: what.title().to_owned(),
        pitch_mm: what.pitch_mm(),
        pages: [Paper::A4, Paper::Letter].map(|paper| what.print(paper).sheets()),
    };
    Ok(Prints {
        path: path(folder).display().to_string(),
        text: text(folder)?,
        targets: targets.collect(),
        warnings: described.warnings,
        sheets: What::ALL.map(sheet).into(),
    })
}

/// Another description.
///
/// # Errors
/// When it cannot be used or written; then the one from before stays.
pub fn describe(folder: &Path, choice: &PrintsChoice) -> Result<(), BadInput> {
    const PLACE: &str = "the targets";
    let text = match choice {
        PrintsChoice::Text(text) => text.clone(),
        PrintsChoice::PitchesMm(pitches_mm) => {
            let described = described(folder)?.targets;
            let mut all: Vec<_> =
                described.iter().map(|it| targets::description(&it.name, &it.geometry)).collect();
            for (name, pitch_mm) in pitches_mm {
                let of = all.iter_mut().find(|it| it.name == *name && it.pitch_mm.is_some());
                let of = of.ok_or_else(|| {
                    let remedy = "give the name of a target that is described by its pitch";
                    BadInput::new(PLACE, "pitches_mm", format!("{name:?} is none"), remedy)
                })?;
                of.pitch_mm = Some(*pitch_mm);
            }
            targets::check(&all, PLACE)?;
            targets::to_toml(&all)
        }
    };
    targets::parse(&text, PLACE)?;
    plumbline_files::replace(&path(folder), text.as_bytes())
}
