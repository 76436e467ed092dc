//! `plumb optics`: which camera, lens and light for which distance.

mod thin_lens;

use std::io::Write as _;

use clap::Args;
use plumbline_bedside::bounds::PITCH_PX_MIN;
use plumbline_study::grid::Grid;

use thin_lens::Optics;

/// Choose a camera, a lens and the light: what they see, how sharply, and whether it will do.
///
/// Without options it lists cameras and lenses that suit a person of up to 1.9 m at 1 m. With
/// --sensor, --pixel-um and --focal-mm it says the same of yours. These are estimates (a thin lens);
/// `plumb aim` and `plumb doctor` look at the real picture.
///
/// Exit code 0: every camera shown will do; 1: one will not; 2: a wrong command line.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  plumb optics
  plumb optics --sensor 1920x1200 --pixel-um 3.0 --focal-mm 8 --distance-mm 1400
  plumb optics --sensor 1456x1088 --pixel-um 3.45 --focal-mm 6 --f-number 4 --exposure-ms 8")]
pub struct Arguments {
    /// Columns and rows of the sensor
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size, requires_all = ["pixel_um", "focal_mm"])]
    sensor: Option<[u16; 2]>,
    /// The side of a pixel, micrometres: in the sensor's data sheet
    #[arg(long, value_name = "UM", value_parser = between(0.5, 50.0), requires = "sensor")]
    pixel_um: Option<f64>,
    /// The lens's focal length
    #[arg(long, value_name = "MM", value_parser = between(0.5, 500.0), requires = "sensor")]
    focal_mm: Option<f64>,
    /// The aperture as the lens has it engraved: focal length over diameter
    #[arg(long, value_name = "N", value_parser = between(0.5, 32.0), default_value_t = F_NUMBER)]
    f_number: f64,
    /// From the camera to the person's back
    #[arg(long, value_name = "MM", value_parser = between(200.0, 10_000.0), default_value_t = DISTANCE_MM)]
    distance_mm: f64,
    /// How long a frame is exposed
    #[arg(long, value_name = "MS", value_parser = between(0.01, 100.0), default_value_t = EXPOSURE_MS)]
    exposure_ms: f64,
    /// The side of the targets' squares
    #[arg(long, value_name = "MM", value_parser = between(2.0, 500.0), default_value_t = PITCH_MM)]
    pitch_mm: f64,
}

const F_NUMBER: f64 = 2.8;
const DISTANCE_MM: f64 = 1000.0;
const EXPOSURE_MS: f64 = 4.0;
/// Of the standard pair.
const PITCH_MM: f64 = 12.0;

/// The height that has to be seen: 455 mm from the lumbar target's centre to the shoulder's in a
/// person of 1.9 m, half of each print with its margin (48 and 42 mm), and 25 mm on either side
/// for sway and for aiming.
const HEIGHT_MM_MIN: f64 = 455.0 + 48.0 + 42.0 + 2.0 * 25.0;
/// How far a person sways, forward and backward of the distance.
const SWAY_MM: f64 = 100.0;
/// Brisk sway: three standard deviations of the velocity of a person who is unsteady.
const SPEED_MM_S: f64 = 40.0;
/// More smear than half of a pixel blurs the edges visibly beside the lens's own blur.
const SMEAR_PX_MAX: f64 = 0.5;
/// The noise for which this program's figures hold.
const NOISE_LEVELS: f64 = 2.0;

/// Cameras and lenses that suit a distance of 1 m: sensor, its pixels, and the focal length.
const SUITABLE: [(&str, [u16; 2], f64, f64); 4] = [
    ("Raspberry Pi Global Shutter (IMX296)", [1456, 1088], 3.45, 6.0),
    ("OV9281", [1280, 800], 3.0, 3.8),
    ("AR0234", [1920, 1200], 3.0, 6.0),
    ("IMX264", [2448, 2048], 3.45, 8.0),
];

