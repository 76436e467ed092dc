extern crate std;

use std::vec::Vec;

use super::*;
use crate::find::corner::tests::plain::{PlainPixel, plain_window};
use crate::test_support::Random;

#[test]
fn half_a_turn_is_a_fraction_of_the_arctangent_all_around() {
    for degree in 0..360_u16 {
        for length in [1.0, 360.0, 90_000.0] {
            let angle_rad = f32::from(degree).to_radians();
            let [x, y] = [length * libm::cosf(angle_rad), length * libm::sinf(angle_rad)];
            let Lanes(turns) = half_turn(Lanes::all(y), Lanes::all(x));
            assert_eq!(turns, [turns[0]; LANES]);
            assert!((0.0..=1.0).contains(&turns[0]), "{degree}: {turns:?}");
            // Directions that are half a turn apart are one.
            let apart_rad = turns[0] * PI - angle_rad;
            assert!(libm::sinf(apart_rad).abs() < 0.005, "{degree}: {turns:?}");
        }
    }
    assert_eq!(half_turn(Lanes::ZERO, Lanes::ZERO), Lanes::ZERO);
}

const SIDE: usize = 64;

/// A picture with a corner near its middle: two lines at these angles through a point, between which
/// the picture is bright and dark, both blurred and in noise; of which one is missing in some.
fn corner(random: &mut Random, noise: f64) -> Vec<u8> {
    let first_rad = random.uniform(0.0, core::f64::consts::PI);
    let between_rad = random.uniform(0.1, 1.6);
    let place = [(); 2].map(|()| 32.0 + random.uniform(-1.5, 1.5));
    let second = f64::from(random.uniform(0.0, 1.0) < 0.9);
    let contrast = random.uniform(10.0, 100.0);
    let blur_px = random.uniform(0.5, 1.5);
    (0..SIDE * SIDE)
        .map(|n| {
            let offset = [(n % SIDE) as f64 - place[0], (n / SIDE) as f64 - place[1]];
            let side = |angle_rad: f64| {
                let distance = offset[1] * angle_rad.cos() - offset[0] * angle_rad.sin();
                (distance / blur_px).tanh()
            };
            let one = side(first_rad);
            let other = second * side(first_rad + between_rad) + (1.0 - second);
            (128.0 + contrast * one * other + noise * random.normal()) as u8
        })
        .collect()
}

fn noise(random: &mut Random) -> Vec<u8> {
    // Coarse, so that gradients have directions.
    let coarse: Vec<f64> = (0..32 * 32).map(|_| random.uniform(40.0, 200.0)).collect();
    (0..SIDE * SIDE)
        .map(|n| {
            let (x, y) = (n % SIDE, n / SIDE);
            let at = |x: usize, y: usize| coarse[y / 3 % 32 * 32 + x / 3 % 32];
            ((at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 2, y + 2)) / 4.0) as u8
        })
        .collect()
}

/// Pictures, and a window inside each.
fn windows(count: usize, seed: u64) -> impl Iterator<Item = (Vec<u8>, [usize; 2], usize)> {
    let mut random = Random::new(seed);
    (0..count).map(move |n| {
        let bytes = match n % 4 {
            0 => noise(&mut random),
            _ => {
                let noise = random.uniform(0.0, 8.0);
                corner(&mut random, noise)
            }
        };
        let place = [(); 2].map(|()| 31 + (random.bits() % 3) as usize);
        (bytes, place, 3 + n % 7)
    })
}

fn filled(bytes: &[u8], place: [usize; 2], half: usize) -> (Window, Vec<PlainPixel>) {
    let image = GreyImage::new(bytes, SIDE, SIDE, SIDE).unwrap();
    let mut window = Window::new(half);
    window.fill(&image, place);
    (window, plain_window(&image, place, half))
}

/// The distance of a point from a line through the origin.
fn plain_distance([ex, ey]: [f64; 2], [x, y]: [f64; 2]) -> f64 {
    y * ex - x * ey
}

