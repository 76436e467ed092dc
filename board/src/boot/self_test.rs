//! Checks that this computer measures correctly before it is trusted: a rendered
//! target of known pose goes through the pipeline. That exercises what a frame
//! needs: the processor, its arithmetic, every buffer. It takes about 10 ms.
//!
//! It detects a broken build or machine; a wrong configuration is detected by
//! [`Config::check`].

use anyhow::{Context, Result, ensure};
use plumbline::config::{Config, Links, Machine, TargetConfig};
use plumbline::image::GreyImage;
use plumbline::lens::{Distortion, Lens};
use plumbline::pipeline::Pipeline;
use plumbline::target::{Origin, Role, TargetGeometry};

use crate::machine::clock;

const WIDTH_PX: usize = 256;
const HEIGHT_PX: usize = 192;
const FOCAL_LENGTH_PX: f64 = 300.0;
const PRINCIPAL_POINT_PX: (f64, f64) = (127.5, 95.5);

const COLUMNS: u8 = 6;
const ROWS: u8 = 5;
const PITCH_MM: f64 = 12.0;

/// The target's position; its plane is parallel to the image.
const POSITION_MM: [f64; 3] = [3.0, -2.0, 200.0];

/// The largest error of the measurement; the coarse rendering alone causes a tenth of this.
const ERROR_MM_MAX: f64 = 0.02;

/// A search and a few tracked frames.
const FRAMES: u64 = 5;
const FRAME_NS: u64 = 16_666_667;

/// Measures the rendered target. The pipeline must be configured again afterwards.
///
/// # Errors
/// What is wrong, and by how much.
pub fn run(pipeline: &mut Pipeline) -> Result<()> {
    let before_ns = clock::monotonic_ns();
    measure(pipeline, &render(POSITION_MM))?;
    check_clock(before_ns, clock::monotonic_ns())
}

/// Checks that the clock of the frames' time stamps advances.
fn check_clock(before_ns: u64, after_ns: u64) -> Result<()> {
    ensure!(
        after_ns > before_ns,
        "the clock stands still: it read {before_ns} ns before the measurement and {after_ns} ns \
         after it"
    );
    Ok(())
}

/// Checks that the target in an image is measured at its true position.
fn measure(pipeline: &mut Pipeline, pixels: &[u8]) -> Result<()> {
    pipeline.configure(&config()?).context("the built-in configuration")?;
    let image = GreyImage::new(pixels, WIDTH_PX, HEIGHT_PX, WIDTH_PX).context("the image")?;
    let mut report = pipeline.step(&image, 0);
    for frame in 1..FRAMES {
        report = pipeline.step(&image, frame * FRAME_NS);
    }
    let target = report.targets.first().context("no target is reported")?;
    let measured = target
        .measurement
        .as_ref()
        .map_err(|why| anyhow::anyhow!("the rendered target is not measured: {}", why.words()))?;
    let found_mm = measured.cam_from_target.translation_mm;
    let close = |(found_mm, true_mm): (&f64, f64)| (found_mm - true_mm).abs() <= ERROR_MM_MAX;
    ensure!(
        found_mm.iter().zip(POSITION_MM).all(close),
        "the rendered target is at {POSITION_MM:?} mm and was measured at {:?} mm",
        found_mm.as_slice()
    );
    Ok(())
}

fn config() -> Result<Config> {
    let geometry =
        TargetGeometry::checker(COLUMNS, ROWS, PITCH_MM, Origin::Center, Role::Lower, [0.0; 3])
            .map_err(|error| anyhow::anyhow!("the built-in target: {error}"))?;
    let target = TargetConfig { name: "test".try_into().unwrap_or_default(), geometry };
    Ok(Config {
        device: heapless::String::new(),
        serial_number: heapless::String::new(),
        lens: Lens {
            width_px: WIDTH_PX as u16,
            height_px: HEIGHT_PX as u16,
            fx_px: FOCAL_LENGTH_PX,
            fy_px: FOCAL_LENGTH_PX,
            cx_px: PRINCIPAL_POINT_PX.0,
            cy_px: PRINCIPAL_POINT_PX.1,
            skew_px: 0.0,
            distortion: Distortion::Radial2([0.0; 2]),
        },
        readout_ns: 0,
        targets: [target].into_iter().collect(),
        cam_from_scene_theta: None,
        links: Links::default(),
        capture: None,
        machine: Machine::default(),
        trigger: None,
    })
}

