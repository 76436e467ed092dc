extern crate std;

use std::boxed::Box;
use std::vec::Vec;

use super::*;
use crate::model::lens::Distortion;
use crate::test_support::{Random, bedside_lens, repetitions};

const FISHEYE: Distortion = Distortion::Fisheye4([-0.02, 0.004, -0.003, 0.0005]);

/// A lens with a frame of the size for which this build's capacities are.
fn of_size_of_build(lens: Lens) -> Lens {
    if !cfg!(feature = "small-limits") || lens.width_px.min(lens.height_px) <= 480 {
        return lens;
    }
    let scale = 640.0 / 1456.0;
    Lens {
        width_px: (f64::from(lens.width_px) * scale) as u16,
        height_px: (f64::from(lens.height_px) * scale) as u16,
        fx_px: lens.fx_px * scale,
        fy_px: lens.fy_px * scale,
        cx_px: lens.cx_px * scale,
        cy_px: lens.cy_px * scale,
        ..lens
    }
}

/// Lenses of all kinds, each with a name.
fn lenses() -> impl Iterator<Item = (&'static str, Lens)> {
    let bedside = bedside_lens();
    let with = |distortion| Lens { distortion, ..bedside };
    let wide = Lens { fx_px: 800.0, fy_px: 805.0, ..bedside };
    let wide = |distortion| Lens { distortion, ..wide };
    [
        ("no distortion", with(Distortion::Radial2([0.0; 2]))),
        ("the bedside's", bedside),
        ("a strong cushion", with(Distortion::Radial2([0.4, 0.3]))),
        ("a wide barrel", wide(Distortion::Brown5([-0.28, 0.09, 0.001, -0.0008, -0.008]))),
        ("decentred", wide(Distortion::Brown5([-0.1, 0.02, 0.02, -0.015, 0.0]))),
        (
            "upright",
            Lens { width_px: 1088, height_px: 1456, cx_px: 540.0, cy_px: 731.0, ..bedside },
        ),
        (
            "a large frame",
            Lens {
                width_px: 4096,
                height_px: 3000,
                fx_px: 4900.0,
                fy_px: 4900.0,
                cx_px: 2050.0,
                cy_px: 1490.0,
                ..bedside
            },
        ),
        ("a narrow strip", Lens { width_px: 1456, height_px: 64, cy_px: 30.0, ..bedside }),
        (
            "a tiny frame, askew",
            Lens {
                width_px: 64,
                height_px: 64,
                fx_px: 60.0,
                fy_px: 70.0,
                cx_px: 30.0,
                cy_px: 35.0,
                skew_px: 5.0,
                ..bedside
            },
        ),
        (
            "rational",
            wide(Distortion::Rational8([0.1, 0.02, 0.0006, -0.0004, 0.001, 0.3, 0.02, 0.0005])),
        ),
        (
            "a thin prism",
            wide(Distortion::ThinPrism12([
                -0.2, 0.06, 0.0006, -0.0004, -0.004, 0.05, 0.01, 0.002, 0.003, -0.001, -0.002,
                0.0008,
            ])),
        ),
        ("a fisheye", wide(FISHEYE)),
        (
            "a fisheye that sees 85 degrees from its axis",
            Lens { fx_px: 640.0, fy_px: 645.0, distortion: FISHEYE, ..bedside },
        ),
    ]
    .into_iter()
    .map(|(name, lens)| (name, of_size_of_build(lens)))
}

fn table(lens: &Lens) -> Box<LensTable> {
    let mut table = Box::new(LensTable::new());
    table.fill(lens).expect("a usual lens");
    table
}

/// A pixel anywhere in a lens's frame.
fn any_pixel(lens: &Lens, random: &mut Random) -> Vector2<f64> {
    let side = |side_px: u16| f64::from(side_px - 1);
    Vector2::new(
        random.uniform(0.0, side(lens.width_px)),
        random.uniform(0.0, side(lens.height_px)),
    )
}

