//! One target in one frame: from an expected pose, or a found grid, to an accepted pose.

use heapless::Vec;

use super::corners::{Crossing, EDGES_OF_CORNER_MIN};
use super::margin::pattern_goes_on;
use super::measurement::{CORNERS_MIN, Fitted, MeasureFailure, Measurement, View};
use super::minima::both_minima;
use super::rough::{ITERATIONS_FOUND, rough_pose};
use crate::common::statistics::{Mean, median};
use crate::find::corner::Corner;
use crate::find::grid::Grid;
use crate::fit::edge::{
    Appearance, Batch, GROWN_PX_MAX, Light, PixelFit, SeenEdge, SeenEdges, fit_edge, locate_edge,
};
use crate::fit::nodes::{Direction, Nodes};
use crate::fit::solve::{Inliers, Observations, Solution, solve};
use crate::limits::{TARGET_CORNERS_MAX, TARGET_EDGES_MAX};
use crate::model::image::Pixel;
use crate::model::pose::{Cam, Pose, Target};

/// What one pass of the fit found.
struct Pass {
    solution: Solution,
    appearance: Appearance,
    /// How far the node that it moved farthest was from its place.
    moved_px: f64,
    /// The larger relative change of a blur.
    blur_change: f64,
}

impl Pass {
    /// Whether the start was near enough for another pass to settle it.
    fn is_near(&self) -> bool {
        self.moved_px < NEAR_PX_MAX
    }

    /// Whether the start was so near that its linear model holds.
    fn is_linear(&self) -> bool {
        self.moved_px < MOVED_PX_MAX
    }

    /// Whether another pass would change nothing.
    fn is_settled(&self) -> bool {
        self.is_linear() && self.blur_change < BLUR_CHANGE_MAX
    }
}

/// The buffers of a measurement; nothing in them outlives it.
pub struct Workspace {
    nodes: Nodes,
    edges: Vec<SeenEdge, TARGET_EDGES_MAX>,
    /// For each edge, while the edges are fitted.
    pixels: Vec<PixelFit, TARGET_EDGES_MAX>,
    batch: Batch,
    /// The edges that the last pass accepted.
    inliers: Inliers,
}

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

/// Fewest edges that are located, where a target has that many: enough to give a start from which
/// a single pass of the fit suffices in nearly every frame.
const LOCATED_EDGES: usize = 120;

/// Levenberg-Marquardt iterations on fitted edges, from the pose of the located ones, and from its
/// mirror image.
const ITERATIONS_FITTED: usize = 2;

/// Most passes of the fit. One is enough when the start is good; from a search's start in a photograph,
/// with a blur that has to be found as well, four have been needed.
const PASSES_MAX: usize = 5;

/// The fit is repeated where a pass moves a node by more than this, because it is linear: what it
/// neglects falls with the cube of the move, and is 0.001 px at this limit.
const MOVED_PX_MAX: f64 = 0.15;

/// A target that a first pass moves by more than this may have lost edges to it, which hold only a
/// blur's width of motion: they are located afresh.
const NEAR_PX_MAX: f64 = 0.5;

/// It is also repeated where a pass changes a blur by more than this fraction.
const BLUR_CHANGE_MAX: f64 = 0.1;

/// A border whose sides lie farther out or in than the inner edges put them, by more than this and
/// more than chance explains, is not used: a cut or smeared border of a small target, a hundredth
/// of a pixel off, makes its depth wrong by a tenth of a millimetre.
const BORDER_OFF_PX_MAX: f64 = 0.01;

/// What chance explains, in standard deviations of the border's mean. That of the inner edges'
/// size is about as large.
const BORDER_OFF_SD_MAX: f64 = 4.0;

/// An edge whose pixels have a variance of more than this many times that of the median edge is
/// covered by something, or is not an edge.
const NOISE_RATIO_MAX: f32 = 4.0;

/// But no edge is rejected for scatter below this share of the white level, two of 255 levels:
/// uneven light and a lens's true blur are never quite as modelled.
const MISFIT_OF_WHITE: f32 = 0.008;