fn plain_weight_along(pixel: &PlainPixel, [ex, ey]: [f64; 2]) -> f64 {
    let [gx, gy] = pixel.gradient;
    let is_along = (gx * ex + gy * ey).abs() < 0.35 * pixel.magnitude;
    if is_along { pixel.edge_weight } else { 0.0 }
}

/// Mean brightness of the sectors and Pearson's correlation, pixel by pixel.
fn plain_compare(
    pixels: &[PlainPixel],
    reach: usize,
    edges: [[f64; 2]; 2],
    shift: [f64; 2],
) -> Option<([f64; 4], f64)> {
    let mut sums = [[0.0; 2]; 4];
    let mut samples = Vec::new();
    for pixel in pixels {
        let [dx, dy] = pixel.offset;
        if dx * dx + dy * dy > (reach * reach + 1) as i32 {
            continue;
        }
        let offset = [f64::from(dx) - shift[0], f64::from(dy) - shift[1]];
        let [from0, from1] = edges.map(|edge| plain_distance(edge, offset));
        let nearest = from0.abs().min(from1.abs());
        samples.push((f64::from(u8::from(nearest < 1.5)), pixel.magnitude));
        if nearest > 0.75 {
            let sector = usize::from(from0 > 0.0) + 2 * usize::from(from1 > 0.0);
            sums[sector][0] += pixel.weight * pixel.brightness;
            sums[sector][1] += pixel.weight;
        }
    }
    if sums.iter().any(|sum| sum[1] == 0.0) {
        return None;
    }
    let count = samples.len() as f64;
    let mean = |value: &dyn Fn(&(f64, f64)) -> f64| samples.iter().map(value).sum::<f64>() / count;
    let (a, b) = (mean(&|it| it.0), mean(&|it| it.1));
    let covariance = mean(&|it| (it.0 - a) * (it.1 - b));
    let spread = mean(&|it| (it.0 - a).powi(2)) * mean(&|it| (it.1 - b).powi(2));
    let correlation = if spread > 0.0 { covariance / spread.sqrt() } else { 0.0 };
    Some((sums.map(|sum| sum[0] / sum[1]), correlation))
}

/// The two highest modes of the histogram, as bins.
fn plain_modes(pixels: &[PlainPixel]) -> Option<[usize; 2]> {
    let mut bins = [0.0_f64; 32];
    for pixel in pixels {
        let [gx, gy] = pixel.gradient.map(|value| Lanes::all(value as f32));
        let mass = pixel.edge_weight * pixel.magnitude;
        let position = 32.0 * f64::from(half_turn(Lanes::ZERO - gx, gy).0[0]);
        let bin = position.floor();
        bins[bin as usize % 32] += mass * (bin + 1.0 - position);
        bins[(bin as usize + 1) % 32] += mass * (position - bin);
    }
    let at = |bin: usize, step: i32| bins[(bin as i32 + step).rem_euclid(32) as usize];
    let smooth: Vec<f64> = (0..32)
        .map(|bin| {
            [1.0, 4.0, 6.0, 4.0, 1.0].iter().zip(-2..).map(|(w, step)| w * at(bin, step)).sum()
        })
        .collect();
    let mut modes: Vec<usize> = (0..32_usize)
        .filter(|&bin| smooth[bin] > smooth[(bin + 31) % 32])
        .filter(|&bin| smooth[bin] >= smooth[(bin + 1) % 32])
        .collect();
    modes.sort_by(|&a, &b| smooth[b].total_cmp(&smooth[a]));
    let &first = modes.first()?;
    let is_far = |bin: &usize| (5..=27).contains(&bin.abs_diff(first));
    let second = modes.into_iter().find(is_far)?;
    (smooth[second] >= 0.15 * smooth[first]).then_some([first, second])
}

