//! A page in a real browser, Chromium without a window: what it reports of the page, how it looks,
//! and how it is printed.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use image::GrayImage;
use plumbline_test_support::{Absent, skip};
use serde::Deserialize;

/// A browser that takes longer hangs; it usually takes two seconds.
const PATIENCE: Duration = Duration::from_secs(60);

/// Widths at which a page is looked at, px: of a screen, and of a telephone.
pub const WIDTHS_PX: [u32; 2] = [1280, 400];

/// A window that shows the upper part of a page.
const SCREEN_PX: [u32; 2] = [1280, 2400];

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

/// A page and what its reader has set.
pub struct Browser {
    program: PathBuf,
    folder: tempfile::TempDir,
}

impl Browser {
    /// `None` where there is none.
    pub fn new() -> Option<Self> {
        let paths = std::env::var_os("PATH")?;
        let program = std::env::split_paths(&paths).map(|it| it.join("chromium"));
        match program.into_iter().find(|it| it.is_file()) {
            Some(program) => Some(Self { program, folder: tempfile::tempdir().unwrap() }),
            None => {
                skip(Absent::Tool, "there is no chromium; `cargo xtask test` installs it");
                None
            }
        }
    }

    /// Shows a page; gives its elements after its scripts, and what the console says.
    fn show(&self, page: &Path, more: &[String]) -> (String, Vec<String>) {
        let [output, log] = ["output", "log"].map(|name| self.folder.path().join(name));
        let mut command = Command::new(&self.program);
        command
            .args(["--headless", "--disable-gpu", "--no-first-run", "--hide-scrollbars"])
            // In a container its sandbox has no rights; the pages are this project's own.
            .arg("--no-sandbox")
            // Nothing but the page asks for anything.
            .args(["--disable-background-networking", "--disable-component-update"])
            .args(["--disable-sync", "--disable-quic", "--no-pdf-header-footer"])
            .args(["--enable-logging=stderr", "--dump-dom"])
            .arg(format!("--user-data-dir={}", self.folder.path().join("profile").display()))
            .args(more)
            .arg(format!("file://{}", page.canonicalize().unwrap().display()))
            .stdin(Stdio::null())
            .stdout(File::create(&output).unwrap())
            .stderr(File::create(&log).unwrap());
        let mut child = command.spawn().unwrap();
        let give_up = Instant::now() + PATIENCE;
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break Some(status);
            }
            if Instant::now() > give_up {
                break None;
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        if status.is_none() {
            child.kill().unwrap();
            child.wait().unwrap();
        }
        let log = String::from_utf8_lossy(&std::fs::read(&log).unwrap()).into_owned();
        assert!(status.is_some_and(|it| it.success()), "{command:?}: {status:?}\n{log}");
        let console = log.lines().filter(|line| line.contains(":CONSOLE"));
        (std::fs::read_to_string(&output).unwrap(), console.map(str::to_owned).collect())
    }

    /// The page as it is at each of [`WIDTHS_PX`], and what the console says. It stands in frames
    /// of these widths, untouched: a window is never narrower than 500 px.
    pub fn layouts(&self, page: &Path) -> (Vec<Layout>, Vec<String>) {
        let text = std::fs::read_to_string(page).unwrap();
        let text = text.replace('&', "&amp;").replace('"', "&quot;");
        let frames = WIDTHS_PX
            .map(|width| format!("<iframe width={width} height=900 srcdoc=\"{text}\"></iframe>"));
        let script = r#"
            const box = it => { const { width, height } = it.getBoundingClientRect(); return [width, height]; };
            const layout = ({ contentDocument: page, contentWindow: its }) => ({
                client_width: page.documentElement.clientWidth,
                scroll_width: page.documentElement.scrollWidth,
                figures: [...page.querySelectorAll("figure")].map(it => box(it.querySelector("svg"))),
                requests: its.performance.getEntriesByType("resource").map(it => it.name),
            });
            addEventListener("load", () => {
                const layouts = [...document.querySelectorAll("iframe")].map(layout);
                document.body.textContent = "BEGIN" + JSON.stringify(layouts) + "END";
            });"#;
        let probe = self.folder.path().join("probe.html");
        let style = "<style>iframe { border: 0 }</style>";
        let html = format!("<!DOCTYPE html>{style}<script>{script}</script>{}", frames.concat());
        std::fs::write(&probe, html).unwrap();
        let (elements, console) = self.show(&probe, &[]);
        let json = elements.rsplit_once("BEGIN").and_then(|(_, it)| it.split_once("END"));
        let (json, _) = json.unwrap_or_else(|| panic!("no answer: {console:?}"));
        let json = json.replace("&amp;", "&");
        (serde_json::from_str(&json).unwrap(), console)
    }

    /// The page as a reader sees it who prefers dark pages, or does not.
    pub fn picture(&self, page: &Path, dark: bool) -> GrayImage {
        let picture = self.folder.path().join("page.png");
        let [width, height] = SCREEN_PX;
        self.show(
            page,
            &[
                format!("--window-size={width},{height}"),
                // Of Chromium's own enumeration.
                format!("--blink-settings=preferredColorScheme={}", if dark { 0 } else { 1 }),
                format!("--screenshot={}", picture.display()),
            ],
        );
        image::open(&picture).unwrap().to_luma8()
    }

    /// The page on paper.
    pub fn print(&self, page: &Path) -> PathBuf {
        let paper = self.folder.path().join("page.pdf");
        // Paper is white, whatever its reader prefers on a screen.
        let dark = "--blink-settings=preferredColorScheme=0".to_owned();
        self.show(page, &[dark, format!("--print-to-pdf={}", paper.display())]);
        paper
    }
}
