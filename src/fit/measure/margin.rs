//! Whether the checkerboard goes on where the target's margin should be.
//!
//! A part of a grid fits just as well two squares to the side, or one across and one down. If all of
//! the target can be seen, its pattern then goes on beyond one of the grid's borders at least, where
//! the target has nothing but paper.
//!
//! In: the squares where a pose puts them. Each outermost square is compared with the next one along
//! its border, and so are the places just outside them: in a board that goes on, they differ in the
//! opposite sense. What covers a target does not alternate in step with it.
//!
//! [`crate::find::grid`] makes the same check of a lattice that it has found, of which it knows only
//! the corners; here the squares around them are known as well.

use heapless::Vec;
use nalgebra::Vector2;

use crate::fit::nodes::Nodes;
use crate::limits::TARGET_NODES_MAX;
use crate::model::image::{GreyImage, Pixel};

/// The places outside lie this many squares from the middles of the outermost ones: near enough for
/// a board whose last squares are cut.
const OUTSIDE_STEPS: f64 = 0.8;

/// Difference of neighbouring places outside, relative to the mean one of the squares. On paper
/// there is none.
const DIFFERENCE_MIN: f32 = 0.25;

/// Fewest differences that count as evidence, and the share of all along a border.
const DIFFERENCES_MIN: usize = 3;
const DIFFERENCES_SHARE_MIN: f32 = 0.75;

/// True when the pattern goes on beyond one of the borders.
///
/// Never inlined: the places would stay on the stack during a pass.
#[inline(never)]
pub(super) fn pattern_goes_on<P: Pixel>(image: &GreyImage<'_, P>, nodes: &Nodes) -> bool {
    // The squares' colours do not matter here.
    let middles = nodes.squares(true).map(|square| square.middle_px);
    let middles: Vec<Vector2<f64>, TARGET_NODES_MAX> = middles.collect();
    if middles.is_empty() {
        return false;
    }
    let columns = nodes.columns_of_squares();
    let rows = middles.len() / columns;
    let (right, bottom) = (columns - 1, columns * (rows - 1));
    // The first square of a border, the steps to the next one along it and to the one inside, and
    // the number of squares.
    let borders = [
        (0, 1, columns as isize, columns),
        (bottom, 1, -(columns as isize), columns),
        (0, columns, 1, rows),
        (right, columns, -1, rows),
    ];
    borders.into_iter().any(|(first, step, inwards, count)| {
        alternates((0..count).map(|place| {
            let square = first + place * step;
            let (middle_px, inner_px) =
                (middles[square], middles[square.wrapping_add_signed(inwards)]);
            let outside_px = middle_px + (middle_px - inner_px) * OUTSIDE_STEPS;
            Some([image.mean_around(middle_px.into())?, image.mean_around(outside_px.into())?])
        }))
    })
}