/// The direction perpendicular to the gradients along an edge, and how clear it is: 0 if they have no
/// direction, 1 if they all have the same.
fn plain_turned(pixels: &[PlainPixel], angle_rad: f64) -> (f64, f64) {
    let (mut angle_rad, mut clearness) = (angle_rad, 1.0_f64);
    for _ in 0..2 {
        let edge = [angle_rad.cos(), angle_rad.sin()];
        // The doubled angles of the gradients have a mean.
        let (mut sum, mut length) = ([0.0; 2], 0.0);
        for pixel in pixels {
            let weight = plain_weight_along(pixel, edge) * pixel.magnitude.powi(2);
            let doubled = 2.0 * pixel.gradient[1].atan2(pixel.gradient[0]);
            sum[0] += weight * doubled.cos();
            sum[1] += weight * doubled.sin();
            length += weight;
        }
        let normal_rad = 0.5 * sum[1].atan2(sum[0]);
        angle_rad = normal_rad + core::f64::consts::FRAC_PI_2;
        clearness = clearness.min(sum[0].hypot(sum[1]) / length);
    }
    (angle_rad, clearness)
}

/// The point whose sum of squared distances from the edge elements, weighted, is smallest.
fn plain_intersection(pixels: &[PlainPixel], edges: [[f64; 2]; 2]) -> Option<[f64; 2]> {
    let (mut moments, mut right) = (nalgebra::Matrix2::zeros(), nalgebra::Vector2::zeros());
    for pixel in pixels {
        let offset = nalgebra::Vector2::from(pixel.offset.map(f64::from));
        let of_edge = |edge: [f64; 2]| {
            let is_near = plain_distance(edge, offset.into()).abs() < 3.5;
            if is_near { plain_weight_along(pixel, edge) } else { 0.0 }
        };
        let weight = of_edge(edges[0]).max(of_edge(edges[1]));
        if offset.norm_squared() > 1.5 {
            let gradient = nalgebra::Vector2::from(pixel.gradient);
            moments += weight * gradient * gradient.transpose();
            right += weight * gradient * gradient.dot(&offset);
        }
    }
    let is_fixed = moments.determinant() > 0.01 * moments.trace().powi(2);
    let shift = is_fixed.then(|| moments.try_inverse().unwrap() * right)?;
    (shift.norm() <= 2.0).then_some(shift.into())
}

fn directions(edges_rad: [f64; 2]) -> [[f64; 2]; 2] {
    edges_rad.map(|angle_rad| [angle_rad.cos(), angle_rad.sin()])
}

fn single<const N: usize>(values: [f64; N]) -> [f32; N] {
    values.map(|value| value as f32)
}

#[test]
fn sectors_and_correlation_are_their_definition() {
    let mut random = Random::new(31);
    let (mut compared, mut without) = (0, 0);
    for (bytes, place, half) in windows(80, 30) {
        let (window, pixels) = filled(&bytes, place, half);
        let first_rad = random.uniform(0.0, 3.1);
        let edges = directions([first_rad, first_rad + random.uniform(0.2, 2.9)]);
        let shift = [(); 2].map(|()| random.uniform(-2.0, 2.0));
        let reach = half - (random.bits() % 2) as usize;
        let ours = compare(&window, reach, edges.map(single), single(shift));
        let plain = plain_compare(&pixels, reach, edges, shift);
        assert_eq!(ours.is_some(), plain.is_some(), "{place:?} {half} {edges:?} {shift:?}");
        let (Some((levels, correlation)), Some((plain_levels, expected))) = (ours, plain) else {
            without += 1;
            continue;
        };
        // Single precision; the correlation is a small difference of products of sums.
        for (level, plain) in levels.into_iter().zip(plain_levels) {
            assert!((f64::from(level) - plain).abs() < 1e-3, "{level} {plain}");
        }
        assert!((f64::from(correlation) - expected).abs() < 1e-4, "{correlation} {expected}");
        compared += 1;
    }
    assert!(compared > 40 && without > 2, "{compared} {without}");
}

