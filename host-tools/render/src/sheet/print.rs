//! A print: targets of one pitch, on as many sheets as they need, as a file.

use plumbline_files::BadInput;
use plumbline_files::targets::{self, TargetDescription};

use super::layout::sheets;
use super::page::{Page, Paper};
use super::{pdf, svg};

/// The smallest square, mm. A printer's edges are off by up to 0.05 mm, already 2.5 % of it.
const PITCH_MM_MIN: f64 = 2.0;

/// The largest that the core takes.
const PITCH_MM_MAX: f64 = 500.0;

/// More than anybody would glue together.
const SHEETS_MAX: usize = 20;

/// Targets on their sheets.
#[derive(Debug, Clone, PartialEq)]
pub struct Print {
    pages: Vec<Page>,
    title: String,
    /// What should be known of these targets; one line each.
    pub warnings: Vec<String>,
}

impl Print {
    /// Of these targets, whose squares all measure `pitch_mm`.
    ///
    /// # Errors
    /// When the pitch is too small or too large to be printed, there would be too many sheets, or the
    /// targets cannot be tracked.
    pub fn new(
        descriptions: &[TargetDescription],
        pitch_mm: f64,
        paper: Paper,
    ) -> Result<Self, BadInput> {
        if !(PITCH_MM_MIN..=PITCH_MM_MAX).contains(&pitch_mm) {
            return Err(BadInput::whole(
                "--pitch-mm",
                format!("{pitch_mm} mm"),
                format!(
                    "give {PITCH_MM_MIN} to {PITCH_MM_MAX} mm: a printer's edges are not sharp enough for smaller squares"
                ),
            ));
        }
        let warnings = targets::check(descriptions, "--grid")?.warnings;
        let pages = sheets(descriptions, pitch_mm, paper);
        if pages.len() > SHEETS_MAX {
            return Err(BadInput::whole(
                "--pitch-mm",
                format!(
                    "{pitch_mm} mm needs {} sheets of {}, more than {SHEETS_MAX}",
                    pages.len(),
                    paper.name()
                ),
                "give a smaller pitch or fewer corners; a board as large as this is best made by a print shop, from the same geometry",
            ));
        }
        let names: Vec<&str> = descriptions.iter().map(|target| target.name.as_str()).collect();
        Ok(Self { pages, title: names.join(" and "), warnings })
    }

    /// The number of sheets.
    #[must_use]
    pub fn sheets(&self) -> usize {
        self.pages.len()
    }

    /// All sheets as one PDF file.
    #[must_use]
    pub fn pdf(&self) -> Vec<u8> {
        pdf::document(&self.pages, &self.title)
    }

    /// Each sheet as an SVG file.
    pub fn svgs(&self) -> impl Iterator<Item = String> + '_ {
        self.pages.iter().map(|page| svg::document(page, &self.title))
    }
}
