//! A page in a real browser, Chromium without a window: what it is like, how it looks, and how it is
//! printed.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use image::GrayImage;
use plumbline_test_support::{Absent, chromium, is_emulated, python, skip};
use serde::Deserialize;

/// Widths at which a page is looked at, px: of a screen, and of a telephone.
pub const WIDTHS_PX: [u32; 2] = [1280, 400];

/// What a page is like at one width, px.
#[derive(Debug, Deserialize)]
pub struct Layout {
    pub client_width: f64,
    pub scroll_width: f64,
    /// Width and height of the drawing in each figure.
    pub figures: Vec<[f64; 2]>,
    /// What the page has asked for.
    pub requests: Vec<String>,
}

/// A page as its readers see it.
pub struct Shown {
    /// At each of [`WIDTHS_PX`].
    pub layouts: Vec<Layout>,
    /// What was said on the console at all of them.
    pub console: Vec<String>,
    /// To a reader who prefers light pages, and to one who prefers dark ones.
    pub light: GrayImage,
    pub dark: GrayImage,
    /// As the latter prints it.
    pub paper: PathBuf,
    _folder: tempfile::TempDir,
}

/// The browser, and the Python that drives it.
pub struct Browser {
    chromium: PathBuf,
    python: PathBuf,
}

impl Browser {
    /// `None`, with the test recorded as skipped, where one of them is missing, or where the page is made
    /// on another processor: pages are the same on every processor.
    pub fn new() -> Option<Self> {
        if is_emulated() {
            skip(Absent::Emulator, "the pages are the same on every processor");
            return None;
        }
        Some(Self { chromium: chromium()?, python: python()? })
    }

    /// Opens a page, and prints it.
    #[track_caller]
    pub fn show(&self, page: &Path) -> Shown {
        #[derive(Deserialize)]
        struct Said {
            layouts: Vec<Layout>,
            console: Vec<String>,
        }

        let folder = tempfile::tempdir().unwrap();
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/common/browser.py");
        let mut command = Command::new(&self.python);
        command.arg(script).arg(&self.chromium).args([page, folder.path()]).stdin(Stdio::null());
        let done = command.args(WIDTHS_PX.map(|it| it.to_string())).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let Said { layouts, console } = serde_json::from_slice(&done.stdout).unwrap();
        let picture = |name: &str| image::open(folder.path().join(name)).unwrap().to_luma8();
        let [light, dark] = ["light.png", "dark.png"].map(picture);
        let paper = folder.path().join("page.pdf");
        Shown { layouts, console, light, dark, paper, _folder: folder }
    }
}