/// Runs the subcommand. Gives whether every camera shown will do.
pub fn run(arguments: &Arguments) -> bool {
    let own = arguments.sensor.zip(arguments.pixel_um).zip(arguments.focal_mm);
    let optics = |size_px, pixel_um, focal_mm| Optics {
        size_px,
        pixel_um,
        focal_mm,
        f_number: arguments.f_number,
        distance_mm: arguments.distance_mm,
        exposure_ms: arguments.exposure_ms,
    };
    let (text, will_do) = match own {
        Some(((size_px, pixel_um), focal_mm)) => {
            of_one(&optics(size_px, pixel_um, focal_mm), arguments.pitch_mm)
        }
        None => {
            let all = SUITABLE.map(|(name, size_px, pixel_um, focal_mm)| {
                (name, optics(size_px, pixel_um, focal_mm))
            });
            list(&all, arguments.pitch_mm)
        }
    };
    // A closed pipe must not hide the result.
    let _ = write!(std::io::stdout(), "{text}");
    will_do
}

/// A line for each camera, what is amiss with those that will not do at another distance, aperture,
/// exposure or pitch than the list was made for, and whether all will do.
fn list(cameras: &[(&str, Optics)], pitch_mm: f64) -> (String, bool) {
    let mut text = table(cameras, pitch_mm).text();
    let mut will_do = true;
    for (name, optics) in cameras {
        let (seen, does) = of_one(optics, pitch_mm);
        will_do &= does;
        for line in seen.lines().filter(|line| line.starts_with("FAIL")) {
            text += &format!("{name}: {line}\n");
        }
    }
    (text, will_do)
}

/// A line for each camera.
fn table(cameras: &[(&str, Optics)], pitch_mm: f64) -> Grid {
    let header = [
        "sensor",
        "pixels",
        "pixel (um)",
        "lens (mm)",
        "sees (mm)",
        "square (px)",
        "sharp from, to (mm)",
        "light (lx)",
    ];
    let rows = cameras.iter().map(|(name, optics)| {
        let ([columns, rows], [width, height]) = (optics.size_px, optics.field_mm());
        let [near, far] = optics.sharp_mm();
        vec![
            (*name).to_owned(),
            format!("{columns} x {rows}"),
            optics.pixel_um.to_string(),
            format!("{} f/{}", optics.focal_mm, optics.f_number),
            format!("{width:.0} x {height:.0}"),
            format!("{:.0}", optics.px_of(pitch_mm)),
            format!("{near:.0}, {far:.0}"),
            format!("{:.0}", rounded(optics.lux_for(NOISE_LEVELS))),
        ]
    });
    Grid { header: header.map(str::to_owned).to_vec(), rows: rows.collect() }
}

/// To two digits: an estimate has no more.
fn rounded(value: f64) -> f64 {
    let step = 10.0_f64.powf(value.log10().floor() - 1.0);
    (value / step).round() * step
}

/// What a camera sees, each line with what is needed; and whether that is met.
fn of_one(optics: &Optics, pitch_mm: f64) -> (String, bool) {
    let [width, height] = optics.field_mm();
    let [near, far] = optics.sharp_mm();
    let (z_mm, square_px) = (optics.distance_mm, optics.px_of(pitch_mm));
    let smear_px = optics.smear_px(SPEED_MM_S);
    let lines = [
        (
            height >= HEIGHT_MM_MIN,
            format!("sees {width:.0} x {height:.0} mm at {z_mm:.0} mm"),
            format!("at least {HEIGHT_MM_MIN:.0} high, for both targets on a person of 1.9 m"),
            "go farther away, or take a shorter focal length",
        ),
        (
            square_px >= f64::from(PITCH_PX_MIN),
            format!("a square of {pitch_mm} mm takes {square_px:.1} px"),
            format!("at least {PITCH_PX_MIN}"),
            "go nearer, take a longer focal length, or print larger targets",
        ),
        (
            near <= z_mm - SWAY_MM && far >= z_mm + SWAY_MM,
            format!("sharp from {near:.0} to {far:.0} mm at f/{}", optics.f_number),
            format!("{:.0} to {:.0}", z_mm - SWAY_MM, z_mm + SWAY_MM),
            "close the aperture by a step",
        ),
        (
            smear_px <= SMEAR_PX_MAX,
            format!(
                "{SPEED_MM_S} mm/s are smeared over {smear_px:.2} px in {} ms",
                optics.exposure_ms
            ),
            format!("at most {SMEAR_PX_MAX}"),
            "expose for a shorter time",
        ),
    ];
    let mut text = format!("focal length {:.0} px\n", optics.focal_px());
    for (is_met, seen, needed, remedy) in &lines {
        let verdict = if *is_met { "ok  " } else { "FAIL" };
        text += &format!("{verdict}  {seen} ({needed})");
        text += &if *is_met { "\n".to_owned() } else { format!(": {remedy}\n") };
    }
    text += &format!(
        "      a noise of {NOISE_LEVELS} levels of 255 takes about {:.0} lx on the targets; with a \
         quarter of that the spread of the depth doubles\n",
        rounded(optics.lux_for(NOISE_LEVELS))
    );
    (text, lines.iter().all(|(is_met, ..)| *is_met))
}