#[test]
fn both_maps_of_every_lens_are_within_the_bound_everywhere() {
    // There and back, and of derivatives. Fewer cells follow a lens less closely.
    let bound = if cfg!(feature = "small-limits") { 1e-3 } else { 1e-4 };
    let mut random = Random::new(1);
    for (name, lens) in lenses() {
        let table = table(&lens);
        let corners = [0, lens.width_px - 1]
            .map(f64::from)
            .into_iter()
            .flat_map(|x| [0, lens.height_px - 1].map(f64::from).map(|y| Vector2::new(x, y)));
        let pixels: Vec<_> = corners
            .chain((0..repetitions(20_000)).map(|_| any_pixel(&lens, &mut random)))
            .collect();
        for raw_px in pixels {
            let ray = lens.ray_from_raw(&raw_px).unwrap();
            let (forth_px, raw_by_ray) = table.raw_from_ray_with_jacobian(&ray);
            let error_px = (forth_px - raw_px).norm();
            assert!(error_px < ERROR_PX_MAX, "{name}: {error_px} px at {raw_px}");

            let (_, exact) = lens.raw_from_ray_with_jacobian(&ray);
            let back = table.ray_from_raw(&raw_px).unwrap();
            let error_px = (exact * (back - ray)).norm();
            assert!(error_px < ERROR_PX_MAX, "{name}: {error_px} px back at {raw_px}");
            let error_px = (table.raw_from_ray_with_jacobian(&back).0 - raw_px).norm();
            assert!(error_px < bound, "{name}: back and forth, {error_px} px at {raw_px}");

            // A prediction is off by 1 px at most where only derivatives are used.
            let error = (raw_by_ray - exact).norm() / exact.norm();
            assert!(error < bound, "{name}: derivatives off by {error} at {raw_px}");
        }
    }
}

#[test]
fn usual_lenses_stay_far_below_the_bound() {
    let lens = bedside_lens();
    let error_px = table(&lens).error_px(&lens).unwrap();
    assert!(error_px < 0.01 * ERROR_PX_MAX, "{error_px} px");
}

#[test]
fn only_a_fisheye_needs_another_plane_than_that_of_its_rays() {
    for (name, lens) in lenses() {
        let is_fisheye = matches!(lens.distortion, Distortion::Fisheye4(_));
        let is_stereographic = table(&lens).projection == Projection::Stereographic;
        assert_eq!(is_stereographic, is_fisheye, "{name}");
    }
}

#[test]
fn derivatives_are_those_of_the_values() {
    let lens = bedside_lens();
    let table = table(&lens);
    let mut random = Random::new(2);
    for _ in 0..repetitions(500) {
        let raw_px = any_pixel(&lens, &mut random);
        let ray = table.ray_from_raw(&raw_px).unwrap();
        let (_, raw_by_ray) = table.raw_from_ray_with_jacobian(&ray);
        for axis in 0..2 {
            // A pixel of a cell's 91: the third derivative leaves 1e-7 px in a difference, and where
            // two cells meet, their errors.
            let step = Vector2::from_fn(|row, _| if row == axis { 0.5 / lens.fx_px } else { 0.0 });
            let [ahead, behind] =
                [ray + step, ray - step].map(|ray| table.raw_from_ray_with_jacobian(&ray).0);
            let difference = (ahead - behind) * lens.fx_px;
            let error = (difference - raw_by_ray.column(axis)).norm() / lens.fx_px;
            assert!(error < 2e-5, "{error} at {raw_px}");
        }
    }
}

