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