/// Rounding to whole grey levels: pixels are never known better than that.
const ROUNDING_VARIANCE: f32 = 1.0 / 12.0;

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

    /// The nodes of a target's grid at a pose; `None` where they cannot be seen.
    pub(crate) fn nodes<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        cam_from_target: &Pose<Cam, Target>,
    ) -> Option<&Nodes> {
        self.project(view, cam_from_target).then_some(&self.nodes)
    }

    /// Projects the grid, as it is seen at a pose.
    fn project<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        cam_from_target: &Pose<Cam, Target>,
    ) -> bool {
        let drift = view.drift(cam_from_target);
        self.nodes.project_drifting(view.lens, view.target, cam_from_target, drift.as_ref())
    }

    /// Measures a target near an expected pose.
    ///
    /// # Errors
    /// [`MeasureFailure::TooFewCorners`] and [`MeasureFailure::PoorFit`].
    pub fn track<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        expected_cam_from_target: &Pose<Cam, Target>,
        appearance: Appearance,
    ) -> Result<Fitted, MeasureFailure> {
        if let Ok(pass) = self.pass(view, expected_cam_from_target, appearance, DOUBT_COST)
            && pass.is_near()
            && let Ok(fitted) = self.settle(view, pass, &appearance, DOUBT_COST)
        {
            return Ok(fitted);
        }
        self.locate(view, expected_cam_from_target)?;
        let rough = solve(expected_cam_from_target, &self.seen(), ITERATIONS_LOCATED)
            .map_err(|_| MeasureFailure::PoorFit)?;
        self.fit(view, &rough.cam_from_target, appearance, DOUBT_COST)
    }

    /// Measures a target whose grid a search has found. If both minima are equally good, later
    /// frames will decide.
    ///
    /// # Errors
    /// [`MeasureFailure::TooFewCorners`] and [`MeasureFailure::PoorFit`].
    pub fn acquire<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        grid: &Grid,
        corners: &[Corner],
    ) -> Result<Fitted, MeasureFailure> {
        let rough_cam_from_target = rough_pose(view, grid, corners)?;
        self.locate(view, &rough_cam_from_target)?;
        let located = both_minima(&rough_cam_from_target, &self.seen(), ITERATIONS_FOUND, 0.0)?;
        let mut fitted = self.fit(view, &located.cam_from_target, Appearance::START, 0.0)?;
        fitted.appearance.has_border = self.border_agrees(view, &fitted);
        Ok(fitted)
    }

    /// Whether the border is where a pose found without it puts it, so that the next frames can use
    /// it.
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
        let off_px_max = BORDER_OFF_PX_MAX + BORDER_OFF_SD_MAX / libm::sqrt(outwards.weight());
        seen.is_some() && !outwards.is_empty() && outwards.value().abs() < off_px_max
    }

    /// Locates edges near an expected pose: all those of a target of ordinary size.
    fn locate<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        cam_from_target: &Pose<Cam, Target>,
    ) -> Result<(), MeasureFailure> {
        self.edges.clear();
        if !self.project(view, cam_from_target) {
            return Err(MeasureFailure::PoorFit);
        }
        let edges = self.nodes.edges(view.first_square_dark);
        // A part of a large target's edges is enough.
        let stride = (edges.count() / LOCATED_EDGES).max(1);
        for edge in self.nodes.edges(view.first_square_dark).step_by(stride) {
            if let Some(seen) = locate_edge(view.image, &self.nodes, &edge) {
                // One per edge of the target: the capacity is never exceeded.
                let _ = self.edges.push(seen);
            }
        }
        self.enough_edges()
    }

    /// Fits the pose to all edges near a start good to a few tenths of a pixel; `doubt` is by how
    /// much the mirrored pose must be better to replace it.
    fn fit<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        start_cam_from_target: &Pose<Cam, Target>,
        appearance: Appearance,
        doubt: f64,
    ) -> Result<Fitted, MeasureFailure> {
        let pass = self.pass(view, start_cam_from_target, appearance, doubt)?;
        self.settle(view, pass, &appearance, doubt)
    }

    /// Repeats a pass, each from the last one's pose, until another would change nothing; `before`
    /// is the appearance that the first pass started with.
    fn settle<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        mut pass: Pass,
        before: &Appearance,
        doubt: f64,
    ) -> Result<Fitted, MeasureFailure> {
        for _ in 1..PASSES_MAX {
            if pass.is_settled() {
                break;
            }
            let start = pass.solution.cam_from_target;
            pass = self.pass(view, &start, pass.appearance.with_growth_of(before), doubt)?;
        }
        // A few edges can agree with each other on a pose that the next pass would leave again.
        if !pass.is_linear() {
            return Err(MeasureFailure::PoorFit);
        }
        let mut fitted = self.judge(view, &pass)?;
        self.allow_for_unknown_velocity(view, &pass.solution, &mut fitted.measurement)?;
        Ok(fitted)
    }

    /// Adds to the covariance what a velocity that is not known may have done to the pose: how far
    /// the pose moves when each of the independent drifts deforms the grid, squared.
    ///
    /// Without one of them the covariance would be too small: a solve that fails leaves no pose. None
    /// does where a pose has been judged good. Half of the edges, and so four, have weight whatever the
    /// drift, and a drift of some millimetres neither leads behind the camera nor changes how well
    /// edges fix a pose, which is by many orders of magnitude better than what is called degenerate.
    ///
    /// Never inlined: it would stay on the stack during a pass.
    #[inline(never)]
    fn allow_for_unknown_velocity<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        solution: &Solution,
        measurement: &mut Measurement,
    ) -> Result<(), MeasureFailure> {
        let pose = &solution.cam_from_target;
        let Some(drifts) = view.unknown_drifts(pose) else { return Ok(()) };
        for drift in &drifts {
            self.nodes.deform(view.target, pose, drift);
            let moved = pose.increment_to(&self.solved_from(solution)?.cam_from_target);
            measurement.covariance += moved * moved.transpose();
        }
        if let Some(drift) = view.drift(pose) {
            self.nodes.deform(view.target, pose, &drift);
        }
        Ok(())
    }

    /// Fits every edge once, and the pose to the edges.
    ///
    /// Never inlined: of two passes, one after the other, only one is on the stack.
    #[inline(never)]
    fn pass<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        start_cam_from_target: &Pose<Cam, Target>,
        appearance: Appearance,
        doubt: f64,
    ) -> Result<Pass, MeasureFailure> {
        self.fit_edges(view, start_cam_from_target, &appearance)?;
        let mut solution =
            both_minima(start_cam_from_target, &self.seen(), ITERATIONS_FITTED, doubt)?;
        // The pose tells the velocity better than the start did.
        if let Some(drift) = view.drift(&solution.cam_from_target) {
            self.nodes.deform(view.target, &solution.cam_from_target, &drift);
            solution = self.solved_from(&solution)?;
        }
        let moved_px = self.nodes.farthest_px(&solution.cam_from_target).unwrap_or(f64::INFINITY);
        let mut pass = Pass { solution, appearance, moved_px, blur_change: 0.0 };
        // An edge that lies beside where it was expected looks blurred; but better so than a guess.
        if pass.is_linear() || !appearance.has_settled() {
            pass.blur_change = self.correct(&mut pass.appearance, &pass.solution);
            let grown_px = pass.appearance.growth_px - appearance.growth_px;
            if grown_px.abs() > GROWN_PX_MAX {
                self.edges.iter_mut().for_each(|seen| seen.take_out_growth(grown_px));
                pass.solution = self.solved_from(&pass.solution)?;
            }
        }
        self.inliers = pass.solution.inliers;
        Ok(pass)
    }

    /// The pose that the edges give now, from one nearby.
    fn solved_from(&self, near: &Solution) -> Result<Solution, MeasureFailure> {
        solve(&near.cam_from_target, &self.seen(), ITERATIONS_FITTED)
            .map_err(|_| MeasureFailure::PoorFit)
    }

    /// Whether the target's pattern goes on beyond the grid of the last pose, which is then shifted.
    pub(crate) fn pattern_goes_on<P: Pixel>(&self, view: &View<'_, P>) -> bool {
        pattern_goes_on(view.image, &self.nodes)
    }

    /// The edges that a pose of [`Workspace::track`] rests on, and the nodes where they were
    /// expected, for callers that fit more than a pose to them.
    pub fn used_edges(&self) -> (&Nodes, impl Iterator<Item = &SeenEdge>) {
        let used = self.edges.iter().enumerate().filter(|(place, _)| self.inliers.contains(*place));
        (&self.nodes, used.map(|(_, seen)| seen))
    }

    /// Fits every edge expected at a pose, with the noise of the median edge.
    fn fit_edges<P: Pixel>(
        &mut self,
        view: &View<'_, P>,
        cam_from_target: &Pose<Cam, Target>,
        appearance: &Appearance,
    ) -> Result<(), MeasureFailure> {
        self.edges.clear();
        self.pixels.clear();
        if !self.project(view, cam_from_target) {
            return Err(MeasureFailure::PoorFit);
        }
        let blur_px = appearance.x_blur_px.max(appearance.y_blur_px);
        let light = Light::measure(view.image, &self.nodes, view.first_square_dark, blur_px);
        for edge in self.nodes.edges(view.first_square_dark) {
            if edge.is_border && !appearance.has_border {
                continue;
            }
            let fitted = fit_edge(
                view.image,
                &self.nodes,
                &edge,
                appearance,
                light.as_ref(),
                &mut self.batch,
            );
            if let Some((seen, pixels)) = fitted {
                let _ = self.edges.push(seen);
                let _ = self.pixels.push(pixels);
            }
        }
        self.enough_edges()?;
        let mut variances: Vec<f32, TARGET_EDGES_MAX> =
            self.pixels.iter().map(|pixels| pixels.noise_variance).collect();
        let median = median(&mut variances, f32::total_cmp).unwrap_or(0.0);
        let variance = median.max(ROUNDING_VARIANCE);
        let noise = libm::sqrt(f64::from(variance));
        let misfit = MISFIT_OF_WHITE * f32::from(view.image.white_level());
        let variance_max = NOISE_RATIO_MAX * variance.max(misfit * misfit);
        let mut kept = 0;
        for place in 0..self.edges.len() {
            if self.pixels[place].noise_variance <= variance_max {
                self.edges[kept] = self.edges[place];
                self.pixels[kept] = self.pixels[place];
                self.edges[kept].scale_uncertainty(noise);
                kept += 1;
            }
        }
        self.edges.truncate(kept);
        self.pixels.truncate(kept);
        self.enough_edges()
    }

    fn enough_edges(&self) -> Result<(), MeasureFailure> {
        // As many as there are between six corners in two rows: seven.
        if self.edges.len() < CORNERS_MIN + 1 { Err(MeasureFailure::TooFewCorners) } else { Ok(()) }
    }

    /// What was seen of the target.
    fn seen(&self) -> SeenEdges<'_> {
        SeenEdges::new(&self.nodes, &self.edges)
    }

    /// Corrects the appearance according to the edges used; returns the larger relative change of a
    /// blur.
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
            // Growth moves all edges of the border outwards, as a nearer target does.
            if !seen.edge.is_border {
                let (growth_px, precision) = seen.growth_px(&residual);
                growth.add(growth_px, precision);
            }
        });
        debug_assert!(visited.is_some(), "a solution is in front of the camera");
        appearance.correct([x_blur.value(), y_blur.value()], growth.value())
    }

    /// Rejects a pose that the edges do not really support.
    ///
    /// Never inlined: its corners would stay on the stack during a pass.
    #[inline(never)]
    fn judge<P: Pixel>(
        &self,
        view: &View<'_, P>,
        &Pass { ref solution, appearance, .. }: &Pass,
    ) -> Result<Fitted, MeasureFailure> {
        let (used, rms_px) = self.corners(solution).ok_or(MeasureFailure::PoorFit)?;
        let corners = used.count_ones() as usize;
        if corners < CORNERS_MIN {
            return Err(MeasureFailure::TooFewCorners);
        }
        let measurement = Measurement {
            cam_from_target: solution.cam_from_target,
            delay_ns: view.delay_ns(&solution.cam_from_target),
            covariance: solution.covariance,
            rms_px,
            corners: corners as u8,
            corners_total: view.target.corner_count() as u8,
        };
        let is_plausible = measurement.rms_px <= RMS_PX_MAX
            && 2 * solution.inliers.count() >= self.edges.len()
            && measurement.sd_mm().max() <= SD_MM_MAX;
        if is_plausible {
            Ok(Fitted { measurement, appearance, used })
        } else {
            Err(MeasureFailure::PoorFit)
        }
    }

    /// The corners at which at least three of the edges used end, and the root mean square of their
    /// distances, in raw pixels, from where the pose puts them; `None` when it puts a node behind
    /// the camera.
    ///
    /// Two edges would not be enough: where a dark square at the border ends, an edge of each
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

#[cfg(test)]
mod tests;
