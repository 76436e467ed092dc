//! What `plumb target` prints, rendered by programs that are not the project's, is what
//! the tracker finds: each target upright, with the pitch of its targets.toml.
//!
//! A page is a picture of a plane that faces the camera. With the focal length of
//! [`DISTANCE_MM`] in the page's pixels, a print of the right scale is at that distance.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use common::binary;
use image::GrayImage;
use image::imageops::{blur, crop_imm, replace};
use nalgebra::Matrix3;
use plumbline_files::poses::{self, PoseRow};
use plumbline_files::targets;
use plumbline_render::simulate::render::Picture;
use plumbline_render::simulate::sensor::Sensor;
use tempfile::TempDir;

/// The synthetic camera sees an A4 page under 55 degrees, so that a tilt would show.
const DISTANCE_MM: f64 = 200.0;

/// Largest relative error of a length in a print. Ten times what the camera's noise makes
/// of it, and a tenth of what a ruler would show.
const SCALE_ERROR_MAX: f64 = 1e-4;

/// 5 pixels per millimetre: squares of 12 mm are as large as in a camera's picture.
const DPI: f64 = 127.0;

fn px(mm: f64, dpi: f64) -> f64 {
    mm * dpi / 25.4
}

/// A directory to print into.
struct Desk(TempDir);

impl Desk {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary directory"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, arguments: &str) -> Output {
        binary::plumb()
            .args(arguments.split_whitespace())
            .current_dir(self.0.path())
            .output()
            .expect("plumb runs")
    }

    /// Prints without an error; gives standard error.
    #[track_caller]
    fn print(&self, arguments: &str) -> String {
        let output = self.run(&format!("target {arguments}"));
        let text = binary::messages(&output);
        assert_eq!(output.status.code(), Some(0), "{text}");
        text
    }

    /// All pages of a PDF in grey.
    fn pdf_pages(&self, name: &str, dpi: f64) -> Vec<GrayImage> {
        let pages = self.path("pages");
        std::fs::create_dir(&pages).expect("a new directory");
        render(
            Command::new("pdftocairo")
                .args(["-png", "-gray", "-r", &dpi.to_string()])
                .arg(self.path(name))
                .arg(pages.join("page")),
        );
        let entries = std::fs::read_dir(&pages).expect("the directory is there");
        let mut paths: Vec<_> = entries.map(|entry| entry.expect("a file").path()).collect();
        paths.sort();
        let pages_read = paths.iter().map(|path| open(path)).collect();
        std::fs::remove_dir_all(&pages).expect("its files are closed");
        pages_read
    }

    fn svg_page(&self, name: &str, dpi: f64) -> GrayImage {
        let picture = self.path("page.png");
        let dpi = dpi.to_string();
        render(
            Command::new("rsvg-convert")
                .args(["--dpi-x", &dpi, "--dpi-y", &dpi, "--output"])
                .arg(&picture)
                .arg(self.path(name)),
        );
        open(&picture)
    }

    /// The poses of the targets of a targets file in a page.
    fn track(&self, page: &GrayImage, dpi: f64, targets: &str) -> Vec<PoseRow> {
        let (width, height) = page.dimensions();
        let focal_px = px(DISTANCE_MM, dpi);
        let (x, y) = (f64::from(width - 1) / 2.0, f64::from(height - 1) / 2.0);
        let camera = format!(
            "width_px = {width}\nheight_px = {height}\nfx_px = {focal_px}\nfy_px = {focal_px}\ncx_px = {x}\ncy_px = {y}\nmodel = \"radial2\"\ndistortion = [0.0, 0.0]\n"
        );
        std::fs::write(self.path("camera.toml"), camera).expect("room on the disk");
        photograph(page).save(self.path("tracked.png")).expect("room on the disk");
        let output = self.run(&format!(
            "track --camera camera.toml --targets {targets} --independent --force --out poses.csv tracked.png"
        ));
        let text = binary::messages(&output);
        assert_eq!(output.status.code(), Some(0), "{text}");
        poses::read(&self.path("poses.csv")).expect("plumb's own table")
    }

    /// Every target of the file is on the page, upright and at true scale; gives their places.
    #[track_caller]
    fn assert_printed(&self, page: &GrayImage, dpi: f64, file: &str) -> Vec<[f64; 2]> {
        let targets = targets::read(&self.path(file)).expect("plumb's own file").targets;
        let rows = self.track(page, dpi, file);
        assert_eq!(rows.len(), targets.len());
        let places = targets.iter().zip(&rows).map(|(target, row)| {
            let name = &target.name;
            let found = row.cam_from_target().unwrap_or_else(|| panic!("{name}: {}", row.state));
            let [x, y, z] = found.translation_mm.into();
            let scale = z / DISTANCE_MM;
            let turned_rad = (found.rotation - Matrix3::identity()).norm();
            assert!((scale - 1.0).abs() < SCALE_ERROR_MAX, "{name}: printed 1 / {scale} times");
            assert!(turned_rad < 0.005, "{name}: turned or tilted by {turned_rad} rad");
            // The square up and left of corner 0 is dark, and the margin around is white.
            let (first_mm, pitch_mm) = (target.geometry.corner_mm(0), target.geometry.pitch_mm());
            let grey = |[column, row]: [f64; 2]| {
                let at = |side: u32, mm: f64| (f64::from(side - 1) / 2.0 + px(mm, dpi)).round();
                let x = at(page.width(), x + first_mm.x + column * pitch_mm);
                let y = at(page.height(), y + first_mm.y + row * pitch_mm);
                page.get_pixel(x as u32, y as u32).0[0]
            };
            assert!(grey([-0.5, -0.5]) < 10, "{name}: the first square is not dark");
            for margin in [[-1.5, -1.5], [-1.9, 1.0], [1.0, -1.9], [0.5, -1.5]] {
                assert!(grey(margin) > 245, "{name}: the margin is not white at {margin:?}");
            }
            [x, y]
        });
        places.collect()
    }
}