#[test]
fn where_nothing_varies_the_correlation_is_0() {
    let (window, _) = filled(&[90; SIDE * SIDE], [32, 32], 7);
    let crossed = [[1.0, 0.0], [0.0, 1.0]];
    let (levels, correlation) = compare(&window, 7, crossed, [0.0; 2]).unwrap();
    assert!(levels.into_iter().all(|level| (level - 90.0).abs() < 1e-4), "{levels:?}");
    assert_eq!(correlation, 0.0);
    // Both edges beside the window: three sectors have no pixel.
    assert_eq!(compare(&window, 7, crossed, [20.0; 2]), None);
    assert_eq!(modes(&window), None);
    assert_eq!(intersection(&window, crossed), None);
}

#[test]
fn modes_turned_edges_and_their_intersection_are_their_definition() {
    let (mut with_modes, mut with_point, mut without) = (0, 0, 0);
    for (bytes, place, half) in windows(400, 32) {
        let (window, pixels) = filled(&bytes, place, half);
        let modes = modes(&window);
        let plain = plain_modes(&pixels);
        let bins = plain.map(|bins| bins.map(|bin| bin as f32 * (PI / 32.0)));
        assert_eq!(modes, bins, "{place:?} {half}");
        let Some(modes) = modes else { continue };
        with_modes += 1;
        let edges_rad = modes.map(|angle_rad| turned(&window, angle_rad));
        for (mode_rad, edge_rad) in modes.into_iter().zip(edges_rad) {
            assert!((0.0..PI).contains(&edge_rad), "{edge_rad}");
            let (expected_rad, clearness) = plain_turned(&pixels, f64::from(mode_rad));
            let apart_rad = f64::from(edge_rad) - expected_rad;
            // Single precision, of a direction that a few gradients may say only vaguely.
            let is_same = clearness < 0.05 || apart_rad.sin().abs() < 1e-4;
            assert!(is_same, "{edge_rad} {expected_rad} {clearness}");
        }
        let edges = directions(edges_rad.map(f64::from));
        let ours = intersection(&window, edges.map(single));
        let plain = plain_intersection(&pixels, edges);
        assert_eq!(ours.is_some(), plain.is_some(), "{place:?} {half} {ours:?} {plain:?}");
        let (Some(ours), Some(plain)) = (ours, plain) else {
            without += 1;
            continue;
        };
        with_point += 1;
        for axis in 0..2 {
            // Single precision, where the moments may differ a hundredfold.
            assert!((f64::from(ours[axis]) - plain[axis]).abs() < 1e-3, "{ours:?} {plain:?}");
        }
    }
    assert!(with_modes > 200 && with_point > 100 && without > 20, "{with_modes} {with_point}");
}

#[test]
fn there_is_no_point_where_an_edge_is_missing_or_farther_than_2_px() {
    let mut random = Random::new(35);
    let (mut with_point, mut with_one_edge, mut too_far) = (0, 0, 0);
    for n in 0..600 {
        let noise = random.uniform(0.0, 8.0);
        let bytes = corner(&mut random, noise);
        let place = [(); 2].map(|()| 29 + (random.bits() % 7) as usize);
        let (window, pixels) = filled(&bytes, place, 5 + n % 5);
        let Some([first, second]) = plain_modes(&pixels) else { continue };
        let [first_rad, mut second_rad] =
            [first, second].map(|bin| bin as f64 * core::f64::consts::PI / 32.0);
        // Instead of the second edge, in half of them, a direction that the picture hardly has.
        let is_one_edge = n % 2 == 0;
        if is_one_edge {
            second_rad = 0.5 * (first_rad + second_rad);
        }
        let edges = directions([first_rad, second_rad]);
        let ours = intersection(&window, edges.map(single));
        let plain = plain_intersection(&pixels, edges);
        assert_eq!(ours.is_some(), plain.is_some(), "{n}: {ours:?} {plain:?}");
        let Some((ours, plain)) = ours.zip(plain) else {
            *(if is_one_edge { &mut with_one_edge } else { &mut too_far }) += 1;
            continue;
        };
        with_point += 1;
        for axis in 0..2 {
            // Single precision, where the moments may differ a hundredfold.
            assert!((f64::from(ours[axis]) - plain[axis]).abs() < 1e-3, "{ours:?} {plain:?}");
        }
    }
    let counts = [with_point, with_one_edge, too_far];
    assert!(counts.into_iter().all(|count| count > 30), "{counts:?}");
}