#[test]
fn beyond_the_frame_there_are_no_rays_and_pixels_go_on() {
    let lens = bedside_lens();
    let table = table(&lens);
    let rays = |x: f64, y: f64| table.ray_from_raw(&Vector2::new(x, y));
    // From border to border of the outermost pixels.
    assert!(rays(-0.5, -0.5).is_some() && rays(1455.5, 1087.5).is_some());
    assert!(rays(-0.6, 500.0).is_none() && rays(1455.6, 500.0).is_none());
    assert!(rays(700.0, -0.6).is_none() && rays(700.0, 1087.6).is_none());
    assert!(rays(f64::NAN, 500.0).is_none() && rays(700.0, f64::INFINITY).is_none());
    // On the way out of the frame and far beyond, each pixel is farther out than the last.
    let mut last_px = 1000.0;
    for step in 0..400 {
        let ray = Vector2::new(0.2 + 0.01 * f64::from(step), 0.1);
        let (raw_px, _) = table.raw_from_ray_with_jacobian(&ray);
        assert!(raw_px.x > last_px, "{raw_px} after {last_px}");
        last_px = raw_px.x;
    }
    // And just outside it is where the lens puts it.
    let ray = Vector2::new(0.4309, 0.3);
    let exact_px = lens.raw_from_ray_with_jacobian(&ray).0;
    assert!(exact_px.x > 1460.0, "{exact_px}");
    assert!((table.raw_from_ray_with_jacobian(&ray).0 - exact_px).norm() < ERROR_PX_MAX);
}

#[test]
fn a_lens_that_the_table_cannot_follow_is_refused() {
    let mut table = Box::new(LensTable::new());
    // It rises by half near the corner of the frame only: a calibration gone wrong.
    let wrong =
        Lens { distortion: Distortion::Brown5([0.0, 0.0, 0.0, 0.0, 900.0]), ..bedside_lens() };
    assert_eq!(wrong.check(), Ok(()));
    assert_eq!(table.fill(&wrong), Err(LensError::Table));
    assert_eq!((table.width_px(), table.height_px()), (0, 0));
    // It can still be used afterwards.
    assert_eq!(table.fill(&bedside_lens()), Ok(()));
    let folds = Lens { distortion: Distortion::Radial2([-5.0, 0.0]), ..bedside_lens() };
    assert_eq!(table.fill(&folds), Err(LensError::Folds));
}

#[test]
fn an_unfilled_table_gives_no_rays_and_does_not_panic() {
    let table = LensTable::new();
    assert!(table.ray_from_raw(&Vector2::new(0.0, 0.0)).is_none());
    let _ = table.raw_from_ray_with_jacobian(&Vector2::new(0.1, 0.2));
}

#[test]
fn a_nan_stays_one() {
    let table = table(&bedside_lens());
    let (raw_px, _) = table.raw_from_ray_with_jacobian(&Vector2::new(f64::NAN, 0.0));
    assert!(raw_px.x.is_nan());
}

/// A lens that rises too fast in its corners, but only a little.
fn steep() -> Lens {
    // For the fewer cells of the smaller limits, less is too fast.
    let k3 = if cfg!(feature = "small-limits") { 25.0 } else { 200.0 };
    of_size_of_build(Lens {
        distortion: Distortion::Brown5([0.0, 0.0, 0.0, 0.0, k3]),
        ..bedside_lens()
    })
}

#[test]
fn the_error_is_the_largest_at_four_pixels_along_each_cell() {
    let lens = steep();
    let mut table = Box::new(LensTable::new());
    let error_px = table.fill_over(Projection::Gnomonic, &lens).unwrap();
    let mut largest_px = 0.0_f64;
    let steps = 4 * LENS_TABLE_CELLS;
    for (row, column) in (0..=steps).flat_map(|row| (0..=steps).map(move |it| (row, it))) {
        let [width_px, height_px] =
            [lens.width_px, lens.height_px].map(|side_px| f64::from(side_px - 1));
        let raw_px = Vector2::new(width_px * column as f64, height_px * row as f64) / steps as f64;
        let ray = lens.ray_from_raw(&raw_px).unwrap();
        let forth_px = table.raw_from_ray_with_jacobian(&ray).0 - raw_px;
        let back = table.ray_from_raw(&raw_px).unwrap();
        let back_px = lens.raw_from_ray_with_jacobian(&back).0 - raw_px;
        largest_px = largest_px.max(forth_px.norm()).max(back_px.norm());
    }
    // Rounding of pixels.
    assert!((error_px - largest_px).abs() < 1e-11, "{error_px}, {largest_px}");
    assert!(error_px > 0.5 * ERROR_PX_MAX && error_px < ERROR_PX_MAX, "{error_px}");
}

