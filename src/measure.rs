//! One target in one frame: from where it is expected, or was found, to its pose.
//!
//! ```text
//!  expected pose ─┬────────────────────────────┬▶ edges fitted ─▶ solved ─▶ judged
//!                 │ moved too far?             │         ▲          │
//!                 └▶ edges located ─▶ solved ──┤         └──────────┘ moved too far?
//!  found corners ──▶ both closed forms ────────┘
//! ```
//!
//! A body sways so evenly that the edges are where they are expected to a tenth of a pixel
//! in nearly every frame: one pass of the fit is all. Where they are not, they are located
//! first, which makes the start good to a few hundredths.

mod corners;

pub use corners::extent_is_certain;

use heapless::Vec;
use nalgebra::{Matrix3, Matrix6, Vector2, Vector3};

use crate::corner::Corner;
use crate::edge::{Appearance, Batch, Light, PixelFit, SeenEdge, SeenEdges, fit, locate};
use crate::grid::Grid;
use crate::image::{GreyImage, Pixel};
use crate::lens::Lens;
use crate::limits::{TARGET_CORNERS_MAX, TARGET_EDGES_MAX};
use crate::nodes::{Direction, Nodes};
use crate::planar::{SeenCorner, planar_poses};
use crate::pose::{Cam, Pose, Target};
use crate::report::NoPose;
use crate::solve::{Inliers, Observations, Solution, robust_cost, robust_cost_after_step, solve};
use crate::target::TargetGeometry;
use crate::view::{Squares, squares};
use corners::{Crossing, EDGES_OF_CORNER_MIN};

/// A target's pose in one frame, and how good it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// The pose.
    pub cam_from_target: Pose<Cam, Target>,
    /// Covariance of `[omega_rad, delta_mm]`, the increments of [`Pose::moved_by`].
    pub covariance: Matrix6<f64>,
    /// The reprojection error: root mean square distance, raw pixels, of the corners used,
    /// where the edges that meet there are seen, from where the pose puts them.
    pub rms_px: f64,
    /// Corners used: those of which at least three of the four edges were.
    pub corners: u8,
    /// Corners of the target. Fewer used than it has: a part is hidden.
    pub corners_total: u8,
}

impl Measurement {
    /// Standard deviations of x, y, z of the target's origin in the camera frame.
    #[must_use]
    pub fn sd_mm(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| libm::sqrt(self.covariance[(3 + axis, 3 + axis)]))
    }
}

/// A measurement that was accepted, and what the next one can use.
#[derive(Debug, Clone, Copy)]
pub struct Fitted {
    /// The pose and its quality.
    pub measurement: Measurement,
    /// How the camera shows the target.
    pub appearance: Appearance,
    /// Bit i is set when corner i of the target was used.
    pub used: u128,
}

/// What is measured: a target of known colours in a picture through a lens.
pub struct View<'a, P> {
    /// The picture.
    pub image: &'a GreyImage<'a, P>,
    /// The camera.
    pub lens: &'a Lens,
    /// The target.
    pub target: &'a TargetGeometry,
    /// Whether the square up and left of corner 0 is dark, see [`Grid`].
    pub first_square_dark: bool,
}

/// What one pass of the fit found.
struct Pass {
    solution: Solution,
    appearance: Appearance,
    /// Whether the start was so near that another pass would change nothing.
    is_settled: bool,
}

/// The buffers of a measurement; nothing in them outlives it.
pub struct Workspace {
    nodes: Nodes,
    edges: Vec<SeenEdge, TARGET_EDGES_MAX>,
    /// Of each edge, while they are fitted.
    pixels: Vec<PixelFit, TARGET_EDGES_MAX>,
    batch: Batch,
    /// The edges that the last pass believed.
    inliers: Inliers,
}

/// Fewest corners of a pose: six points give twelve equations for six unknowns.
const CORNERS_MIN: usize = 6;

