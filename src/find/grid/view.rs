//! The picture in the coordinates of a lattice: how bright a place is, and whether that is paper.
//!
//! Paper is as bright as the light squares. Their brightness is fitted as a linear function of the
//! place, which follows light that falls from one side, but not the edge of a shadow: paper in a
//! shadow is taken for a cover.

use nalgebra::{SMatrix, SVector};

use super::lattice::{Bounds, Lattice};
use super::plane::Plane;
use crate::find::corner::Corner;
use crate::model::image::{GreyImage, Pixel};

/// What differs from the light squares by less than this share of the contrast is paper. Noise of
/// three grey levels, averaged over 3 x 3 pixels, is a hundredth.
const PAPER_SHARE: f32 = 0.05;
/// Beside the edge of a square, blur adds to that.
const PAPER_BESIDE_EDGE_SHARE: f32 = 0.1;
const NEARLY_PAPER_SHARE: f32 = 0.2;
/// What differs from the dark squares by less than this share is ink; nearly ink if blur, which adds
/// to that from both edges beside a corner, may have brightened it.
const INK_SHARE: f32 = 0.1;
const NEARLY_INK_SHARE: f32 = 0.3;
/// How little the brightness changes along a board: as if so many squares were known to show no
/// slope. It matters where few squares are seen.
const SLOPE_WEIGHT: f32 = 4.0;

/// A lattice in its picture.
pub(super) struct View<'a, P> {
    image: &'a GreyImage<'a, P>,
    lattice: &'a Lattice,
    pub(super) plane: Plane,
    /// The mean difference between light and dark squares.
    pub(super) contrast: f32,
    light: Shading,
}

/// A brightness: 1, u and v are multiplied by these.
type Shading = SVector<f32, 3>;

impl<'a, P: Pixel> View<'a, P> {
    /// `None` where the corners fix no plane, or where light squares are not lighter than dark ones.
    pub(super) fn new(
        image: &'a GreyImage<'a, P>,
        lattice: &'a Lattice,
        corners: &[Corner],
        extent: Bounds,
    ) -> Option<Self> {
        let plane = Plane::fit(lattice, corners)?;
        let mut view = Self { image, lattice, plane, contrast: 0.0, light: Shading::zeros() };
        view.light = view.shading(extent, false)?;
        let dark = view.shading(extent, true)?;
        let [u, v] = [0, 1].map(|axis| 0.5 * (extent.first[axis] + extent.last[axis]) as f32);
        view.contrast = (view.light - dark).dot(&Shading::from([1.0, u, v]));
        (view.contrast > 0.0).then_some(view)
    }

    /// The brightness at a place: the mean of 3 x 3 pixels.
    pub(super) fn level(&self, place: [f32; 2]) -> Option<f32> {
        self.image.mean_around(self.plane.at(place)?.map(f64::from))
    }

    /// The brightness of paper at a place.
    pub(super) fn paper_level(&self, [u, v]: [f32; 2]) -> f32 {
        self.light.dot(&Shading::from([1.0, u, v]))
    }

    /// The brightness of a light or of a dark square at a place.
    pub(super) fn square_level(&self, place: [f32; 2], is_dark: bool) -> f32 {
        self.paper_level(place) - if is_dark { self.contrast } else { 0.0 }
    }

    /// Whether paper is seen at a place.
    pub(super) fn is_paper(&self, place: [f32; 2]) -> bool {
        self.is_near_paper(place, PAPER_SHARE)
    }

    /// Whether paper is seen at a place a third of a square from an edge.
    pub(super) fn is_paper_beside_edge(&self, place: [f32; 2]) -> bool {
        self.is_near_paper(place, PAPER_BESIDE_EDGE_SHARE)
    }

    /// Whether a place is nearly as bright as paper, as a margin is that another side shows to be as
    /// wide.
    pub(super) fn is_nearly_paper(&self, place: [f32; 2]) -> bool {
        self.is_near_paper(place, NEARLY_PAPER_SHARE)
    }

    /// Whether ink is seen at a place.
    pub(super) fn is_ink(&self, place: [f32; 2]) -> bool {
        self.is_near_ink(place, INK_SHARE)
    }

    /// Whether a place is nearly as dark as ink.
    pub(super) fn is_nearly_ink(&self, place: [f32; 2]) -> bool {
        self.is_near_ink(place, NEARLY_INK_SHARE)
    }