/// The page as a camera sees it: a lens's blur, no full white and black, a sensor's noise.
fn photograph(page: &GrayImage) -> GrayImage {
    let grey = blur(page, 0.7).pixels().map(|pixel| 20.0 + f32::from(pixel.0[0]) * 0.8).collect();
    let (width, height) = page.dimensions();
    let picture = Picture { width: width as usize, height: height as usize, grey };
    let mut seen = GrayImage::new(width, height);
    Sensor { noise_levels: 2.0, bits: 8 }.expose(&picture, 1, 0, &mut seen);
    seen
}

/// Runs what makes a picture.
fn render(command: &mut Command) {
    let program = command.get_program().to_string_lossy().into_owned();
    let output = command.output().unwrap_or_else(|error| {
        panic!("{program}: {error}; `cargo xtask test native` installs it")
    });
    assert!(output.status.success(), "{program}: {}", String::from_utf8_lossy(&output.stderr));
}

fn open(path: &Path) -> GrayImage {
    image::open(path).expect("a picture").into_luma8()
}

fn is_dark(page: &GrayImage, x: u32, y: u32) -> bool {
    page.get_pixel(x, y).0[0] < 128
}

/// The middles of dark strokes along a line of pixels of the given darkness, 0 to 1.
fn strokes(darkness: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut middles = Vec::new();
    let (mut moment, mut weight) = (0.0, 0.0);
    for (place, dark) in darkness.into_iter().chain([0.0]).enumerate() {
        if dark > 0.05 {
            moment += dark * place as f64;
            weight += dark;
        } else if weight > 0.0 {
            middles.push(moment / weight);
            (moment, weight) = (0.0, 0.0);
        }
    }
    middles
}

fn darkness(page: &GrayImage, x: u32, y: u32) -> f64 {
    1.0 - f64::from(page.get_pixel(x, y).0[0]) / 255.0
}