/// Largest residual of an accepted pose. A good print and calibration give 0.02
/// to 0.3 px; a wrongly indexed grid several pixels.
const RMS_PX_MAX: f64 = 1.0;

/// Worst accepted standard deviation of any axis of the translation: a handful
/// of edges in one place can fix a pose formally and still say nothing.
const SD_MM_MAX: f64 = 5.0;

/// A mirrored pose replaces the expected one when its robust cost, in variances,
/// is lower by this: five standard deviations of a likelihood ratio.
const DOUBT_COST: f64 = 25.0;

/// Levenberg-Marquardt iterations on located edges, from a prediction.
const ITERATIONS_LOCATED: usize = 2;

/// Edges that are located at least, where a target has as many: so many that the start is good
/// enough for a single pass of the fit in nearly every frame.
const LOCATED_EDGES: usize = 120;

/// On fitted edges, from the pose of the located ones, and from its mirror image.
const ITERATIONS_FITTED: usize = 2;

/// From the closed form.
const ITERATIONS_FOUND: usize = 15;

/// Passes of the fit at most. One is enough when the start is good.
const PASSES_MAX: usize = 3;

/// The fit is repeated where a pass moves a node by more than this, because it is
/// linear: what it neglects falls with the cube, and is 0.001 px here.
const MOVED_PX_MAX: f64 = 0.15;

/// And where it changes a blur by more than this part.
const BLUR_CHANGE_MAX: f64 = 0.1;

/// Growth other than that of the frames before is taken out of the edges at once where it is
/// more than this.
const GROWN_PX_MAX: f64 = 0.01;

/// A border farther than this from where the inner edges have it is not the target's: a
/// thousandth of the size of a small one.
const BORDER_OFF_PX_MAX: f64 = 0.1;

/// An edge whose pixels scatter by more than this many times what those of the middle one
/// do (as a variance) is covered by something, or is none.
const NOISE_RATIO_MAX: f32 = 4.0;

/// But for scatter below this share of the white level, two of 255 levels, no edge is
/// refused: uneven light and a lens's true blur are never quite as the model has them.
const MISFIT_OF_WHITE: f32 = 0.008;

/// Rounding to whole grey levels: pixels are never better known than that.
const ROUNDING_VARIANCE: f32 = 1.0 / 12.0;

/// What the detector's corners are good to.
const FOUND_SIGMA_PX: f64 = 0.25;