/// Whether the places outside a border alternate, against its squares; each item is the brightness
/// of a square and of the place outside it.
fn alternates(places: impl Iterator<Item = Option<[f32; 2]>>) -> bool {
    let mut differences: Vec<[f32; 2], TARGET_NODES_MAX> = Vec::new();
    let mut previous: Option<[f32; 2]> = None;
    for place in places {
        if let (Some([square, outside]), Some([last_square, last_outside])) = (place, previous) {
            let inside = square - last_square;
            let against = (last_outside - outside) * inside.signum();
            // A border has fewer squares than a target.
            let _ = differences.push([inside.abs(), against]);
        }
        previous = place;
    }
    let count = differences.len() as f32;
    let mean = differences.iter().map(|[inside, _]| inside).sum::<f32>() / count;
    let agreeing = differences.iter().filter(|[_, against]| *against > DIFFERENCE_MIN * mean);
    let agreeing = agreeing.count();
    agreeing >= DIFFERENCES_MIN && agreeing as f32 >= DIFFERENCES_SHARE_MIN * count
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::model::lens::{Distortion, Lens};
    use crate::model::pose::{Cam, Pose, Target};
    use crate::model::target::{Origin, Role, TargetGeometry};
    use crate::test_support::table;

    const WIDTH: usize = 200;
    const HEIGHT: usize = 160;

    /// A pixel in squares, of 20 pixels: 5 columns and 4 rows of them are the target's, from (0, 0) on.
    fn in_squares([column, row]: [usize; 2]) -> [f64; 2] {
        [(column as f64 - 50.0) / 20.0, (row as f64 - 40.0) / 20.0]
    }

    /// The nodes of these squares.
    fn nodes() -> Nodes {
        let lens = Lens {
            width_px: WIDTH as u16,
            height_px: HEIGHT as u16,
            fx_px: 1000.0,
            fy_px: 1000.0,
            // The middle of the target.
            cx_px: 100.0,
            cy_px: 80.0,
            skew_px: 0.0,
            distortion: Distortion::Radial2([0.0; 2]),
        };
        let target =
            TargetGeometry::checker(4, 3, 20.0, Origin::Center, Role::Upper, [0.0; 3]).unwrap();
        let pose = Pose::<Cam, Target>::from_theta([0.0, 0.0, 0.0, 0.0, 0.0, 1000.0]);
        let mut nodes = Nodes::new();
        assert!(nodes.project(&table(&lens), &target, &pose));
        nodes
    }

    /// A board of dark and light squares between these places, in squares, on paper.
    fn goes_on(x: [f64; 2], y: [f64; 2]) -> bool {
        let pixels: Vec<u8> = (0..HEIGHT)
            .flat_map(|row| (0..WIDTH).map(move |column| in_squares([column, row])))
            .map(|[at_x, at_y]| {
                let is_inside = (x[0]..x[1]).contains(&at_x) && (y[0]..y[1]).contains(&at_y);
                let is_even = (libm::floor(at_x) + libm::floor(at_y)) % 2.0 == 0.0;
                if is_inside && is_even { 40 } else { 200 }
            })
            .collect();
        let image = GreyImage::new(&pixels, WIDTH, HEIGHT, WIDTH).unwrap();
        pattern_goes_on(&image, &nodes())
    }

    #[test]
    fn a_board_may_go_on_beyond_each_of_the_borders() {
        assert!(!goes_on([0.0, 5.0], [0.0, 4.0]));
        // The outermost squares are cut in the middle.
        assert!(goes_on([-0.5, 5.0], [0.0, 4.0]));
        assert!(goes_on([0.0, 5.5], [0.0, 4.0]));
        assert!(goes_on([0.0, 5.0], [-0.5, 4.0]));
        assert!(goes_on([0.0, 5.0], [0.0, 4.5]));
        // What is left of them is less than is looked for.
        assert!(!goes_on([-0.2, 5.2], [-0.2, 4.2]));
    }

    #[test]
    fn without_nodes_nothing_goes_on() {
        let pixels = [128_u8; 64 * 64];
        let image = GreyImage::new(&pixels, 64, 64, 64).unwrap();
        assert!(!pattern_goes_on(&image, &Nodes::new()));
    }

    #[test]
    fn a_difference_counts_from_a_quarter_of_that_of_the_squares() {
        // Squares differ by 160, a quarter of which is 40.
        let border = |steps: &[f32]| {
            let mut outside = 100.0;
            let mut square = 40.0;
            let mut places = std::vec![Some([square, outside])];
            for step in steps {
                // The squares become lighter and darker in turn.
                let sign = if square < 100.0 { 1.0 } else { -1.0 };
                square += sign * 160.0;
                outside -= sign * step;
                places.push(Some([square, outside]));
            }
            alternates(places.into_iter())
        };
        assert!(border(&[40.5; 3]) && !border(&[39.5; 3]));
        assert!(!border(&[-40.5; 3]));
        // Three at least, and three quarters of all.
        assert!(!border(&[160.0; 2]));
        assert!(border(&[160.0, 160.0, 160.0, 0.0]));
        assert!(!border(&[160.0, 160.0, 160.0, 0.0, 0.0]));
        assert!(border(&[160.0, 160.0, 0.0, 160.0, 160.0]));
        assert!(!border(&[160.0, 160.0, 160.0, 160.0, 0.0, 0.0]));
    }

    #[test]
    fn what_goes_on_alternates_against_the_squares() {
        let border = |outside: [f32; 6]| {
            let squares = [200.0, 30.0, 190.0, 25.0, 205.0, 35.0];
            alternates(squares.into_iter().zip(outside).map(|(it, outside)| Some([it, outside])))
        };
        assert!(border([40.0, 180.0, 30.0, 200.0, 35.0, 190.0]));
        // A piece of it is covered at one end.
        assert!(border([40.0, 180.0, 30.0, 200.0, 35.0, 40.0]));
        // Paper, hair, and the squares themselves once more.
        assert!(!border([200.0; 6]));
        assert!(!border([40.0, 45.0, 38.0, 52.0, 41.0, 37.0]));
        assert!(!border([200.0, 30.0, 190.0, 25.0, 205.0, 35.0]));
        // No difference anywhere.
        assert!(!alternates([Some([100.0; 2]); 6].into_iter()));
        // Too few places inside the frame.
        let two = [Some([200.0, 30.0]), Some([30.0, 200.0]), None, Some([190.0, 30.0])];
        assert!(!alternates(two.into_iter()));
        assert!(!alternates(core::iter::empty()));
    }
}
