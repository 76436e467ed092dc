//! Reports as a real browser shows them: whole, by themselves, on wide and narrow screens, by day
//! and by night, and on paper.

use crate::common::trial;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::browser::{Browser, Shown, WIDTHS_PX};
use crate::common::finished::plumb;
use crate::common::trial::Frame;

const RATE_HZ: f64 = 30.0;

/// Three bins of 20 s, and some seconds before and after.
const SECONDS: f64 = 66.0;

/// The mean grey of a page with some lines on it, of 255: white paper is 255, dark 25.
const LIGHT: RangeInclusive<f64> = 225.0..=255.0;
const DARK: RangeInclusive<f64> = 20.0..=60.0;

fn sway_mm(time_s: f64, by: f64) -> [f64; 3] {
    let sine = |hz: f64, mm: f64| by * mm * (TAU * hz * time_s).sin();
    [sine(0.11, 9.0) + sine(0.7, 1.0), sine(0.17, 5.0) + sine(0.9, 0.5), 900.0 + sine(0.23, 0.5)]
}

/// The page of a trial with gaps, with events close to each other and with a reference.
fn trial_page(folder: &Path) -> PathBuf {
    let frames = (0..(RATE_HZ * SECONDS) as u32).filter_map(|sequence| {
        let time_s = f64::from(sequence) / RATE_HZ;
        // More than a second is lost, and a single frame; another one has no lower trunk.
        let lost = (30.0..31.2).contains(&time_s) || sequence == 1500;
        let lower_mm = (sequence != 1600).then(|| sway_mm(time_s, 1.0));
        let upper_mm = Some(sway_mm(time_s, 1.5));
        (!lost).then_some(Frame { sequence, time_s, lower_mm, upper_mm })
    });
    let marks = [(3.0, "stands"), (4.0, "arms crossed"), (4.5, "eyes closed"), (64.0, "sits down")];
    trial::write(&folder.join("p01"), &frames.collect::<Vec<_>>(), &marks);
    let mut reference = "t,x,y,z\n".to_owned();
    for at in 0..(100.0 * SECONDS) as u32 {
        let time_s = f64::from(at) / 100.0;
        let [x, y, z] = sway_mm(time_s, 1.01);
        writeln!(reference, "{time_s},{x},{y},{z}").unwrap();
    }
    std::fs::write(folder.join("mocap.csv"), reference).unwrap();
    let report = ["report", "p01", "--reference", "mocap.csv", "--columns"];
    let done = plumb(folder, &[&report[..], &["time=t,ap=x,ml=y,si=z", "--unit", "mm"]].concat());
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    assert_eq!(done.stdout, "p01/report.html: open it in a browser\n");
    folder.join("p01/report.html")
}

/// The page of a study of three persons under two conditions.
fn study_page(folder: &Path) -> PathBuf {
    let mut study = "title = \"Standing up\"\nconditions = [\"control\", \"tilted\"]\n".to_owned();
    for person in 1..=3 {
        for (condition, by) in [("control", 1.0), ("tilted", 1.3)] {
            let by = by + 0.1 * f64::from(person);
            let mut table = "t,x,y,z\n".to_owned();
            for at in 0..1240 {
                let time_s = f64::from(at) / 20.0;
                // Persons differ otherwise than by a factor.
                let [x, y, z] = sway_mm(time_s + f64::from(person * person), by);
                writeln!(table, "{time_s},{x},{y},{z}").unwrap();
            }
            let file = format!("{person}-{condition}.csv");
            std::fs::write(folder.join(&file), table).unwrap();
            write!(
                study,
                "[[trial]]\ntable = \"{file}\"\ncolumns = \"time=t,ap=x,ml=y,si=z\"\n\
                 unit = \"mm\"\nparticipant = \"P{person}\"\ncondition = \"{condition}\"\n"
            )
            .unwrap();
        }
    }
    std::fs::write(folder.join("study.toml"), study).unwrap();
    let done = plumb(folder, &["report", "study.toml"]);
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    folder.join("report.html")
}

/// Opens a page with so many figures, prints it on so many sheets and looks for words on them.
#[track_caller]
pub fn assert_shown(
    browser: &Browser,
    page: &Path,
    figures: usize,
    sheets: RangeInclusive<usize>,
    words: &[&str],
) {
    let shown = browser.show(page);
    assert_eq!(shown.console, [""; 0]);
    assert_eq!(shown.layouts.len(), WIDTHS_PX.len());
    for (layout, width) in shown.layouts.iter().zip(WIDTHS_PX) {
        assert_eq!(layout.client_width, f64::from(width));
        assert!(layout.scroll_width <= layout.client_width, "{layout:?}");
        assert_eq!(layout.requests, [""; 0]);
        assert_eq!(layout.figures.len(), figures);
        // At 400 px the narrowest is as wide as the page, at 1280 px a third of it.
        let seen = |it: &[f64; 2]| it[0] > 300.0 && it[1] > 150.0;
        assert!(layout.figures.iter().all(seen), "{layout:?}");
    }
    let sheet = first_sheet(&shown.paper);
    for (picture, bounds) in [(&shown.light, LIGHT), (&shown.dark, DARK), (&sheet, LIGHT)] {
        let grey = mean(picture);
        assert!(bounds.contains(&grey), "{grey} is not in {bounds:?}");
    }
    let texts = on_paper(&shown.paper);
    assert!(sheets.contains(&texts.len()), "{} sheets", texts.len());
    for text in &texts {
        // A plot and its caption are on one sheet.
        let count = |words: &str| text.matches(words).count();
        assert_eq!(count("mean of both (mm)"), count("Bland-Altman:"), "{text}");
    }
    let text = texts.concat();
    for word in words {
        assert!(text.contains(word), "no {word} in {text}");
    }
}

