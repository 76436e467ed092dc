//! `plumb target`: targets to print.

use std::path::{Path, PathBuf};

use plumbline::limits::NAME_BYTES_MAX;
use plumbline::target::Role;
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_files::targets::{self, OriginName, TargetDescription, Targets};
use plumbline_render::sheet::{self, Paper, Print};
use plumbline_stream::recorder::role_word;

use crate::ui::stdout;

/// Print targets: the standard pair, a calibration board, or any grid.
///
/// Writes a PDF or SVG at true scale, with cut lines, an arrow that shows which side is
/// up, and a ruler of 100 mm. The matching targets.toml goes to standard output, or
/// into the file of --targets. What is larger than a sheet is spread over several that overlap.
///
/// Count INNER corners, where four squares meet: a board of 7 x 6 squares is a grid of 6x5.
/// Take columns + rows odd: such a grid looks different upside down.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  plumb target --standard --out pair.pdf > targets.toml
  plumb target --standard --paper letter --out pair.pdf --targets targets.toml
  plumb target --grid 9x6 --pitch-mm 20 --out board.pdf --targets board.toml
  plumb target --grid 9x6 --pitch-mm 20 --out board.pdf --targets targets.toml --add
  plumb target --grid 7x4 --pitch-mm 15 --name sacrum --role lower --out sacrum.svg

Printing:
  1. Print at 100 % (\"actual size\"), never \"fit to page\". On matt paper: gloss reflects lamps.
  2. Measure the ruler: 100 mm, or the printer has scaled the page.
  3. Measure the squares, many at once, and divide: that is the pitch. If it is not what
     targets.toml says, correct pitch_mm there, not the print.
  4. Cut along the dashed lines, or farther out, and glue it to something flat and stiff.
     The white margin of one square all around belongs to the target.")]
pub struct Arguments {
    /// The standard pair: lumbar 6x5 and shoulder 5x4, pitch 12 mm.
    #[arg(long, conflicts_with_all = ["grid", "name", "role"], required_unless_present = "grid")]
    standard: bool,
    /// A grid of inner corners, such as a calibration board of 9x6.
    #[arg(long, visible_alias = "board", value_name = "COLUMNSxROWS", value_parser = targets::grid_size, requires = "pitch_mm")]
    grid: Option<[u8; 2]>,
    /// Side of a square in mm: from one inner corner to the next [default: 12 for --standard].
    #[arg(long, value_name = "MM")]
    pitch_mm: Option<f64>,
    /// The grid's name in all outputs.
    #[arg(long, default_value = "board")]
    name: String,
    /// What the grid is for: on the lower back, on the shoulder, or standing in the room.
    #[arg(long, value_enum, default_value_t = RoleName::Scene)]
    role: RoleName,
    /// The paper.
    #[arg(long, value_enum, default_value_t)]
    paper: Paper,
    /// The file to write, FILE.pdf or FILE.svg. Of several sheets a PDF has several
    /// pages; SVG files are numbered, FILE-1.svg and so on.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write the targets file here instead of to standard output.
    #[arg(long, value_name = "FILE")]
    targets: Option<PathBuf>,
    /// Add to the file of --targets: a box takes the pair and the board from one file.
    #[arg(long, requires = "targets")]
    add: bool,
    /// Replace the files of --out and --targets if they exist.
    #[arg(long)]
    force: bool,
}

/// [`Role`] on the command line, as targets.toml spells it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum RoleName {
    Lower,
    Upper,
    Scene,
}

/// Runs the subcommand.
///
/// # Errors
/// When the targets cannot be printed or tracked, a file is in the way, or writing fails.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let format = Format::of(&arguments.out)?;
    let pitch_mm = arguments.pitch_mm.unwrap_or(targets::STANDARD_PITCH_MM);
    let descriptions = arguments.descriptions(pitch_mm)?;
    let print = Print::new(&descriptions, pitch_mm, arguments.paper)?;
    for warning in &print.warnings {
        eprintln!("warning: {warning}");
    }
    let outputs = format.files(&arguments.out, &print);
    let entry = targets::to_toml(&descriptions);
    match &arguments.targets {
        Some(path) if arguments.add => {
            let all = added(path, &descriptions)?;
            plumbline_files::write_all(&outputs, arguments.force)?;
            plumbline_files::write_all(&[(path.clone(), all.into_bytes())], true)?;
        }
        described => {
            let described = described.iter().map(|path| (path.clone(), entry.clone().into_bytes()));
            let outputs: Vec<(PathBuf, Vec<u8>)> = outputs.into_iter().chain(described).collect();
            plumbline_files::write_all(&outputs, arguments.force)?;
        }
    }
    let sheets = counted(print.sheets(), "sheet");
    eprintln!("{}: {sheets} of {}", arguments.out.display(), arguments.paper.name());
    eprintln!(
        "Print at 100 % (\"actual size\"); the ruler must measure 100 mm. Then measure the squares, many at once, and correct pitch_mm if it differs."
    );
    if arguments.targets.is_none() {
        stdout::print(&entry)?;
    }
    Ok(())
}

