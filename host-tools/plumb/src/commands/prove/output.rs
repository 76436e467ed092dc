//! What every proof leaves: a page, the same figures as JSON, and a few lines on the terminal.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use maud::{Markup, html};
use plumbline_files::{BadInput, refuse_overwriting, write_all};
use plumbline_report::page::{facts, page, warnings};
use serde::Serialize;

use super::recording::Recording;
use super::source::Input;

/// Where a proof is written.
#[derive(Debug, clap::Args)]
pub struct Output {
    /// The page; the figures are written beside it, with the ending .json [default: named after
    /// the proof, in this directory]
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
    /// Replace these files if they exist.
    #[arg(long)]
    force: bool,
}

/// A proof that was made.
pub struct Proof<'a, R> {
    /// `repeatability`, `distance` or `step`.
    pub name: &'static str,
    /// The page's heading.
    pub title: &'static str,
    /// What was found, in a sentence each.
    pub findings: Vec<String>,
    /// What a reader has to know before anything else.
    pub warnings: Vec<String>,
    /// What to do next, in one sentence.
    pub next: String,
    /// What was recorded.
    pub facts: Vec<(&'static str, String)>,
    /// The rest of the page.
    pub body: Markup,
    /// All figures.
    pub figures: &'a R,
}

/// The figures as they are written.
#[derive(Serialize)]
struct Written<'a, R> {
    proof: &'static str,
    program: String,
    inputs: Vec<String>,
    camera: Camera,
    findings: &'a [String],
    warnings: &'a [String],
    figures: &'a R,
}

/// The camera, so that a published proof says of what it is.
#[derive(Serialize)]
struct Camera {
    width_px: u16,
    height_px: u16,
    fx_px: f64,
    fy_px: f64,
    distortion: String,
}

impl Output {
    /// Checks before any work that nothing is in the way.
    ///
    /// # Errors
    /// When an output is one of the inputs, or exists and may not be replaced, or page and figures
    /// would be one file.
    pub fn check(&self, name: &str, input: &Input) -> Result<(), BadInput> {
        let [page, figures] = self.paths(name);
        if page == figures {
            let remedy = "give the page's name, which ends in .html; the figures are beside it";
            return Err(BadInput::whole(
                "--out",
                format!("{} names the figures", page.display()),
                remedy,
            ));
        }
        for path in [page, figures] {
            refuse_overwriting(&path, input.paths())?;
            if path.exists() && !self.force {
                let remedy = "give another --out, or --force to replace it";
                return Err(BadInput::whole(path.display(), "exists already", remedy));
            }
        }
        Ok(())
    }

    /// The page, and the figures beside it.
    fn paths(&self, name: &str) -> [PathBuf; 2] {
        let page = self.out.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.html")));
        let figures = page.with_extension("json");
        [page, figures]
    }

    /// Writes the page and the figures, and says what was found and what to do next.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write<R: Serialize>(
        &self,
        recordings: &[Recording],
        proof: &Proof<'_, R>,
    ) -> Result<(), BadInput> {
        let paths = self.paths(proof.name);
        let contents = [whole_page(recordings, proof), json(recordings, proof)?];
        let outputs: Vec<(PathBuf, Vec<u8>)> =
            paths.iter().cloned().zip(contents.map(String::into_bytes)).collect();
        write_all(&outputs, self.force)?;
        for warning in &proof.warnings {
            eprintln!("warning: {warning}");
        }
        // A closed pipe must not hide the result.
        let _ = said(&paths[0], &proof.findings, &proof.next);
        Ok(())
    }
}

fn said(page: &Path, findings: &[String], next: &str) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    for finding in findings {
        writeln!(out, "{finding}")?;
    }
    writeln!(out, "Next: {next}")?;
    writeln!(out, "{}: open it in a browser", page.display())
}

fn whole_page<R>(recordings: &[Recording], proof: &Proof<'_, R>) -> String {
    let lens = &recordings[0].lens;
    let mut known = proof.facts.clone();
    known.push((
        "camera calibration",
        format!("{} x {} px, f {:.1} px", lens.width_px, lens.height_px, lens.fx_px),
    ));
    let body = html! {
        (facts(&known))
        (warnings(&proof.warnings))
        section {
            h2 { "Result" }
            ul { @for finding in &proof.findings { li { (finding) } } }
            p { strong { "Next: " } (with_code(&proof.next)) }
        }
        (proof.body)
    };
    page(proof.title, &places(recordings).join(", "), &body)
}

/// Text in which what is typed stands in backticks.
fn with_code(text: &str) -> Markup {
    html! {
        @for (at, part) in text.split('`').enumerate() {
            @if at % 2 == 1 { code { (part) } } @else { (part) }
        }
    }
}

fn json<R: Serialize>(recordings: &[Recording], proof: &Proof<'_, R>) -> Result<String, BadInput> {
    let lens = &recordings[0].lens;
    let written = Written {
        proof: proof.name,
        program: format!("plumb {}", env!("CARGO_PKG_VERSION")),
        inputs: places(recordings),
        camera: Camera {
            width_px: lens.width_px,
            height_px: lens.height_px,
            fx_px: lens.fx_px,
            fy_px: lens.fy_px,
            distortion: format!("{:?}", lens.distortion),
        },
        findings: &proof.findings,
        warnings: &proof.warnings,
        figures: proof.figures,
    };
    let text = serde_json::to_string_pretty(&written)
        .map_err(|error| BadInput::whole("the figures", error, "report it"))?;
    Ok(text + "\n")
}

fn places(recordings: &[Recording]) -> Vec<String> {
    recordings.iter().map(|it| it.place.clone()).collect()
}

/// Parses a length of more than 0 mm.
///
/// # Errors
/// The text says what to give instead.
pub fn millimetres(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "give a number of millimetres".to_owned())?;
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err("give more than 0 mm".to_owned()) }
}