/// `1456x1088`.
fn size(text: &str) -> Result<[u16; 2], String> {
    let sides = text.split_once(['x', 'X']).map(|(width, height)| [width, height]);
    match sides.map(|sides| sides.map(|side| side.trim().parse::<u16>())) {
        Some([Ok(width), Ok(height)]) if width.min(height) >= 100 => Ok([width, height]),
        _ => Err("give columns and rows of pixels, such as 1456x1088".to_owned()),
    }
}

/// A number within these bounds.
fn between(least: f64, most: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    move |text| {
        let number = text.parse::<f64>().ok().filter(|number| (least..=most).contains(number));
        number.ok_or_else(|| format!("give a number from {least} to {most}"))
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn suitable() -> [(&'static str, Optics); 4] {
        SUITABLE.map(|(name, size_px, pixel_um, focal_mm)| {
            let (f_number, distance_mm, exposure_ms) = (F_NUMBER, DISTANCE_MM, EXPOSURE_MS);
            (name, Optics { size_px, pixel_um, focal_mm, f_number, distance_mm, exposure_ms })
        })
    }

    #[test]
    fn the_list_is_of_cameras_that_will_do_and_readme_shows_it() {
        for (name, optics) in suitable() {
            let (text, will_do) = of_one(&optics, PITCH_MM);
            assert!(will_do, "{name}: {text}");
        }
        let readme = include_str!("../../../../../README.md");
        let Grid { header, rows } = table(&suitable(), PITCH_MM);
        for row in [header].iter().chain(&rows) {
            let line = format!("| {} |", row.join(" | "));
            assert!(readme.contains(&line), "README has no line {line}");
        }
    }

    #[test]
    fn what_will_not_do_is_named_with_its_remedy() {
        let [(_, good), ..] = suitable();
        for (optics, part) in [
            (Optics { focal_mm: 12.0, ..good }, "shorter focal length"),
            (Optics { distance_mm: 2000.0, ..good }, "go nearer"),
            (Optics { f_number: 1.0, focal_mm: 6.0, ..good }, "close the aperture"),
            (Optics { exposure_ms: 16.0, ..good }, "shorter time"),
        ] {
            let (text, will_do) = of_one(&optics, PITCH_MM);
            assert!(!will_do && text.contains("FAIL") && text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn the_list_says_which_of_its_cameras_will_not_do_farther_away() {
        let (text, will_do) = list(&suitable(), PITCH_MM);
        assert!(will_do && !text.contains("FAIL"), "{text}");
        let farther =
            suitable().map(|(name, optics)| (name, Optics { distance_mm: 1300.0, ..optics }));
        let (text, will_do) = list(&farther, PITCH_MM);
        assert!(
            !will_do && text.contains("OV9281: FAIL  a square of 12 mm takes 11.7 px"),
            "{text}"
        );
    }

    #[test]
    fn what_is_no_camera_is_refused() {
        for wrong in [
            &["--sensor", "1456"][..],
            &["--sensor", "1456x1088"],
            &["--sensor", "1456x1088", "--pixel-um", "0", "--focal-mm", "6"],
            &["--focal-mm", "6"],
            &["--distance-mm", "nan"],
        ] {
            let line = ["optics"].iter().chain(wrong);
            assert!(Line::try_parse_from(line).is_err(), "{wrong:?}");
        }
    }
}