/// The length in mm between the ends of the ruler that lies along x: the only line
/// on a page that is about 100 mm long and not interrupted.
fn ruler_mm(page: &GrayImage, dpi: f64) -> f64 {
    let (width, height) = page.dimensions();
    for y in 0..height {
        let dark: Vec<u32> = (0..width).filter(|x| is_dark(page, *x, y)).collect();
        for run in dark.chunk_by(|one, next| one + 1 == *next) {
            if !(95.0..105.0).contains(&(run.len() as f64 * 25.4 / dpi)) {
                continue;
            }
            // Only the strokes of whole centimetres are longer than 3 mm.
            let below = y + px(3.6, dpi).round() as u32;
            let [left, right] = [run[0] - 5, run[run.len() - 1] + 5];
            let lines = strokes((left..=right).map(|x| darkness(page, x, below)));
            assert_eq!(lines.len(), 11, "a line for each centimetre");
            return (lines[10] - lines[0]) * 25.4 / dpi;
        }
    }
    panic!("there is no ruler");
}

#[test]
fn the_standard_pair_is_tracked_from_pdf_and_svg_on_both_papers() {
    for (paper, size_mm) in [("a4", [210.0, 297.0]), ("letter", [215.9, 279.4])] {
        let desk = Desk::new();
        for out in ["pair.pdf", "pair.svg"] {
            desk.print(&format!(
                "--standard --paper {paper} --out {out} --targets targets.toml --force"
            ));
        }
        let pdf = desk.pdf_pages("pair.pdf", DPI);
        let [pdf] = &pdf[..] else { panic!("{} pages", pdf.len()) };
        let svg = desk.svg_page("pair.svg", DPI);
        for page in [pdf, &svg] {
            for (side_px, side_mm) in [page.width(), page.height()].into_iter().zip(size_mm) {
                assert!((f64::from(side_px) - px(side_mm, DPI)).abs() < 1.5, "{paper}");
            }
            let places = desk.assert_printed(page, DPI, "targets.toml");
            let [lumbar, shoulder] = &places[..] else { panic!("two targets") };
            // To be cut apart: half of 5 + 3 and of 4 + 3 squares of 12 mm, and more.
            assert!(shoulder[1] - lumbar[1] > 90.0, "the targets' margins overlap");
        }
    }
}

#[test]
fn the_ruler_is_true() {
    let desk = Desk::new();
    desk.print("--standard --out pair.pdf");
    desk.print("--standard --out pair.svg");
    for page in [&desk.pdf_pages("pair.pdf", 2.0 * DPI)[0], &desk.svg_page("pair.svg", 2.0 * DPI)] {
        let found_mm = ruler_mm(page, 2.0 * DPI);
        assert!((found_mm - 100.0).abs() < 100.0 * SCALE_ERROR_MAX, "{found_mm} mm");
    }
}

#[test]
fn a_board_that_fills_its_sheet_is_tracked() {
    for (paper, grid) in [("a4", "9x7"), ("letter", "9x7"), ("a4", "10x7"), ("a4", "6x9")] {
        let desk = Desk::new();
        let pitch_mm = if grid == "10x7" { 18.5 } else { 20.0 };
        let text = desk.print(&format!(
            "--grid {grid} --pitch-mm {pitch_mm} --paper {paper} --out board.pdf --targets board.toml"
        ));
        // Only such a grid looks the same after half a turn.
        assert_eq!(
            text.contains("warning: --grid: target \"board\": 9 x 7"),
            grid == "9x7",
            "{text}"
        );
        let pages = desk.pdf_pages("board.pdf", DPI);
        assert_eq!(pages.len(), 1, "{grid} on {paper}");
        desk.assert_printed(&pages[0], DPI, "board.toml");
    }
}

