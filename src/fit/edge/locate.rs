//! The coarse step: lines of pixels across an edge.

use nalgebra::Vector2;

use super::seen::{CONTRAST_MIN, SeenEdge};
use crate::fit::nodes::{Edge, Nodes};
use crate::model::image::{GreyImage, Pixel};

/// Where the lines cross the edge, from its middle, in units of its length: clear of the crossings
/// at its ends.
const PLACES: [f64; 2] = [-0.2, 0.2];

/// Largest distance from the expected position, in px, and as a share of the distance to the next
/// line.
const REACH_PX_MAX: f64 = 12.0;
const REACH_SHARE: f64 = 0.42;
/// Shortest line on each side, px.
const REACH_PX_MIN: usize = 2;

/// Pixels of the longest line: both sides and the middle.
const LINE_PX_MAX: usize = 2 * REACH_PX_MAX as usize + 1;

/// One pixel in fixed point; a pixel's coordinates stay below 32,768.
const ONE_PX: i32 = 1 << 16;

/// The two sides of an edge must differ by this share of the line's whole range.
const STEP_SHARE_MIN: f32 = 0.4;

/// Standard deviation of a located position; it only weights edges against each other.
const SIGMA_PX: f64 = 0.2;

/// Finds an edge near the expected one; `None` where there is none with its colours.
///
/// On a line that a step divides into light and dark, the sum of the pixels gives the step's
/// position: neither the blur nor a distant start matters, as long as no other edge intrudes. The
/// lines run at right angles to the edge, however the target is turned, through the nearest pixels.
pub fn locate_edge<P: Pixel>(
    image: &GreyImage<'_, P>,
    nodes: &Nodes,
    edge: &Edge,
) -> Option<SeenEdge> {
    let chord = nodes.chord(edge);
    let along = chord.end_px - chord.start_px;
    let right = chord.right;
    let spacing_px = chord.across_px.dot(&right).abs();
    let reach = (REACH_SHARE * spacing_px).min(REACH_PX_MAX) as usize;
    if reach < REACH_PX_MIN {
        return None;
    }
    let middle_px = (chord.start_px + chord.end_px) * 0.5;
    let mut shifts_px = [0.0; PLACES.len()];
    for (place, shift_px) in PLACES.iter().zip(&mut shifts_px) {
        let expected_px = middle_px + along * *place;
        *shift_px = step_on_line(image, &expected_px, &right, reach, edge.is_right_light)?;
    }
    let [start, end] = shifts_px;
    let (shift, turn) = (0.5 * (start + end), (end - start) / (PLACES[1] - PLACES[0]));
    // The precisions of a mean of two, and of a slope from two.
    let precisions = [libm::sqrt(2.0), libm::sqrt(2.0) * PLACES[1]].map(|root| root / SIGMA_PX);
    let ends = edge.nodes.map(|node| &nodes.as_slice()[usize::from(node)]);
    let whitener = [precisions[0], 0.0, precisions[1]];
    let seen = [precisions[0] * shift, precisions[1] * turn];
    Some(SeenEdge::new(*edge, ends, &right, whitener, seen))
}