impl Workspace {
    /// Empty buffers.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            nodes: Nodes::new(),
            edges: Vec::new(),
            pixels: Vec::new(),
            batch: Batch::new(),
            inliers: Inliers::new(),
        }
    }

    /// What the squares of a target at a pose show; `None` where they cannot be seen.
    pub fn squares<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        cam_from_target: &Pose<Cam, Target>,
    ) -> Option<Squares> {
        if !self.nodes.project(view.lens, view.target, cam_from_target) {
            return None;
        }
        squares(view.image, &self.nodes, view.first_square_dark)
    }

    /// Measures a target near an expected pose.
    ///
    /// # Errors
    /// [`NoPose::TooFewCorners`] and [`NoPose::PoorFit`].
    pub fn track<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        expected_cam_from_target: &Pose<Cam, Target>,
        appearance: Appearance,
    ) -> Result<Fitted, NoPose> {
        let pass = self.pass(view, expected_cam_from_target, appearance, DOUBT_COST);
        if let Ok(pass) = pass
            && pass.is_settled
            && let Ok(fitted) = self.judge(view.target, &pass)
        {
            return Ok(fitted);
        }
        self.locate(view, expected_cam_from_target)?;
        let rough = solve(expected_cam_from_target, &self.seen(), ITERATIONS_LOCATED)
            .map_err(|_| NoPose::PoorFit)?;
        self.fit(view, &rough.cam_from_target, appearance, DOUBT_COST)
    }

    /// Measures a target whose grid a search has found. Should both minima be equally
    /// good, the frames to come will tell.
    ///
    /// # Errors
    /// [`NoPose::TooFewCorners`] and [`NoPose::PoorFit`].
    pub fn acquire<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        grid: &Grid,
        corners: &[Corner],
    ) -> Result<Fitted, NoPose> {
        let rough_cam_from_target = rough_pose(view, grid, corners)?;
        self.locate(view, &rough_cam_from_target)?;
        let located = self.both_minima(&rough_cam_from_target, ITERATIONS_FOUND, 0.0)?;
        let mut fitted = self.fit(view, &located.cam_from_target, Appearance::START, 0.0)?;
        fitted.appearance.has_border = self.border_agrees(view, &fitted);
        Ok(fitted)
    }

    /// Whether the border is where a pose found without it has it, so that the next frames
    /// can use it.
    fn border_agrees<P: Pixel>(&mut self, view: &View<'_, P>, fitted: &Fitted) -> bool {
        let pose = &fitted.measurement.cam_from_target;
        let appearance = Appearance { has_border: true, ..fitted.appearance };
        if self.fit_edges(view, pose, &appearance).is_err() {
            return false;
        }
        let mut outwards = Mean::default();
        let seen = self.seen().residuals(pose, |place, residual| {
            let seen = &self.edges[place];
            if seen.edge.is_border {
                let (growth_px, precision) = seen.growth_px(&residual);
                outwards.add(growth_px, precision);
            }
        });
        seen.is_some() && outwards.weights > 0.0 && outwards.value().abs() < BORDER_OFF_PX_MAX
    }

    /// Locates edges near an expected pose: every one of a usual target.
    fn locate<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        cam_from_target: &Pose<Cam, Target>,
    ) -> Result<(), NoPose> {
        self.edges.clear();
        if !self.nodes.project(view.lens, view.target, cam_from_target) {
            return Err(NoPose::PoorFit);
        }
        let edges = self.nodes.edges(view.first_square_dark);
        // A part of a large target is plenty.
        let stride = (edges.count() / LOCATED_EDGES).max(1);
        for edge in self.nodes.edges(view.first_square_dark).step_by(stride) {
            if let Some(seen) = locate(view.image, &self.nodes, &edge) {
                // One per edge of the target: the capacity is never reached.
                let _ = self.edges.push(seen);
            }
        }
        self.enough_edges()
    }

    /// Fits the pose to all edges near a start good to a few tenths of a pixel; `doubt`: by
    /// how much the mirrored pose must be better to replace it.
    fn fit<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        start_cam_from_target: &Pose<Cam, Target>,
        appearance: Appearance,
        doubt: f64,
    ) -> Result<Fitted, NoPose> {
        let mut pass = self.pass(view, start_cam_from_target, appearance, doubt)?;
        for _ in 1..PASSES_MAX {
            if pass.is_settled {
                break;
            }
            let start = pass.solution.cam_from_target;
            pass = self.pass(view, &start, pass.appearance, doubt)?;
        }
        self.judge(view.target, &pass)
    }

    /// Fits every edge once, and the pose to the edges.
    fn pass<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        start_cam_from_target: &Pose<Cam, Target>,
        mut appearance: Appearance,
        doubt: f64,
    ) -> Result<Pass, NoPose> {
        self.fit_edges(view, start_cam_from_target, &appearance)?;
        let mut solution = self.both_minima(start_cam_from_target, ITERATIONS_FITTED, doubt)?;
        let growth_px = appearance.growth_px;
        let blur_change = self.correct(&mut appearance, &solution);
        let grown_px = appearance.growth_px - growth_px;
        if grown_px.abs() > GROWN_PX_MAX {
            self.edges.iter_mut().for_each(|seen| seen.take_out_growth(grown_px));
            solution = solve(&solution.cam_from_target, &self.seen(), ITERATIONS_FITTED)
                .map_err(|_| NoPose::PoorFit)?;
        }
        let moved_px = self.nodes.farthest_px(&solution.cam_from_target);
        let is_settled = moved_px.is_some_and(|moved_px| moved_px < MOVED_PX_MAX)
            && blur_change < BLUR_CHANGE_MAX;
        self.inliers = solution.inliers;
        Ok(Pass { solution, appearance, is_settled })
    }

    /// The edges that a pose of [`Workspace::track`] rests on, and the nodes where they were
    /// expected, for who wants to fit more to them than a pose.
    pub fn used_edges(&self) -> (&Nodes, impl Iterator<Item = &SeenEdge>) {
        let used = self.edges.iter().enumerate().filter(|(place, _)| self.inliers.contains(*place));
        (&self.nodes, used.map(|(_, seen)| seen))
    }

    /// Fits every edge expected at a pose, with the noise that the middle one has.
    fn fit_edges<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        cam_from_target: &Pose<Cam, Target>,
        appearance: &Appearance,
    ) -> Result<(), NoPose> {
        self.edges.clear();
        self.pixels.clear();
        if !self.nodes.project(view.lens, view.target, cam_from_target) {
            return Err(NoPose::PoorFit);
        }
        let light = Light::measure(view.image, &self.nodes, view.first_square_dark);
        for edge in self.nodes.edges(view.first_square_dark) {
            if edge.is_border && !appearance.has_border {
                continue;
            }
            let fitted =
                fit(view.image, &self.nodes, &edge, appearance, light.as_ref(), &mut self.batch);
            if let Some((seen, pixels)) = fitted {
                let _ = self.edges.push(seen);
                let _ = self.pixels.push(pixels);
            }
        }
        self.enough_edges()?;
        let mut variances: Vec<f32, TARGET_EDGES_MAX> =
            self.pixels.iter().map(|pixels| pixels.noise_variance).collect();
        let middle = variances.len() / 2;
        let (_, &mut median, _) = variances.select_nth_unstable_by(middle, f32::total_cmp);
        let variance = median.max(ROUNDING_VARIANCE);
        let noise = libm::sqrt(f64::from(variance));
        let misfit = MISFIT_OF_WHITE * f32::from(view.image.white_level());
        let variance_max = NOISE_RATIO_MAX * variance.max(misfit * misfit);
        let mut kept = 0;
        for place in 0..self.edges.len() {
            if self.pixels[place].noise_variance <= variance_max {
                self.edges.swap(kept, place);
                self.pixels.swap(kept, place);
                self.edges[kept].scale_uncertainty(noise);
                kept += 1;
            }
        }
        self.edges.truncate(kept);
        self.pixels.truncate(kept);
        self.enough_edges()
    }

    fn enough_edges(&self) -> Result<(), NoPose> {
        // As many as six corners in two rows have: seven between them.
        if self.edges.len() < CORNERS_MIN + 1 { Err(NoPose::TooFewCorners) } else { Ok(()) }
    }

    /// The pose that explains the edges, from a pose near it.
    ///
    /// A plane seen from afar has two poses that explain it nearly equally well, one
    /// the other's mirror image (Schweighofer and Pinz 2006). Both are looked at in every
    /// frame, and the mirrored one is taken when it is better beyond doubt: a warm
    /// start alone would stay in the wrong one for ever once noise had led it there
    /// while the target passed through frontal. Of a mirrored pose that is not better after
    /// one step, more steps make none that is beyond doubt.
    fn both_minima(
        &self,
        near_cam_from_target: &Pose<Cam, Target>,
        iterations: usize,
        doubt: f64,
    ) -> Result<Solution, NoPose> {
        let seen = self.seen();
        let kept = solve(near_cam_from_target, &seen, iterations).ok();
        let near = kept.as_ref().map_or(near_cam_from_target, |kept| &kept.cam_from_target);
        let other = mirror_image(near);
        if let Some(kept) = kept
            && robust_cost_after_step(&other, &seen, kept.scale).is_none_or(|cost| cost > kept.cost)
        {
            return Ok(kept);
        }
        let mirrored = solve(&other, &seen, iterations).ok();
        better(kept, mirrored, &seen, doubt).ok_or(NoPose::PoorFit)
    }

    /// What was seen of the target.
    fn seen(&self) -> SeenEdges<'_> {
        SeenEdges { nodes: &self.nodes, edges: &self.edges }
    }

    /// Corrects the appearance by what the edges used say; returns the larger relative
    /// change of a blur.
    fn correct(&self, appearance: &mut Appearance, solution: &Solution) -> f64 {
        let [mut x_blur, mut y_blur, mut growth] = [Mean::default(); 3];
        let visited = self.seen().residuals(&solution.cam_from_target, |place, residual| {
            if !solution.inliers.contains(place) {
                return;
            }
            let (seen, pixels) = (&self.edges[place], &self.pixels[place]);
            let blur = match seen.edge.direction {
                Direction::X => &mut x_blur,
                Direction::Y => &mut y_blur,
            };
            blur.add(pixels.ln_blur.into(), pixels.ln_blur_weight.into());
            // The border's edges have it all in one direction, like a nearer target.
            if !seen.edge.is_border {
                let (growth_px, precision) = seen.growth_px(&residual);
                growth.add(growth_px, precision);
            }
        });
        debug_assert!(visited.is_some(), "a solution is in front of the camera");
        appearance.correct([x_blur.value(), y_blur.value()], growth.value())
    }

    /// Refuses what the edges do not really support.
    fn judge(
        &self,
        target: &TargetGeometry,
        &Pass { ref solution, appearance, .. }: &Pass,
    ) -> Result<Fitted, NoPose> {
        let (used, rms_px) = self.corners(solution).ok_or(NoPose::PoorFit)?;
        let corners = used.count_ones() as usize;
        if corners < CORNERS_MIN {
            return Err(NoPose::TooFewCorners);
        }
        let measurement = Measurement {
            cam_from_target: solution.cam_from_target,
            covariance: solution.covariance,
            rms_px,
            corners: corners as u8,
            corners_total: target.corner_count() as u8,
        };
        let is_plausible = measurement.rms_px <= RMS_PX_MAX
            && 2 * solution.inliers.count() >= self.edges.len()
            && measurement.sd_mm().max() <= SD_MM_MAX;
        if is_plausible {
            Ok(Fitted { measurement, appearance, used })
        } else {
            Err(NoPose::PoorFit)
        }
    }

    /// The corners at which at least three edges end that were used, and the root mean square
    /// of their distances, raw pixels, from where the pose has them; `None` when it has a node
    /// behind the camera.
    ///
    /// Two edges would not do: where a dark square at the border ends, an edge of each
    /// direction ends too, and a grid shifted by a square would look whole.
    fn corners(&self, solution: &Solution) -> Option<(u128, f64)> {
        let mut met = [Crossing::default(); TARGET_CORNERS_MAX];
        self.seen().residuals(&solution.cam_from_target, |place, residual| {
            if solution.inliers.contains(place) {
                let seen = &self.edges[place];
                for corner in seen.edge.nodes.iter().filter_map(|&node| self.nodes.corner(node)) {
                    met[corner].add(seen.edge.direction, seen.distance_px(&residual));
                }
            }
        })?;
        let mut used = 0;
        let mut squares = Mean::default();
        for (corner, met) in met.iter().enumerate() {
            if met.edges() >= EDGES_OF_CORNER_MIN {
                used |= 1 << corner;
                squares.add(met.square_px2(), 1.0);
            }
        }
        Some((used, libm::sqrt(squares.value())))
    }
}