/// Where a mark of a sheet's frame lies, from the sheet's top left corner: the last
/// stroke along x or y through the frame, 10 mm from the paper's edge.
fn last_mark_px(page: &GrayImage, along_x: bool) -> u32 {
    let frame = px(10.0, DPI).round() as u32;
    let side = if along_x { page.width() } else { page.height() };
    let dark = |at| if along_x { darkness(page, at, frame) } else { darkness(page, frame, at) };
    let marks = strokes((0..side).map(dark));
    marks.last().expect("a mark in the frame").round() as u32
}

#[test]
fn squares_go_on_over_the_sheets_of_a_large_board() {
    let desk = Desk::new();
    // From one sheet to the next are whole pixels: 146 and 176 mm.
    desk.print("--grid 11x8 --pitch-mm 32 --out board.pdf --targets board.toml");
    let pages = desk.pdf_pages("board.pdf", DPI);
    assert_eq!(pages.len(), 1 + 2 * 3, "the sheet that explains, and those of the board");
    // As the first sheet says: cut the upper and left edge off where there is a neighbour, and
    // lay the sheet over its neighbours up to their marks.
    let cut = px(14.0, DPI).round() as u32;
    let sheets: Vec<&[GrayImage]> = pages[1..].chunks(3).collect();
    let [step_x, step_y] = [true, false].map(|along_x| last_mark_px(&sheets[0][0], along_x) - cut);
    let (width, height) = sheets[0][0].dimensions();
    let mut board = GrayImage::new(2 * step_x + width, step_y + height);
    let mut seams = (0, 0);
    for (row, sheets) in (0_u32..).zip(sheets) {
        for (column, sheet) in (0_u32..).zip(sheets) {
            let [left, top] = [column, row].map(|index| if index > 0 { cut } else { 0 });
            let part = crop_imm(sheet, left, top, width - left, height - top).to_image();
            let [x, y] = [column * step_x + left, row * step_y + top];
            // What the neighbour shows in the overlap is the same, but for a pixel at the edges.
            let overlap = px(9.5, DPI) as u32;
            let strip = if column > 0 { [overlap, step_y] } else { [0, 0] };
            for (dx, dy) in (0..strip[0]).flat_map(|dx| (1..strip[1]).map(move |dy| (dx, dy))) {
                seams.1 += 1;
                seams.0 += u32::from(is_dark(&board, x + dx, y + dy) != is_dark(&part, dx, dy));
            }
            replace(&mut board, &part, x.into(), y.into());
        }
    }
    let (different, compared) = seams;
    assert!(different * 1000 < compared, "{different} of {compared} pixels differ in the overlaps");
    desk.assert_printed(&board, DPI, "board.toml");
    let rms_px = desk.track(&board, DPI, "board.toml")[0].rms_px.expect("a pose");
    assert!(rms_px < 0.05, "squares are displaced by {rms_px} px");
}

#[test]
fn several_sheets_are_several_svg_files() {
    let desk = Desk::new();
    let text = desk.print("--grid 10x7 --pitch-mm 35 --out board.svg");
    assert!(text.contains("board.svg: 7 sheets of A4"), "{text}");
    for number in 1..=7 {
        assert!(desk.path(&format!("board-{number}.svg")).exists(), "sheet {number}");
    }
    let again = desk.run("target --grid 10x7 --pitch-mm 35 --out board.svg");
    assert_refused(&again, &["board-1.svg: exists already; ", "--force"]);
}

#[test]
fn the_entry_is_the_one_that_plumb_reads() {
    let desk = Desk::new();
    let output = desk.run("target --standard --out pair.pdf");
    assert_eq!(
        String::from_utf8_lossy(&output.stdout),
        targets::to_toml(&targets::standard_pair())
    );
    let output =
        desk.run("target --board 7x4 --pitch-mm 15.5 --name sacrum --role lower --out s.svg --targets s.toml");
    assert!(output.status.success() && output.stdout.is_empty());
    let read = targets::read(&desk.path("s.toml")).expect("plumb's own file");
    assert_eq!(read.warnings, Vec::<String>::new());
    let [target] = &read.targets[..] else { panic!("one target") };
    let geometry = &target.geometry;
    assert_eq!((target.name.as_str(), geometry.columns(), geometry.rows()), ("sacrum", 7, 4));
    assert_eq!((geometry.pitch_mm(), geometry.virtual_point_mm().z), (15.5, 100.0));
    // A letter that SVG writes in another way, and one that ASCII does not have.
    desk.print("--grid 7x4 --pitch-mm 15 --name <Hüfte> --out h.svg");
    let svg = std::fs::read_to_string(desk.path("h.svg")).expect("plumb's own file");
    assert!(svg.contains("&lt;Hüfte&gt;: 7 x 4 inner corners, pitch 15 mm"), "{svg}");
}