/// A targets file with more in it, as it was written otherwise; checked as a whole.
fn added(path: &Path, descriptions: &[TargetDescription]) -> Result<String, BadInput> {
    let before =
        std::fs::read_to_string(path).map_err(|error| BadInput::io(path.display(), &error))?;
    let place = path.display().to_string();
    refuse_known(&targets::parse(&before, &place)?, descriptions, &place)?;
    let all = format!("{}\n\n{}", before.trim_end(), targets::to_toml(descriptions));
    targets::parse(&all, &place)?;
    Ok(all)
}

/// Says what is in the way of a target that a file has already, or has another one in place of.
fn refuse_known(
    known: &Targets,
    descriptions: &[TargetDescription],
    place: &str,
) -> Result<(), BadInput> {
    let new = targets::check(descriptions, "--grid")?;
    let refused = |found: String, remedy: &str| Err(BadInput::whole(place, found, remedy));
    for new in &new.targets {
        for known in &known.targets {
            let (name, role) = (&known.name, role_word(known.geometry.role()));
            if new.name == *name && new.geometry == known.geometry {
                return refused(
                    format!("the target {name:?} is in it already, the very same"),
                    "there is nothing to add: to print it once more, leave --targets and --add out",
                );
            }
            if new.name == *name {
                return refused(
                    format!("another target is called {name:?} already"),
                    "give this one another --name, or take that one out of the file",
                );
            }
            if new.geometry.role() == known.geometry.role() {
                return refused(
                    format!(
                        "the target {name:?} has the role {role:?} already, and a box takes one of each"
                    ),
                    "give this one another --role, or take that one out of the file",
                );
            }
        }
    }
    Ok(())
}

impl Arguments {
    fn descriptions(&self, pitch_mm: f64) -> Result<Vec<TargetDescription>, BadInput> {
        let mut descriptions = match self.grid {
            None => targets::standard_pair(),
            Some([columns, rows]) => vec![TargetDescription {
                name: self.printable_name()?,
                role: match self.role {
                    RoleName::Lower => Role::Lower,
                    RoleName::Upper => Role::Upper,
                    RoleName::Scene => Role::Scene,
                },
                columns,
                rows,
                pitch_mm: None,
                origin: Some(OriginName::Center),
                // As the standard pair has it: the trunk's point is deep in the body.
                virtual_point_mm: match self.role {
                    RoleName::Lower => [0.0, 0.0, 100.0],
                    RoleName::Upper | RoleName::Scene => [0.0; 3],
                },
                points_mm: None,
            }],
        };
        for description in &mut descriptions {
            description.pitch_mm = Some(pitch_mm);
        }
        Ok(descriptions)
    }

    fn printable_name(&self) -> Result<String, BadInput> {
        if self.name.is_empty()
            || self.name.len() > NAME_BYTES_MAX
            || !sheet::is_printable(&self.name)
        {
            return Err(BadInput::whole(
                "--name",
                format!("{:?}", self.name),
                format!(
                    "give 1 to {NAME_BYTES_MAX} bytes of Latin letters, which the sheet's fonts have; targets.toml may say another name later"
                ),
            ));
        }
        Ok(self.name.clone())
    }
}

/// What is written.
#[derive(Clone, Copy)]
enum Format {
    Pdf,
    Svg,
}

impl Format {
    fn of(path: &Path) -> Result<Self, BadInput> {
        let extension = path.extension().and_then(|it| it.to_str()).unwrap_or_default();
        match extension.to_ascii_lowercase().as_str() {
            "pdf" => Ok(Self::Pdf),
            "svg" => Ok(Self::Svg),
            _ => Err(BadInput::whole(
                "--out",
                format!("{} ends neither in .pdf nor in .svg", path.display()),
                "give FILE.pdf or FILE.svg",
            )),
        }
    }

    /// The files of all sheets.
    fn files(self, out: &Path, print: &Print) -> Vec<(PathBuf, Vec<u8>)> {
        match self {
            Self::Pdf => vec![(out.to_owned(), print.pdf())],
            Self::Svg => {
                let named = |number: usize| match print.sheets() {
                    1 => out.to_owned(),
                    _ => {
                        let stem = out.file_stem().unwrap_or_default().to_string_lossy();
                        out.with_file_name(format!("{stem}-{number}.svg"))
                    }
                };
                let numbered = print.svgs().enumerate();
                numbered.map(|(index, text)| (named(index + 1), text.into_bytes())).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_that_the_file_has_is_not_added_again() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("targets.toml");
        let [lumbar, shoulder]: [TargetDescription; 2] =
            targets::standard_pair().try_into().unwrap();
        std::fs::write(&path, targets::to_toml(std::slice::from_ref(&lumbar))).unwrap();
        let refused = |target: &TargetDescription| {
            added(&path, std::slice::from_ref(target)).unwrap_err().to_string()
        };
        let named = |name: &str, of: &TargetDescription| TargetDescription {
            name: name.into(),
            ..of.clone()
        };
        for (target, parts) in [
            (lumbar.clone(), ["\"lumbar\" is in it already, the very same", "nothing to add"]),
            (named("lumbar", &shoulder), ["another target is called \"lumbar\"", "--name"]),
            (named("sacrum", &lumbar), ["\"lumbar\" has the role \"lower\" already", "--role"]),
        ] {
            let text = refused(&target);
            assert!(parts.iter().all(|part| text.contains(part)), "{text}");
        }
        let both = added(&path, &[shoulder]).unwrap();
        assert_eq!(targets::parse(&both, "").unwrap().targets.len(), 2);
    }
}