fn mean(picture: &image::GrayImage) -> f64 {
    let sum: u64 = picture.pixels().map(|it| u64::from(it.0[0])).sum();
    sum as f64 / f64::from(picture.width() * picture.height())
}

fn first_sheet(pdf: &Path) -> image::GrayImage {
    let picture = pdf.with_extension("png");
    let mut command = Command::new("pdftocairo");
    command.args(["-png", "-gray", "-r", "50", "-singlefile"]).arg(pdf);
    let done = command.arg(picture.with_extension("")).status();
    assert!(done.is_ok_and(|it| it.success()), "pdftocairo: `cargo xtask test` installs it");
    image::open(&picture).unwrap().to_luma8()
}

/// The text of each page of a PDF. Every word lies within its page.
#[track_caller]
fn on_paper(pdf: &Path) -> Vec<String> {
    let output = Command::new("pdftotext").arg("-bbox").arg(pdf).arg("-").output();
    let output = output.expect("pdftotext, which `cargo xtask test` installs");
    assert!(output.status.success(), "{output:?}");
    let boxes = String::from_utf8(output.stdout).unwrap();
    let number = |line: &str, name: &str| -> f64 {
        let (_, rest) = line.split_once(&format!(" {name}=\"")).unwrap();
        rest.split_once('"').unwrap().0.parse().unwrap()
    };
    let (mut sheets, mut width) = (Vec::<String>::new(), 0.0);
    for line in boxes.lines().map(str::trim) {
        if line.starts_with("<page ") {
            width = number(line, "width");
            sheets.push(String::new());
        } else if line.starts_with("<word ") {
            assert!(number(line, "xMin") >= 0.0 && number(line, "xMax") <= width, "{line}");
            let word = line.split_once('>').unwrap().1.split_once("</word>").unwrap().0;
            let sheet = sheets.last_mut().expect("words are on pages");
            *sheet += word;
            sheet.push(' ');
        }
    }
    sheets
}

#[test]
fn a_trial_is_shown_on_screens_and_on_paper() {
    let Some(browser) = Browser::new() else { return };
    let folder = tempfile::tempdir().unwrap();
    let page = trial_page(folder.path());
    // Of two trunks three planes, three axes and the spectra; of three axes two of agreement. A
    // sheet holds four wide figures or two tables.
    let words = [
        "arms crossed 1.000",
        "Gaps: 26.97 to 28.20 s (1.23 s)",
        "95 % ellipse: area (mm²)",
        "coronal covered",
        "Agreement with motion capture",
        "at which both correlate most",
        "upper limit (mm)",
        "effective samples",
    ];
    assert_shown(&browser, &page, 2 * 7 + 3 * 2, 5..=10, &words);
}

#[test]
fn a_study_is_shown_on_screens_and_on_paper() {
    let Some(browser) = Browser::new() else { return };
    let folder = tempfile::tempdir().unwrap();
    let page = study_page(folder.path());
    let text = std::fs::read_to_string(&page).unwrap();
    let figures = text.matches("<figure").count();
    // Path lengths in three directions and three planes, at least.
    assert!(figures >= 6, "{figures}");
    // The words of a heading may stand in lines of their own.
    let words = ["AP T1", "ANOVA-type", "Shapiro-Wilk", "MLSI: control to tilted T3"];
    assert_shown(&browser, &page, figures, 2..=10, &words);
}

/// What the browser says of a page that has all the faults.
#[test]
fn the_faults_of_a_page_are_found() {
    let Some(browser) = Browser::new() else { return };
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("page.html");
    let text = "<!DOCTYPE html><body style=\"background: #777\"><figure><svg width=0></svg></figure>\
                <div style=\"width: 1000px\">wide</div><img src=\"http://127.0.0.1:9/x.png\">\
                <script>nothing();</script>";
    std::fs::write(&page, text).unwrap();
    let Shown { layouts, console, dark, .. } = browser.show(&page);
    // At each width, its error.
    let errors = console.iter().filter(|it| it.contains("nothing is not defined")).count();
    assert_eq!(errors, WIDTHS_PX.len(), "{console:?}");
    assert_eq!(layouts.len(), WIDTHS_PX.len());
    for layout in &layouts {
        assert_eq!(layout.requests, ["http://127.0.0.1:9/x.png"]);
        assert_eq!(layout.figures.len(), 1);
        assert_eq!(layout.figures[0][0], 0.0);
    }
    assert!(layouts[0].scroll_width <= layouts[0].client_width, "{:?}", layouts[0]);
    assert!(layouts[1].scroll_width > 1000.0, "{:?}", layouts[1]);
    let grey = mean(&dark);
    assert!(!LIGHT.contains(&grey) && !DARK.contains(&grey), "{grey}");
}
