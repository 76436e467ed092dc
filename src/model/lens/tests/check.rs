//! What [`Lens::check`] lets pass, and what it says of the rest.

extern crate std;

use core::f64::consts::FRAC_PI_2;
use std::format;
use std::string::ToString as _;

use super::*;

/// A lens that distorts nothing.
fn pinhole() -> Lens {
    Lens { skew_px: 0.0, distortion: Distortion::Radial2([0.0; 2]), ..wide_angle() }
}

#[test]
fn each_number_has_its_bounds() {
    let good = pinhole();
    let check = |change: fn(&mut Lens, f64), value: f64| {
        let mut lens = good;
        change(&mut lens, value);
        lens.check()
    };
    let fx: fn(&mut Lens, f64) = |lens, value| lens.fx_px = value;
    let fy: fn(&mut Lens, f64) = |lens, value| lens.fy_px = value;
    let cx: fn(&mut Lens, f64) = |lens, value| lens.cx_px = value;
    let cy: fn(&mut Lens, f64) = |lens, value| lens.cy_px = value;
    let skew: fn(&mut Lens, f64) = |lens, value| lens.skew_px = value;
    for (change, [low, high], error) in [
        (fx, [10.0, 100_000.0], LensError::FocalLength),
        (fy, [10.0, 100_000.0], LensError::FocalLength),
        // One frame beside the frame, of 1456 x 1088 pixels.
        (cx, [-1456.0, 2912.0], LensError::PrincipalPoint),
        (cy, [-1088.0, 2176.0], LensError::PrincipalPoint),
        // A tenth of the focal length, which is 800 px.
        (skew, [-80.0, 80.0], LensError::Skew),
    ] {
        let beyond = 1e-9 * (high - low);
        for value in [low, high] {
            assert_eq!(check(change, value), Ok(()), "{value}");
        }
        for value in [low - beyond, high + beyond] {
            assert_eq!(check(change, value), Err(error), "{value}");
        }
    }
}

#[test]
fn a_frame_has_its_limits() {
    let (least, most) = (FRAME_SIDE_PX_MIN, FRAME_SIDE_PX_MAX);
    let check = |width_px, height_px| {
        let (cx_px, cy_px) = (f64::from(width_px) / 2.0, f64::from(height_px) / 2.0);
        Lens { width_px, height_px, cx_px, cy_px, ..pinhole() }.check()
    };
    assert_eq!(check(least, most), Ok(()));
    assert_eq!(check(most, least), Ok(()));
    for (width_px, height_px) in
        [(least - 1, most), (most, least - 1), (most + 1, least), (least, most + 1)]
    {
        assert_eq!(check(width_px, height_px), Err(LensError::FrameSize));
    }
}

#[test]
fn a_coefficient_is_below_1000() {
    // On a sensor as small as this a sixth power does no harm.
    let check = |k3: f64| {
        let distortion = Distortion::Brown5([0.0, 0.0, 0.0, 0.0, k3]);
        Lens { fx_px: 9000.0, fy_px: 9000.0, distortion, ..pinhole() }.check()
    };
    assert_eq!(check(999.9), Ok(()));
    assert_eq!(check(1000.0), Err(LensError::Coefficient));
    assert_eq!(check(-1000.0), Err(LensError::Coefficient));
    assert_eq!(check(f64::NAN), Err(LensError::Coefficient));
}

/// The distorted length r - r^3 / 3 grows up to r = 1, where it is 2/3.
const FOLDS_AT_1: Distortion = Distortion::Radial2([-1.0 / 3.0, 0.0]);