/// Every step by its definition, one after the other.
fn plain_describe(image: &GreyImage<'_, u8>, place: [usize; 2], radius: usize) -> Option<Corner> {
    let [x, y] = place;
    let beside = [x, y, SIDE - 1 - x, SIDE - 1 - y].into_iter().min().unwrap();
    let half = (radius + 3).min(9).min(beside.saturating_sub(1));
    if half < 3 {
        return None;
    }
    let pixels = plain_window(image, place, half);
    let modes_rad = plain_modes(&pixels)?.map(|bin| bin as f64 * core::f64::consts::PI / 32.0);
    let edges_rad = modes_rad.map(|mode_rad| {
        let (edge_rad, _) = plain_turned(&pixels, mode_rad);
        edge_rad.rem_euclid(core::f64::consts::PI)
    });
    if (edges_rad[1] - edges_rad[0]).sin().abs() < 0.4 {
        return None;
    }
    let edges = directions(edges_rad);
    let shift = plain_intersection(&pixels, edges)?;
    let (levels, correlation) = plain_compare(&pixels, half.min(radius + 1), edges, shift)?;
    // Of the pairs of opposite sectors, all of one must be darker than all of the other.
    let [behind, between, opposite, behind_opposite] = levels;
    let dark_between = behind.min(behind_opposite) - between.max(opposite);
    let bright_between = between.min(opposite) - behind.max(behind_opposite);
    let gap = dark_between.max(bright_between);
    let span =
        levels.into_iter().fold(f64::MIN, f64::max) - levels.into_iter().fold(f64::MAX, f64::min);
    if gap < 0.3 * span || span <= 0.0 || correlation < 0.2 {
        return None;
    }
    let [first, second] = edges_rad;
    let is_dark_by_increase = (dark_between > bright_between) == (first < second);
    Some(Corner {
        position_px: [x as f32 + shift[0] as f32, y as f32 + shift[1] as f32],
        score: (correlation * gap / (2.0 * 255.0)) as f32,
        edges_rad: single(if is_dark_by_increase { [first, second] } else { [second, first] }),
    })
}

/// Whether both describe the same corner, which they must, or none.
fn is_described_as_defined(image: &GreyImage<'_, u8>, place: [usize; 2], radius: usize) -> bool {
    let ours = describe(image, place, radius);
    let plain = plain_describe(image, place, radius);
    assert_eq!(ours.is_some(), plain.is_some(), "{place:?} {radius}: {ours:?} {plain:?}");
    let (Some(ours), Some(plain)) = (ours, plain) else { return false };
    for part in 0..2 {
        let apart_px = ours.position_px[part] - plain.position_px[part];
        let apart_rad = libm::sinf(ours.edges_rad[part] - plain.edges_rad[part]);
        // Single precision.
        let is_same = apart_px.abs() < 1e-3 && apart_rad.abs() < 1e-3;
        assert!(is_same, "{place:?} {radius}: {ours:?} {plain:?}");
    }
    let is_same = (ours.score - plain.score).abs() < 1e-4;
    assert!(is_same, "{place:?} {radius}: {ours:?} {plain:?}");
    true
}

#[test]
fn a_corner_is_described_by_its_definition() {
    let (mut described, mut refused) = (0, 0);
    for (n, (bytes, place, _)) in windows(300, 33).enumerate() {
        let image = GreyImage::new(&bytes, SIDE, SIDE, SIDE).unwrap();
        let is_corner = is_described_as_defined(&image, place, [4, 8, 12][n % 3]);
        described += usize::from(is_corner);
        refused += usize::from(!is_corner);
    }
    assert!(described > 100 && refused > 60, "{described} {refused}");
}