impl Default for Workspace {
    fn default() -> Self {
        Self::new()
    }
}

/// A weighted mean; 0 of nothing.
#[derive(Default, Clone, Copy)]
struct Mean {
    sum: f64,
    weights: f64,
}

impl Mean {
    fn add(&mut self, value: f64, weight: f64) {
        self.sum += weight * value;
        self.weights += weight;
    }

    fn value(&self) -> f64 {
        if self.weights > 0.0 { self.sum / self.weights } else { 0.0 }
    }
}

/// The pose of the corners that a search has found.
///
/// Never inlined: its corners would stay on the stack while the edges are fitted.
#[inline(never)]
fn rough_pose<P: Pixel>(
    view: &View<'_, P>,
    grid: &Grid,
    corners: &[Corner],
) -> Result<Pose<Cam, Target>, NoPose> {
    let found = seen_corners(view, grid, corners);
    if found.len() < CORNERS_MIN {
        return Err(NoPose::TooFewCorners);
    }
    let closed = planar_poses(&found).map_err(|_| NoPose::PoorFit)?;
    let refined = |place: usize| {
        solve(&closed.get(place)?.cam_from_target, &found[..], ITERATIONS_FOUND).ok()
    };
    let rough = better(refined(0), refined(1), &found[..], 0.0).ok_or(NoPose::PoorFit)?;
    Ok(rough.cam_from_target)
}