/// The target at a position, on white paper; each pixel is the mean of 4 x 4 points, then blurred.
fn render([x_mm, y_mm, z_mm]: [f64; 3]) -> Vec<u8> {
    const POINTS: usize = 4;
    let (width_mm, height_mm) = (f64::from(COLUMNS + 1) * PITCH_MM, f64::from(ROWS + 1) * PITCH_MM);
    // From a position on the image to squares, counted from the target's corner.
    let square = |position_px: f64, principal_px: f64, offset_mm: f64, side_mm: f64| {
        let position_mm = (position_px - principal_px) / FOCAL_LENGTH_PX * z_mm - offset_mm;
        let from_edge = (position_mm + side_mm / 2.0) / PITCH_MM;
        (0.0..side_mm / PITCH_MM).contains(&from_edge).then_some(from_edge as usize)
    };
    let fine = |position: usize| (position as f64 + 0.5) / POINTS as f64 - 0.5;
    let columns: Vec<Option<usize>> = (0..WIDTH_PX * POINTS)
        .map(|u| square(fine(u), PRINCIPAL_POINT_PX.0, x_mm, width_mm))
        .collect();
    let rows: Vec<Option<usize>> = (0..HEIGHT_PX * POINTS)
        .map(|v| square(fine(v), PRINCIPAL_POINT_PX.1, y_mm, height_mm))
        .collect();
    let dark = |u: usize, v: usize| {
        columns[u].zip(rows[v]).is_some_and(|(column, row)| (column + row) % 2 == 0)
    };
    let pixel = |index: usize| {
        let (u, v) = (index % WIDTH_PX * POINTS, index / WIDTH_PX * POINTS);
        let dark_points =
            (0..POINTS * POINTS).filter(|at| dark(u + at % POINTS, v + at / POINTS)).count();
        // From 220 down to 40.
        220 - (dark_points * 180 / (POINTS * POINTS)) as u8
    };
    let sharp: Vec<u8> = (0..WIDTH_PX * HEIGHT_PX).map(pixel).collect();
    // A lens's blur: no camera shows edges as sharp as these, and the fit does not expect them.
    let across =
        |at: usize| u16::from(sharp[at - 1]) + 2 * u16::from(sharp[at]) + u16::from(sharp[at + 1]);
    let blurred = |at: usize| {
        let sum = across(at - WIDTH_PX) + 2 * across(at) + across(at + WIDTH_PX);
        ((sum + 8) / 16) as u8
    };
    let inside = |at: usize| {
        (1..WIDTH_PX - 1).contains(&(at % WIDTH_PX))
            && (1..HEIGHT_PX - 1).contains(&(at / WIDTH_PX))
    };
    (0..sharp.len()).map(|at| if inside(at) { blurred(at) } else { sharp[at] }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sound_computer_passes() {
        let mut pipeline = Box::new(Pipeline::new());
        run(&mut pipeline).unwrap();
        // Twice: nothing is left over from the first.
        run(&mut pipeline).unwrap();
    }

    #[test]
    fn a_target_that_is_measured_elsewhere_or_not_at_all_is_a_fault() {
        let mut pipeline = Box::new(Pipeline::new());
        let [x_mm, y_mm, z_mm] = POSITION_MM;
        let elsewhere = render([x_mm + 10.0 * ERROR_MM_MAX, y_mm, z_mm]);
        let blank = vec![220; WIDTH_PX * HEIGHT_PX];
        for (pixels, words) in [(elsewhere, "was measured at"), (blank, "is not measured")] {
            let error = measure(&mut pipeline, &pixels).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn a_clock_that_stands_still_or_goes_back_is_a_fault() {
        check_clock(5, 6).unwrap();
        for after_ns in [5, 4] {
            let error = check_clock(5, after_ns).unwrap_err().to_string();
            assert!(error.contains("the clock stands still"), "{error}");
        }
    }
}