#[test]
fn a_window_becomes_smaller_beside_the_border_until_it_says_nothing() {
    let mut random = Random::new(34);
    // Corners 4, 12 and more pixels from each border.
    let board: Vec<u8> = (0..SIDE * SIDE)
        .map(|n| {
            let [x, y] = [n % SIDE, n / SIDE].map(|place| (place + 4) / 8 % 2);
            (60.0 + 100.0 * (x ^ y) as f64 + random.uniform(0.0, 8.0)) as u8
        })
        .collect();
    for (bytes, corners) in [(noise(&mut random), 5), (board, 100)] {
        let image = GreyImage::new(&bytes, SIDE, SIDE, SIDE).unwrap();
        let (mut described, mut refused) = (0, 0);
        for side in 0..4 {
            for place in (0..SIDE * 14).step_by(3).map(|n| [n % SIDE, n / SIDE]) {
                let last = SIDE - 1;
                let [along, into] = place;
                let place =
                    [[along, into], [along, last - into], [into, along], [last - into, along]];
                let is_corner = is_described_as_defined(&image, place[side], 8);
                described += usize::from(is_corner);
                refused += usize::from(!is_corner);
            }
        }
        assert!(described > corners && refused > 200, "{described} {refused}");
    }
}

#[test]
fn edges_along_the_picture_are_0_and_a_quarter_turn() {
    let quadrants: Vec<u8> = (0..SIDE * SIDE)
        .map(|n| if (n % SIDE < 32) == (n / SIDE < 32) { 60 } else { 160 })
        .collect();
    let (window, _) = filled(&quadrants, [32, 32], 7);
    assert_eq!(turned(&window, 0.0), 0.0);
    assert_eq!(turned(&window, 3.1), 0.0);
    assert!((turned(&window, 1.5) - 0.5 * PI).abs() < 1e-6);
    let image = GreyImage::new(&quadrants, SIDE, SIDE, SIDE).unwrap();
    let corner = describe(&image, [32, 32], 4).unwrap();
    // Good to a quarter of a pixel.
    assert!((corner.position_px[0] - 31.5).abs() < 0.25, "{corner:?}");
    assert!((corner.position_px[1] - 31.5).abs() < 0.25, "{corner:?}");
    // Dark up and left, and down and right: from x to y.
    assert_eq!(corner.edges_rad[0], 0.0);
    // Half the contrast, times a correlation that is 1 only where the gradient is.
    assert!(corner.score > 0.5 * 0.5 * 100.0 / 255.0, "{corner:?}");
    assert!(corner.score <= 0.5 * 100.0 / 255.0, "{corner:?}");
}

#[test]
fn of_four_sectors_opposite_ones_are_pairs() {
    // Behind both edges, between them, opposite of that, and beyond both.
    for (levels, gap, span, is_between_dark) in [
        ([100.0, 20.0, 30.0, 90.0], 60.0, 80.0, true),
        ([20.0, 100.0, 90.0, 30.0], 60.0, 80.0, false),
        ([100.0, 50.0, 60.0, 40.0], -50.0, 60.0, false),
        ([40.0, 90.0, 50.0, 100.0], -50.0, 60.0, false),
        ([70.0; 4], 0.0, 0.0, true),
    ] {
        let sectors = Sectors::of(levels);
        assert_eq!((sectors.gap, sectors.span), (gap, span), "{levels:?}");
        assert_eq!(sectors.is_between_dark, is_between_dark, "{levels:?}");
        for (edges_rad, is_increasing) in [([0.5, 2.0], true), ([2.0, 0.5], false)] {
            let [first, second] = edges_rad;
            let expected =
                if is_between_dark == is_increasing { edges_rad } else { [second, first] };
            assert_eq!(sectors.in_order(edges_rad), expected, "{levels:?}");
        }
    }
}