/// A lens whose optical axis meets one corner of the frame, and that folds 0.3 pixels beyond the middle
/// of the pixel in the opposite corner.
#[test]
fn the_frame_ends_with_the_middle_of_its_outermost_pixels() {
    let right = f64::from(FRAME_SIDE_PX_MIN - 1);
    for [cx_px, cy_px] in [[0.0, 0.0], [right, 0.0], [0.0, right], [right, right]] {
        let folding = |reach_px: f64| {
            let f_px = (libm::hypot(right, right) + reach_px) / (2.0 / 3.0);
            Lens {
                width_px: FRAME_SIDE_PX_MIN,
                height_px: FRAME_SIDE_PX_MIN,
                fx_px: f_px,
                fy_px: f_px,
                cx_px,
                cy_px,
                skew_px: 0.0,
                distortion: FOLDS_AT_1,
            }
        };
        assert_eq!(folding(0.3).check(), Ok(()), "{cx_px} {cy_px}");
        assert_eq!(folding(-0.1).check(), Err(LensError::Folds), "{cx_px} {cy_px}");
    }
}

/// Lenses with x' = x -+ r^2 +- r^4 / 4, or y' so: towards one side they fold where the other
/// coordinate is near 0, and where it is near 1, at the corners, they do not.
#[test]
fn each_side_is_checked_between_its_corners_too() {
    let folding = |place: usize, sign: f64, f_px: [f64; 2]| {
        let mut coefficients = [0.0; 12];
        (coefficients[place], coefficients[place + 1]) = (-sign, sign / 4.0);
        Lens {
            width_px: 1001,
            height_px: 1001,
            fx_px: f_px[0],
            fy_px: f_px[1],
            cx_px: 500.0,
            cy_px: 500.0,
            skew_px: 0.0,
            distortion: Distortion::ThinPrism12(coefficients),
        }
    };
    for sign in [1.0, -1.0] {
        // From -0.3 to 0.3 along the axis of the prism, and from -1 to 1 across.
        for (place, f_px) in [(8, [500.0 / 0.3, 500.0]), (10, [500.0, 500.0 / 0.3])] {
            let lens = folding(place, sign, f_px);
            assert_eq!(lens.check(), Err(LensError::Folds), "{place} {sign}");
            let has_ray = |x: f64, y: f64| {
                let ray = lens.ray_from_raw(&Vector2::new(x, y));
                ray.is_some_and(|ray| lens.is_unfolded_up_to(&ray))
            };
            let corners = [[0.0, 0.0], [1000.0, 0.0], [0.0, 1000.0], [1000.0, 1000.0]];
            assert!(corners.iter().all(|&[x, y]| has_ray(x, y)), "{place} {sign}");
        }
    }
}

#[test]
fn a_frame_may_see_nearly_180_degrees_and_no_more() {
    let half_px = f64::from(FRAME_SIDE_PX_MIN - 1) / 2.0;
    let seeing = |angle_rad: f64| {
        let f_px = libm::hypot(half_px, half_px) / angle_rad;
        Lens {
            width_px: FRAME_SIDE_PX_MIN,
            height_px: FRAME_SIDE_PX_MIN,
            fx_px: f_px,
            fy_px: f_px,
            cx_px: half_px,
            cy_px: half_px,
            skew_px: 0.0,
            distortion: Distortion::Fisheye4([0.0; 4]),
        }
    };
    assert_eq!(seeing(FRAC_PI_2 - 0.002).check(), Ok(()));
    assert_eq!(seeing(FRAC_PI_2 + 0.002).check(), Err(LensError::Folds));
}

#[test]
fn each_error_names_the_field_and_its_bounds() {
    let sides = format!("within {FRAME_SIDE_PX_MIN} to {FRAME_SIDE_PX_MAX}");
    let error = format!("by more than {ERROR_PX_MAX} px; calibrate again");
    for (found, words) in [
        (LensError::FrameSize, ["width_px and height_px must lie", &sides]),
        (LensError::FocalLength, ["fx_px and fy_px must lie", "within 10 to 100,000 px"]),
        (LensError::PrincipalPoint, ["cx_px and cy_px must lie", "within one frame's length"]),
        (LensError::Skew, ["skew_px must be finite", "below a tenth of fx_px"]),
        (LensError::Coefficient, ["every distortion coefficient", "finite and below 1,000"]),
        (LensError::Folds, ["folds back inside the frame", "a pixel would have two rays or none"]),
        (LensError::Table, ["the distortion changes too fast", &error]),
    ] {
        let text = found.to_string();
        assert!(words.iter().all(|words| text.contains(words)), "{text}");
    }
}