/// From the expected position to the step, along a line to the right, in px.
fn step_on_line<P: Pixel>(
    image: &GreyImage<'_, P>,
    expected_px: &Vector2<f64>,
    right: &Vector2<f64>,
    reach: usize,
    is_right_light: bool,
) -> Option<f64> {
    // The whole line must be inside the frame.
    image.window_centre((*expected_px).into(), reach)?;
    let count = 2 * reach + 1;
    let mut line = [0.0_f32; LINE_PX_MAX];
    let line = line.get_mut(..count)?;
    // Fixed point: a conversion of a float costs more than all the rest.
    let fixed = |px: f64| (px * f64::from(ONE_PX)) as i32;
    let start_px = expected_px - right * reach as f64;
    let [mut x, mut y] = [fixed(start_px.x), fixed(start_px.y)];
    let step = [fixed(right.x), fixed(right.y)];
    let per_px = right.map(|part| part as f32 / ONE_PX as f32);
    // How far along the line the nearest pixels really lie, from the expected position.
    let mut distances = [0.0_f32; LINE_PX_MAX];
    let distances = distances.get_mut(..count)?;
    // Little but loads, so that the processor waits for many of them at once: these are the first
    // accesses to a frame's pixels.
    for (place, (value, distance)) in line.iter_mut().zip(distances.iter_mut()).enumerate() {
        let [column, row] = [x, y].map(|at| (at + ONE_PX / 2) >> ONE_PX.trailing_zeros());
        *value = image.pixel(column as usize, row as usize).into();
        let beside = [column * ONE_PX - x, row * ONE_PX - y].map(|part| part as f32);
        let on_line = place as f32 - reach as f32;
        *distance = on_line + beside[0] * per_px.x + beside[1] * per_px.y;
        x += step[0];
        y += step[1];
    }
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for &value in line.iter() {
        low = if value < low { value } else { low };
        high = if value > high { value } else { high };
    }
    let range = high - low;
    if range < CONTRAST_MIN * f32::from(image.white_level()) {
        return None;
    }
    // The outer thirds must have the expected colours.
    let third = count.div_ceil(3);
    let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
    let step = mean(&line[count - third..]) - mean(&line[..third]);
    if (if is_right_light { step } else { -step }) < STEP_SHARE_MIN * range {
        return None;
    }
    // The area under the pixels' levels, each of which extends halfway to its neighbours; the line
    // begins and ends half a pixel beyond its outermost ones.
    let (start, end) = (distances[0] - 0.5, distances[count - 1] + 0.5);
    let mut light = 0.0;
    for place in 0..count {
        let before =
            if place == 0 { start } else { 0.5 * (distances[place - 1] + distances[place]) };
        let after =
            if place + 1 == count { end } else { 0.5 * (distances[place] + distances[place + 1]) };
        light += (line[place] - low) * (after - before);
    }
    let light = light / range;
    Some(f64::from(if is_right_light { end - light } else { start + light }))
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec;
    use std::vec::Vec;

    use super::*;
    use crate::fit::edge::rendered::{Scene, image};
    use crate::test_support::Random;

    const SIDE: usize = 64;

    /// Where the step is on a line, by the definition and without fixed point. The inner `None` is a
    /// line without a step; the outer one, a line where it depends on rounding which pixels are nearest
    /// or whether there is a step.
    fn step_by_definition(
        pixels: &[u8],
        expected_px: &Vector2<f64>,
        right: &Vector2<f64>,
        reach: usize,
        is_right_light: bool,
    ) -> Option<Option<f64>> {
        let (mut levels, mut distances) = (Vec::new(), Vec::new());
        for place in 0..=2 * reach {
            let on_line = expected_px + right * (place as f64 - reach as f64);
            let nearest = on_line.map(f64::round);
            if (on_line - nearest).amax() > 0.499 {
                return None;
            }
            levels.push(f64::from(pixels[nearest.y as usize * SIDE + nearest.x as usize]));
            distances.push((nearest - expected_px).dot(right));
        }
        let low = levels.iter().copied().fold(f64::INFINITY, f64::min);
        let range = levels.iter().copied().fold(0.0, f64::max) - low;
        let third = levels.len().div_ceil(3);
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let step = mean(&levels[levels.len() - third..]) - mean(&levels[..third]);
        let step = if is_right_light { step } else { -step };
        // Two fifths exactly are more or less after rounding.
        if (step - 0.4 * range).abs() < 1e-4 {
            return None;
        }
        if range < 0.025 * 255.0 || step < 0.4 * range {
            return Some(None);
        }
        // Where each pixel begins, and the last one ends.
        let mut sides = vec![distances[0] - 0.5];
        sides.extend(distances.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])));
        sides.push(distances[2 * reach] + 0.5);
        let parts = levels.iter().zip(sides.windows(2));
        let light: f64 =
            parts.map(|(level, side)| (level - low) / range * (side[1] - side[0])).sum();
        Some(Some(if is_right_light { sides[2 * reach + 1] - light } else { sides[0] + light }))
    }

    #[test]
    fn the_step_on_a_line_is_where_the_sum_of_its_pixels_puts_it() {
        let mut random = Random::new(31);
        let (mut found, mut none) = (0, 0);
        for _ in 0..2000 {
            let angle = random.uniform(0.0, core::f64::consts::TAU);
            let right = Vector2::new(libm::cos(angle), libm::sin(angle));
            let expected_px = Vector2::new(random.uniform(20.0, 44.0), random.uniform(20.0, 44.0));
            let reach = 2 + (random.bits() % 11) as usize;
            let is_right_light = random.bits().is_multiple_of(2);
            let off_px = random.uniform(-0.6, 0.6) * reach as f64;
            let contrast = random.uniform(0.0, 30.0) * if is_right_light { 1.0 } else { -1.0 };
            let noise = random.uniform(0.0, 8.0);
            let pixels: Vec<u8> = (0..SIDE * SIDE)
                .map(|place| {
                    let at = Vector2::new((place % SIDE) as f64, (place / SIDE) as f64);
                    let from_step = (at - expected_px).dot(&right) - off_px;
                    let share = from_step.clamp(-1.0, 1.0);
                    (100.0 + contrast * share + noise * random.uniform(-1.0, 1.0)) as u8
                })
                .collect();
            let image = GreyImage::new(&pixels, SIDE, SIDE, SIDE).unwrap();
            let step = step_on_line(&image, &expected_px, &right, reach, is_right_light);
            let Some(expected) =
                step_by_definition(&pixels, &expected_px, &right, reach, is_right_light)
            else {
                continue;
            };
            match (step, expected) {
                // Fixed point is cut off at 2^-16 px, for each of 24 steps.
                (Some(step), Some(expected)) => {
                    assert!((step - expected).abs() < 1e-3, "{step} {expected}");
                    found += 1;
                }
                (None, None) => none += 1,
                _ => panic!("{step:?} {expected:?}"),
            }
        }
        assert!(found > 1000 && none > 100, "{found} {none}");
    }

    /// A line of pixels in the middle of a picture, with this white level, to the right.
    fn on_row(levels: [u16; 9], white_level: u16) -> Option<f64> {
        let mut pixels = vec![0; SIDE * SIDE];
        pixels[30 * SIDE + 26..][..9].copy_from_slice(&levels);
        let image = GreyImage::with_white_level(&pixels, SIDE, SIDE, SIDE, white_level).unwrap();
        step_on_line(&image, &Vector2::new(30.25, 30.0), &Vector2::new(1.0, 0.0), 4, true)
    }

    #[test]
    fn a_step_in_a_row_is_found_exactly() {
        // A fifth of the pixel at 31 is light: the step is at 31.3, and was expected at 30.25.
        let step = on_row([20, 20, 20, 20, 20, 60, 220, 220, 220], 255).unwrap();
        // Rounding to 24 bits.
        assert!((step - 1.05).abs() < 1e-6, "{step}");
    }

    #[test]
    fn a_step_has_the_least_contrast_and_sets_the_outer_thirds_apart() {
        // A fortieth of white.
        let of_height = |height: u16| {
            let levels = [0, 0, 0, 0, 1, 1, 1, 1, 1].map(|is_light| 500 + is_light * height);
            on_row(levels, 40_000)
        };
        assert!(of_height(1000).is_some() && of_height(999).is_none());
        // The outer thirds differ by 60, two fifths of the whole range.
        assert!(on_row([50, 50, 50, 50, 200, 200, 110, 110, 110], 255).is_some());
        assert!(on_row([50, 50, 50, 50, 200, 200, 109, 110, 110], 255).is_none());
    }

    /// The edges of a picture of the scene that are found from another pose, and how many there are.
    fn located(scene: &Scene, expected: &Scene) -> (Vec<SeenEdge>, usize) {
        let pixels = scene.render().noise_free();
        let nodes = expected.nodes(&expected.cam_from_target);
        let edges: Vec<Edge> = nodes.edges(scene.first_square_dark).collect();
        let locate = |edge| locate_edge(&image(&pixels), &nodes, edge);
        (edges.iter().filter_map(locate).collect(), edges.len())
    }

    /// How far from the true shift and turn an edge is, px.
    fn errors_px(seen: &SeenEdge, scene: &Scene) -> [f64; 2] {
        let nodes = scene.nodes(&scene.cam_from_target);
        let rays = seen.edge.nodes.map(|node| &nodes.as_slice()[usize::from(node)].ray);
        let [shift, turn] = seen.residual(rays);
        [shift / seen.whitener[0], turn / seen.whitener[2]]
    }

    #[test]
    fn a_located_edge_has_its_shift_and_its_turn() {
        let scene = Scene::new(21.0, 0.0, 0.0);
        let moved = Scene { cam_from_target: scene.moved_px([1.7, -1.2]), ..scene.clone() };
        let turned = Scene::new(21.0, 0.0, 0.02);
        // A pixel is up to half a pixel beside its line, which the turn makes 0.01 px, 0.4 lengths apart;
        // and where the line crosses the edge, it is 1 px farther along, which makes 0.02 px.
        for (expected, bounds_px) in [(moved, [0.005, 0.005]), (turned, [0.03, 0.05])] {
            let (found, edges) = located(&scene, &expected);
            assert_eq!(found.len(), edges);
            let mut worst_px = [0.0_f64; 2];
            for seen in &found {
                for (worst_px, error_px) in worst_px.iter_mut().zip(errors_px(seen, &scene)) {
                    *worst_px = worst_px.max(error_px.abs());
                }
                // The mean of two positions of 0.2 px, and their difference for 0.4 of the length.
                let root = core::f64::consts::SQRT_2;
                assert!((seen.shift_px().1 - 0.2 / root).abs() < 1e-15);
                assert!((seen.whitener[2] - 0.4 / (0.2 * root)).abs() < 1e-15);
            }
            assert!(worst_px[0] < bounds_px[0] && worst_px[1] < bounds_px[1], "{worst_px:?}");
        }
    }

    #[test]
    fn edges_of_the_smallest_and_of_large_squares_are_located() {
        // Lines of 2 px on each side, and of 12 px.
        for (pitch_px, psf_px, off_px, share) in [(5.5, 0.3, 0.5, 1.0), (38.0, 0.7, 4.0, 0.5)] {
            let scene = Scene { psf_px, ..Scene::new(pitch_px, 0.0, 0.0) };
            let expected =
                Scene { cam_from_target: scene.moved_px([off_px, off_px]), ..scene.clone() };
            let (found, edges) = located(&scene, &expected);
            assert!(found.len() as f64 >= share * edges as f64, "{pitch_px}: {}", found.len());
            for seen in &found {
                let [shift_px, _] = errors_px(seen, &scene);
                assert!(shift_px.abs() < 0.25, "{pitch_px}: {shift_px}");
            }
        }
    }
}