/// Exit code 2, and an error with all of `parts`.
#[track_caller]
fn assert_refused(output: &Output, parts: &[&str]) {
    let text = binary::messages(output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    for part in parts {
        assert!(text.contains(part), "no {part:?} in: {text}");
    }
    assert!(output.stdout.is_empty(), "an entry for a target that is not printed");
}

#[test]
fn what_cannot_be_printed_is_refused() {
    let desk = Desk::new();
    let cases: [(&str, &[&str]); 14] = [
        (
            "--grid 2x5 --pitch-mm 12",
            &[
                "--grid: columns, rows of target \"board\": 2 x 5; ",
                "INNER corners",
                "at least 3 x 3",
            ],
        ),
        ("--grid 13x10 --pitch-mm 12", &["13 x 10; ", "at most 120"]),
        ("--grid 6 --pitch-mm 12", &["'6' for '--grid <COLUMNSxROWS>'", "such as 6x5"]),
        ("--grid 6x-5 --pitch-mm 12", &["'6x-5'", "such as 6x5"]),
        ("--grid 6x5 --pitch-mm 0.8", &["--pitch-mm: 0.8 mm; give 2 to 500 mm"]),
        ("--grid 6x5 --pitch-mm nan", &["--pitch-mm: NaN mm; "]),
        ("--grid 6x5 --pitch-mm 900", &["--pitch-mm: 900 mm; give 2 to 500 mm"]),
        (
            "--grid 6x5 --pitch-mm 200",
            &["--pitch-mm: 200 mm needs ", "sheets of A4, more than 20; give a smaller pitch"],
        ),
        ("--grid 6x5", &["--pitch-mm <MM>"]),
        ("--grid 6x5 --pitch-mm 12 --paper a3", &["'a3' for '--paper <PAPER>'", "a4, letter"]),
        (
            "--grid 6x5 --pitch-mm 12 --role head",
            &["'head' for '--role <ROLE>'", "lower, upper, scene"],
        ),
        ("--grid 6x5 --pitch-mm 12 --name Βάση", &["--name: \"Βάση\"; ", "Latin letters"]),
        ("--standard --name mine", &["'--standard' cannot be used with '--name <NAME>'"]),
        ("", &["--standard"]),
    ];
    for (arguments, parts) in cases {
        assert_refused(&desk.run(&format!("target {arguments} --out x.pdf")), parts);
        assert!(!desk.path("x.pdf").exists(), "{arguments}");
    }
    let output = desk.run("target --standard --out pair.png");
    assert_refused(&output, &["--out: pair.png ends neither in .pdf nor in .svg; "]);
    std::fs::write(desk.path("taken"), "").unwrap();
    let output = desk.run("target --standard --out taken/pair.pdf");
    assert_refused(&output, &["taken", "a file is in its place"]);
}

#[test]
fn nothing_is_replaced_without_force() {
    let desk = Desk::new();
    std::fs::write(desk.path("targets.toml"), "mine").expect("room on the disk");
    let output = desk.run("target --standard --out pair.pdf --targets targets.toml");
    assert_refused(&output, &["targets.toml: exists already; give another name, or --force"]);
    assert!(!desk.path("pair.pdf").exists(), "all the files or none");
    desk.print("--standard --out pair.pdf --targets targets.toml --force");
    targets::read(&desk.path("targets.toml")).expect("plumb's own file");
}