    fn is_near_ink(&self, place: [f32; 2], share: f32) -> bool {
        let ink = self.square_level(place, true);
        self.level(place).is_some_and(|level| (level - ink).abs() < share * self.contrast)
    }

    fn is_near_paper(&self, place: [f32; 2], share: f32) -> bool {
        let paper = self.paper_level(place);
        self.level(place).is_some_and(|level| (level - paper).abs() < share * self.contrast)
    }

    /// Whether the corner at a place is seen.
    pub(super) fn is_seen(&self, cell: [i32; 2]) -> bool {
        self.lattice.corner(cell).is_some()
    }

    /// Whether the square from a place along u and v is dark.
    pub(super) fn is_dark(&self, cell: [i32; 2]) -> bool {
        self.lattice.edge_along_u(cell) == 0
    }

    /// The length of a lattice step at a place, pixels.
    pub(super) fn step_px(&self, place: [f32; 2], step: [i32; 2]) -> Option<f32> {
        let steps = self.plane.steps(place)?;
        let [dx, dy] = steps[usize::from(step[0] == 0)];
        Some(libm::hypotf(dx, dy))
    }

    /// The brightness of the light or of the dark squares, from those of which all four corners are
    /// seen, or, if there are none, from those just outside with two corners; `None` where there are
    /// none of these.
    fn shading(&self, extent: Bounds, is_dark: bool) -> Option<Shading> {
        let outside = extent.squares().cells().filter(|&cell| {
            !(extent.contains(cell) && extent.contains([cell[0] + 1, cell[1] + 1]))
        });
        self.shading_of(extent.cells(), 4, is_dark).or_else(|| self.shading_of(outside, 2, is_dark))
    }