/// Between the pixels checked, an error may be twice as large.
#[test]
fn an_error_of_more_than_half_the_bound_is_refused() {
    let mut table = Box::new(LensTable::new());
    assert_eq!(table.fill(&steep()), Err(LensError::Table));
}

#[test]
fn a_table_covers_the_rays_of_the_frame_and_a_margin() {
    // Rays of the first are between those of the corners; of the others, the sides' middles reach
    // farthest.
    let bedside = bedside_lens();
    let pinhole = Lens { skew_px: 0.0, distortion: Distortion::Radial2([0.0; 2]), ..bedside };
    let cushion = Lens { distortion: Distortion::Radial2([0.4, 0.3]), ..bedside };
    let fisheye = Lens { fx_px: 800.0, fy_px: 805.0, distortion: FISHEYE, ..bedside };
    for (lens, projection) in [
        (pinhole, Projection::Gnomonic),
        (cushion, Projection::Gnomonic),
        (fisheye, Projection::Stereographic),
    ] {
        let frame = Rectangle { start: Vector2::zeros(), end: Vector2::new(1455.0, 1087.0) };
        let covered = rays_of_frame(projection, &lens, &frame).unwrap();
        let columns = (0..1456).flat_map(|x| [[x, 0], [x, 1087]]);
        let rows = (0..1088).flat_map(|y| [[0, y], [1455, y]]);
        let (mut low, mut high) = (Vector2::repeat(9.0), Vector2::repeat(-9.0));
        for raw_px in columns.chain(rows) {
            let ray = lens.ray_from_raw(&raw_px.map(f64::from).into()).unwrap();
            let plane = projection.plane_from_ray(&ray);
            (low, high) = (low.inf(&plane), high.sup(&plane));
        }
        let range = high - low;
        // The rays looked at are up to 11 pixels from the one that reaches farthest: of a side that
        // bends by 100 pixels over 700, these are 0.03 pixels.
        let (start, end) = (low - range * 0.03, high + range * 0.03);
        assert!((covered.start - start).amax() < 1e-4 * range.amin(), "{}", covered.start);
        assert!((covered.end - end).amax() < 1e-4 * range.amin(), "{}", covered.end);
    }
}

/// A cell has 128 bytes, and the map back a quarter as many cells; beside them are both origins and
/// scales, the frame's sides and the projection.
#[test]
fn the_map_back_takes_a_quarter_of_the_room() {
    let cells = LENS_TABLE_CELLS * LENS_TABLE_CELLS;
    assert_eq!(size_of::<LensTable>(), 128 * (cells + cells / 4) + 2 * 32 + 8);
}

/// A distorted length of r - r^3 / 3, which grows up to r = 1: 0.3 pixels beyond the last pixel.
#[test]
fn a_lens_that_folds_beyond_the_frame_is_only_too_steep() {
    let f_px = (libm::hypot(63.0, 63.0) + 0.3) / (2.0 / 3.0);
    let lens = Lens {
        width_px: 64,
        height_px: 64,
        fx_px: f_px,
        fy_px: f_px,
        cx_px: 0.0,
        cy_px: 0.0,
        skew_px: 0.0,
        distortion: Distortion::Radial2([-1.0 / 3.0, 0.0]),
    };
    assert_eq!(lens.check(), Ok(()));
    let mut table = Box::new(LensTable::new());
    assert_eq!(table.fill(&lens), Err(LensError::Table));
}

#[test]
fn a_table_knows_the_frame() {
    let table = table(&bedside_lens());
    assert_eq!((table.width_px(), table.height_px()), (1456, 1088));
}