/// The corners of a grid that the search found.
fn seen_corners<P: Pixel>(
    view: &View<'_, P>,
    grid: &Grid,
    corners: &[Corner],
) -> Vec<SeenCorner, TARGET_CORNERS_MAX> {
    (0..view.target.corner_count())
        .filter_map(|index| {
            let corner = corners.get(usize::from((*grid.corners.get(index)?)?))?;
            let raw_px = Vector2::from(corner.position_px.map(f64::from));
            let point_mm = view.target.corner_mm(index);
            SeenCorner::new(index as u8, point_mm, view.lens, &raw_px, FOUND_SIGMA_PX)
        })
        .collect()
}

/// The other pose that explains a plane nearly as well: its mirror image in the
/// plane at right angles to the line of sight.
///
/// Seen along the line of sight v the target's outline stays and its depths
/// change sign: R' = (I - 2 v v^T) R diag(1, 1, -1).
#[must_use]
pub fn mirror_image(cam_from_target: &Pose<Cam, Target>) -> Pose<Cam, Target> {
    let sight = cam_from_target.translation_mm.normalize();
    let reflection = Matrix3::identity() - sight * sight.transpose() * 2.0;
    let mut rotation = reflection * cam_from_target.rotation;
    rotation.column_mut(2).neg_mut();
    Pose::new(rotation, cam_from_target.translation_mm)
}