    /// The brightness of those squares of which this many corners are seen.
    fn shading_of(
        &self,
        squares: impl Iterator<Item = [i32; 2]>,
        corners: usize,
        is_dark: bool,
    ) -> Option<Shading> {
        let slopes = Shading::from([0.0, SLOPE_WEIGHT, SLOPE_WEIGHT]);
        let mut normal = SMatrix::<f32, 3, 3>::from_diagonal(&slopes);
        let mut right = Shading::zeros();
        for cell in squares.filter(|&cell| self.is_dark(cell) == is_dark) {
            let [u, v] = cell;
            let seen = [[u, v], [u + 1, v], [u, v + 1], [u + 1, v + 1]]
                .into_iter()
                .filter(|&cell| self.is_seen(cell));
            let middle = [u as f32 + 0.5, v as f32 + 0.5];
            if seen.count() == corners
                && let Some(level) = self.level(middle)
            {
                let terms = Shading::from([1.0, middle[0], middle[1]]);
                normal += terms * terms.transpose();
                right += terms * level;
            }
        }
        Some(normal.cholesky()?.solve(&right))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use nalgebra::{Matrix3, Vector3};

    use super::*;
    use crate::find::grid::lattice::Least;
    use crate::find::grid::tests::drawn::{DARK, Drawn, LIGHT, STEP_PX, grown};
    use crate::test_support::Random;

    #[test]
    fn light_squares_are_as_bright_as_paper_and_dark_ones_less_by_the_contrast() {
        Drawn::new([4, 3]).seen(|view, _| {
            // Rounding in single precision.
            let is = |value: f32, expected: u8| (value - f32::from(expected)).abs() < 1e-3;
            assert!(is(view.contrast, LIGHT - DARK), "{}", view.contrast);
            for place in [[0.0, 0.0], [1.5, 0.5], [-3.0, 7.0]] {
                assert!(is(view.paper_level(place), LIGHT), "{place:?}");
                assert!(is(view.square_level(place, false), LIGHT), "{place:?}");
                assert!(is(view.square_level(place, true), DARK), "{place:?}");
            }
            assert_eq!(view.level([0.5, 0.5]), Some(f32::from(DARK)));
            assert_eq!(view.level([1.5, 0.5]), Some(f32::from(LIGHT)));
            assert_eq!(view.level([1000.0, 0.5]), None);
            assert!(view.is_dark([0, 0]) && view.is_dark([-1, -1]) && view.is_dark([1, 1]));
            assert!(!view.is_dark([1, 0]) && !view.is_dark([0, -1]));
            assert!(view.is_seen([0, 0]) && view.is_seen([3, 2]));
            assert!(!view.is_seen([4, 2]) && !view.is_seen([0, -1]));
            for (step, expected) in [([1, 0], 0), ([-1, 0], 0), ([0, 1], 1), ([0, -1], 1)] {
                let step_px = view.step_px([0.5, 0.5], step).unwrap();
                assert!((step_px - STEP_PX[expected] as f32).abs() < 1e-3, "{step:?}: {step_px}");
            }
        });
    }

    /// Where light falls from one side: a regression of the light squares' brightness on u and v, with four
    /// more observations of each slope, which are 0.
    #[test]
    fn the_brightness_of_paper_follows_the_light() {
        let mut drawn = Drawn::new([5, 4]);
        let level = |u: i32, v: i32, is_dark: bool| {
            let light = 170 + 8 * u - 5 * v;
            (if is_dark { light - 100 + 2 * u } else { light }) as u8
        };
        let squares = || (0..3).flat_map(|v| (0..4).map(move |u| [u, v]));
        for [u, v] in squares() {
            let [from_u, from_v] = [u, v].map(f64::from);
            let is_dark = (u + v) % 2 == 0;
            drawn.paint(from_u..from_u + 1.0, from_v..from_v + 1.0, level(u, v, is_dark));
        }
        let regression = |is_dark: bool| {
            let mut normal = Matrix3::from_diagonal(&Vector3::new(0.0, 4.0, 4.0));
            let mut right = Vector3::zeros();
            for [u, v] in squares().filter(|[u, v]| ((u + v) % 2 == 0) == is_dark) {
                let terms = Vector3::new(1.0, f64::from(u) + 0.5, f64::from(v) + 0.5);
                normal += terms * terms.transpose();
                right += terms * f64::from(level(u, v, is_dark));
            }
            normal.try_inverse().unwrap() * right
        };
        drawn.seen(|view, _| {
            let [light, dark] = [false, true].map(regression);
            for [u, v] in [[0.0, 0.0], [2.0, 1.5], [4.0, -1.0], [-1.0, 3.0]] {
                let expected = light.dot(&Vector3::new(1.0, u, v));
                let paper = view.paper_level([u as f32, v as f32]);
                // Single precision.
                assert!((f64::from(paper) - expected).abs() < 0.01, "{u} {v}: {paper} {expected}");
            }
            // The contrast is that in the middle of the corners: at u = 2, v = 1.5.
            let expected = (light - dark).dot(&Vector3::new(1.0, 2.0, 1.5));
            assert!((f64::from(view.contrast) - expected).abs() < 0.01, "{}", view.contrast);
        });
    }

    #[test]
    fn paper_and_ink_are_what_is_nearly_as_bright() {
        // Of a contrast of 120: 5 % and 10 % and 20 % of it, and for ink 10 % and 30 %.
        for difference in [5_u8, 7, 11, 13, 23, 25, 35, 37] {
            for is_brighter in [true, false] {
                let mut drawn = Drawn::new([4, 3]);
                let near =
                    |level: u8| if is_brighter { level + difference } else { level - difference };
                // Where nothing else looks: in a corner of a light square, and of a dark one.
                drawn.paint(1.6..2.0, 0.6..1.0, near(LIGHT));
                drawn.paint(0.6..1.0, 0.6..1.0, near(DARK));
                drawn.seen(|view, _| {
                    let [light, dark] = [[1.8, 0.8], [0.8, 0.8]];
                    assert_eq!(view.is_paper(light), difference < 6, "{difference}");
                    assert_eq!(view.is_paper_beside_edge(light), difference < 12, "{difference}");
                    assert_eq!(view.is_nearly_paper(light), difference < 24, "{difference}");
                    assert_eq!(view.is_ink(dark), difference < 12, "{difference}");
                    assert_eq!(view.is_nearly_ink(dark), difference < 36, "{difference}");
                    assert!(!view.is_nearly_paper(dark) && !view.is_nearly_ink(light));
                    assert!(!view.is_paper([1000.0, 0.0]) && !view.is_ink([1000.0, 0.0]));
                });
            }
        }
    }

    /// Where no light square has four corners that are seen, those just outside with two are looked at, and
    /// no others.
    #[test]
    fn squares_outside_serve_where_none_inside_is_seen() {
        let mut drawn = Drawn::new([3, 3]);
        // The light squares inside, each of which lacks a corner.
        drawn.paint(1.0..2.0, 0.0..1.0, 230);
        drawn.paint(0.0..1.0, 1.0..2.0, 230);
        drawn.hide(&[[2, 0], [0, 2]]);
        let (lattice, bounds) = grown(&drawn.corners, Least::Piece { gap: 1 });
        let image = drawn.image();
        let view = View::new(&image, &lattice, &drawn.corners, bounds).unwrap();
        assert!((view.contrast - 120.0).abs() < 1e-3, "{}", view.contrast);
        assert!((view.paper_level([1.0, 1.0]) - 180.0).abs() < 1e-3);
    }

    /// By the definition: a regression over the squares of one colour of which all four corners are seen; if
    /// there are none, over those at the outside of the extent of which two are.
    #[test]
    fn the_shading_is_that_of_whole_squares_or_of_those_outside_with_two_corners() {
        let mut random = Random::new(60);
        // From squares inside, from those outside, and from none.
        let mut outcomes = [0; 3];
        for number in 0..150 {
            let mut drawn = Drawn::new([4, 4]);
            for [u, v] in (-1..4).flat_map(|v| (-1..4).map(move |u| [u, v])) {
                let [from_u, from_v] = [u, v].map(f64::from);
                let level = random.uniform(50.0, 200.0) as u8;
                drawn.paint(from_u..from_u + 1.0, from_v..from_v + 1.0, level);
            }
            let (mut lattice, extent) = grown(&drawn.corners, Least::Target);
            let plane = Plane::fit(&lattice, &drawn.corners).unwrap();
            let share = random.uniform(0.0, 0.9);
            for cell in extent.cells() {
                if random.uniform(0.0, 1.0) < share {
                    lattice.remove(cell);
                }
            }
            let image = drawn.image();
            let (contrast, light) = (0.0, Shading::zeros());
            let view = View { image: &image, lattice: &lattice, plane, contrast, light };
            let regression = |is_dark: bool, is_inside: bool| {
                let squares = (-1..4).flat_map(|v| (-1..4).map(move |u| [u, v]));
                let mut normal = Matrix3::from_diagonal(&Vector3::new(0.0, 4.0, 4.0));
                let mut right = Vector3::zeros();
                for [u, v] in squares {
                    let corners = [[u, v], [u + 1, v], [u, v + 1], [u + 1, v + 1]];
                    let seen = corners.iter().filter(|&&cell| view.is_seen(cell)).count();
                    let is_on_board = |cell: &[i32; 2]| cell.iter().all(|at| (0..4).contains(at));
                    let is_in_extent = corners.iter().all(is_on_board);
                    let is_used = if is_inside { seen == 4 } else { seen == 2 && !is_in_extent };
                    if is_used && ((u + v).rem_euclid(2) == 0) == is_dark {
                        let middle = [f64::from(u) + 0.5, f64::from(v) + 0.5];
                        let level = view.level(middle.map(|value| value as f32)).unwrap();
                        let terms = Vector3::new(1.0, middle[0], middle[1]);
                        normal += terms * terms.transpose();
                        right += terms * f64::from(level);
                    }
                }
                (normal[(0, 0)] > 0.0).then(|| normal.try_inverse().unwrap() * right)
            };
            for is_dark in [false, true] {
                let [inside, outside] = [true, false].map(|it| regression(is_dark, it));
                outcomes[if inside.is_some() { 0 } else { 1 + usize::from(outside.is_none()) }] +=
                    1;
                let shading = view.shading(extent, is_dark);
                assert_eq!(shading.is_some(), inside.or(outside).is_some(), "{number}");
                let Some((shading, expected)) = shading.zip(inside.or(outside)) else { continue };
                // Single precision.
                let off = (shading.map(f64::from) - expected).norm();
                assert!(off < 0.01, "{number}: {shading:?} {expected:?}");
            }
        }
        assert!(outcomes.iter().all(|&count| count >= 10), "{outcomes:?}");
    }

    #[test]
    fn a_board_whose_light_squares_are_dark_is_none() {
        let mut drawn = Drawn::new([4, 3]);
        for byte in &mut drawn.bytes {
            *byte = 255 - *byte;
        }
        let (lattice, bounds) = grown(&drawn.corners, Least::Target);
        let image = drawn.image();
        assert!(View::new(&image, &lattice, &drawn.corners, bounds).is_none());
        drawn.bytes.fill(100);
        let image = drawn.image();
        assert!(View::new(&image, &lattice, &drawn.corners, bounds).is_none());
    }
}