/// The second solution when its cost is lower by more than `margin`, else the first.
fn better<O: Observations + ?Sized>(
    first: Option<Solution>,
    second: Option<Solution>,
    observations: &O,
    margin: f64,
) -> Option<Solution> {
    let (Some(one), Some(two)) = (first, second) else { return first.or(second) };
    // One scale for both: that of the better one, which is nearer the noise.
    let scale = one.scale.min(two.scale);
    let cost = |solution: &Solution| {
        robust_cost(&solution.cam_from_target, observations, scale).unwrap_or(f64::INFINITY)
    };
    Some(if cost(&two) + margin < cost(&one) { two } else { one })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mirror_image_keeps_the_outline_and_turns_the_tilt() {
        let pose = Pose::<Cam, Target>::from_theta([0.2, 0.3, -0.1, 80.0, -60.0, 1000.0]);
        let mirrored = mirror_image(&pose);
        assert!((mirrored.rotation.determinant() - 1.0).abs() < 1e-12);
        let sight = pose.translation_mm.normalize();
        for axis in 0..2 {
            let (was, is) = (pose.rotation.column(axis), mirrored.rotation.column(axis));
            // Depth changes sign, and what is seen at right angles to it stays.
            assert!((was.dot(&sight) + is.dot(&sight)).abs() < 1e-12);
            assert!((was - sight * was.dot(&sight) - is + sight * is.dot(&sight)).norm() < 1e-12);
        }
        assert!((mirror_image(&mirrored).rotation - pose.rotation).norm() < 1e-12);
    }
}
