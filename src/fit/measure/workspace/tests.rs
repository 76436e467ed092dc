//! Measurements of a target that is drawn.

extern crate std;

use std::boxed::Box;
use std::rc::Rc;
use std::vec::Vec;

use nalgebra::{Matrix6, Vector3, Vector6};

use super::*;
use crate::fit::measure::measurement::{Rolling, delay_ns};
use crate::fit::nodes::Edge;
use crate::limits::OBSERVATIONS_MAX;
use crate::model::image::GreyImage;
use crate::model::lens::{Distortion, Lens};
use crate::model::lens_table::LensTable;
use crate::model::shutter::Shutter;
use crate::model::target::{Origin, Role, TargetGeometry};
use crate::test_support::drawing::{Drawing, PLAIN, blurred};
use crate::test_support::{Random, table};

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const WHITE: u16 = 1023;
const PITCH_MM: f64 = 12.0;
const COLUMNS: u8 = 6;
const ROWS: u8 = 5;

fn lens() -> Lens {
    Lens {
        width_px: WIDTH as u16,
        height_px: HEIGHT as u16,
        fx_px: 500.0,
        fy_px: 500.0,
        cx_px: 159.5,
        cy_px: 119.5,
        skew_px: 0.0,
        distortion: Distortion::Radial2([0.0; 2]),
    }
}

fn target() -> TargetGeometry {
    let origin = Origin::FirstCorner;
    TargetGeometry::checker(COLUMNS, ROWS, PITCH_MM, origin, Role::Upper, [0.0; 3]).unwrap()
}

/// Tilted, and beside the middle of the picture. A square has about 13 pixels.
fn pose() -> Pose<Cam, Target> {
    Pose::from_theta([0.3, -0.4, 0.15, -30.0, -20.0, 420.0])
}

/// 16 ms for all rows, from the top.
fn shutter() -> Shutter {
    Shutter::new(16_000_000, HEIGHT as u16)
}

/// The target as it is drawn, and blurred this often.
fn drawn(drawing: &Drawing, blurs: usize) -> Vec<u16> {
    let mut levels = std::vec![800.0; WIDTH * HEIGHT];
    drawing.draw(&lens(), &target(), &pose(), [160.0, 800.0], &mut levels);
    for _ in 0..blurs {
        levels = blurred(&levels, WIDTH);
    }
    levels.into_iter().map(|level| libm::round(level) as u16).collect()
}

/// What a measurement is made of.
struct Bench {
    words: Vec<u16>,
    lens: Rc<LensTable>,
    target: TargetGeometry,
    workspace: Box<Workspace>,
}

impl Bench {
    fn of(drawing: &Drawing) -> Self {
        Self::of_blurred(drawing, 1)
    }

    fn of_blurred(drawing: &Drawing, blurs: usize) -> Self {
        let workspace = Box::new(Workspace::new());
        Self { words: drawn(drawing, blurs), lens: table(&lens()), target: target(), workspace }
    }

    /// Does something with the workspace and the view.
    fn with<R>(
        &mut self,
        rolling: Option<Rolling<'_>>,
        what: impl FnOnce(&mut Workspace, &View<'_, u16>) -> R,
    ) -> R {
        let image = GreyImage::with_white_level(&self.words, WIDTH, HEIGHT, WIDTH, WHITE).unwrap();
        let (lens, target) = (&self.lens, &self.target);
        what(
            &mut self.workspace,
            &View { image: &image, lens, target, first_square_dark: true, rolling },
        )
    }

    /// Follows the target from a pose a little beside where it is.
    fn tracked(&mut self, rolling: Option<Rolling<'_>>, appearance: Appearance) -> Fitted {
        let expected = pose().moved_by(&Vector6::new(2e-3, -1e-3, 1e-3, 0.2, -0.1, 0.3));
        let tracked = |workspace: &mut Workspace, view: &View<'_, u16>| {
            workspace.track(view, &expected, appearance).expect("a target that is seen")
        };
        self.with(rolling, tracked)
    }

    /// One pass from a place.
    fn pass(&mut self, start: &Pose<Cam, Target>, appearance: Appearance) -> Pass {
        self.with(None, |workspace, view| workspace.pass(view, start, appearance, DOUBT_COST))
            .map_err(|_| ())
            .expect("a target that is seen")
    }

    /// What the judge says of the edges in the workspace.
    fn judged(&mut self, pass: &Pass) -> Result<Fitted, MeasureFailure> {
        self.with(None, |workspace, view| workspace.judge(view, pass))
    }

    /// Noise of this standard deviation about the middle of the edge between two nodes.
    fn disturb(&mut self, edge: Edge, sd: f64) {
        let mut random = Random::new(7);
        // Around the corners there is one more ring of nodes.
        let at = |node: u8| {
            let [column, row] = [node % (COLUMNS + 2), node / (COLUMNS + 2)].map(f64::from);
            let at_mm = Vector3::new(column - 1.0, row - 1.0, 0.0) * PITCH_MM;
            lens().project(&pose().transform(&at_mm)).unwrap()
        };
        let middle = (at(edge.nodes[0]) + at(edge.nodes[1])) * 0.5;
        for row in 0..HEIGHT {
            for column in 0..WIDTH {
                let [dx, dy] = [column as f64 - middle.x, row as f64 - middle.y];
                if dx.abs().max(dy.abs()) < 6.0 {
                    let word = &mut self.words[row * WIDTH + column];
                    *word = libm::round(f64::from(*word) + sd * random.normal()) as u16;
                }
            }
        }
    }
}

#[test]
fn a_target_that_stands_still_is_where_it_is() {
    let found = Bench::of(&PLAIN).tracked(None, Appearance::START);
    let off = pose().increment_to(&found.measurement.cam_from_target);
    let sd = found.measurement.covariance.diagonal().map(libm::sqrt);
    // Without noise: only the grey levels are rounded.
    assert!(off.iter().zip(&sd).all(|(off, sd)| off.abs() < *sd), "{off} {sd}");
    assert!(found.measurement.sd_mm().max() < 0.03, "{sd}");
    assert_eq!((found.measurement.corners, found.used.count_ones()), (30, 30));
}

/// Where the velocity is not known, each of its components may be as large as its standard deviation,
/// and move the pose by what it moves that of a target which has this velocity.
#[test]
fn an_unknown_velocity_adds_to_the_covariance_what_it_does_to_a_pose() {
    /// Of a velocity, in radians and millimetres per second.
    const SD_PER_S: [f64; 6] = [0.012, 0.012, 0.012, 12.0, 12.0, 12.0];
    /// So many times as fast, so that the last digit of the pixels matters less.
    const FASTER: f64 = 5.0;
    let rolling = Rolling { shutter: shutter(), time_ns: 0, motion: None };
    let mut still = Bench::of(&PLAIN);
    let [known, unknown] =
        [None, Some(rolling)].map(|it| still.tracked(it, Appearance::START).measurement);
    // It has been solved once more.
    let more = known.cam_from_target.increment_to(&unknown.cam_from_target);
    assert!(more.norm() < 0.01 * known.sd_mm().norm(), "{more}");
    assert_eq!(known.delay_ns, 0);
    let late_ns = delay_ns(&shutter(), &still.lens, &still.target, &unknown.cam_from_target);
    assert_eq!(unknown.delay_ns, late_ns);
    let mut expected = Matrix6::zeros();
    for (component, sd_per_s) in SD_PER_S.into_iter().enumerate() {
        let mut moving = PLAIN;
        moving.per_row[component] = FASTER * sd_per_s * shutter().row_s();
        let moving = Bench::of(&moving).tracked(None, Appearance::START).measurement;
        let moved = known.cam_from_target.increment_to(&moving.cam_from_target) / FASTER;
        expected += moved * moved.transpose();
    }
    let added = unknown.covariance - known.covariance;
    let sd = expected.diagonal().map(libm::sqrt);
    let off = Matrix6::from_fn(|a, b| (added[(a, b)] - expected[(a, b)]) / (sd[a] * sd[b]));
    // What a pass neglects of so large a motion, and what is left of the rounding.
    assert!(off.abs().max() < 0.1, "{off}");
}

#[test]
fn the_blur_and_the_growth_are_those_of_the_drawing() {
    let mut bench = Bench::of_blurred(&Drawing { growth: 0.01, ..PLAIN }, 2);
    let first = bench.tracked(None, Appearance::START);
    let found = bench.tracked(None, first.appearance);
    // A pixel's box, and half a pixel squared each time; the paper is tilted, and a sum of boxes is
    // no bell.
    let blur_px = libm::sqrt(2.0 * 0.5 + 1.0 / 12.0);
    let Appearance { x_blur_px, y_blur_px, growth_px, .. } = found.appearance;
    for found_px in [x_blur_px, y_blur_px] {
        assert!((found_px / blur_px - 1.0).abs() < 0.05, "{found_px} {blur_px}");
    }
    // Squares have 12 to 15 pixels.
    assert!((0.12..0.15).contains(&growth_px), "{growth_px}");
    assert!(first.measurement.rms_px < 0.01 && found.measurement.rms_px < 0.01);
}

/// A tenth of a pixel too much or too little would be left at every edge.
#[test]
fn the_pose_of_a_single_pass_is_that_without_the_growth() {
    let scale = Bench::of(&PLAIN).pass(&pose(), Appearance::START).solution.scale;
    let mut bench = Bench::of(&Drawing { growth: 0.01, ..PLAIN });
    for growth_px in [0.0, 0.05, 0.13, 0.2] {
        let pass = bench.pass(&pose(), Appearance { growth_px, ..Appearance::START });
        // With it, the residuals would be more than ten times as large.
        assert!(pass.solution.scale < 2.0 * scale, "{growth_px}: {} {scale}", pass.solution.scale);
    }
}

#[test]
fn a_border_is_used_where_the_inner_edges_put_it() {
    // A hundredth of a pixel, and what chance explains.
    for (longer_px, agrees) in [(0.0, true), (0.01, true), (0.02, false), (0.1, false)] {
        for sign in [-1.0, 1.0] {
            // A square has about 13 pixels.
            let mut bench = Bench::of(&Drawing { longer: sign * longer_px / 13.0, ..PLAIN });
            let found = bench.tracked(None, Appearance::START);
            let ours = bench.with(None, |workspace, view| workspace.border_agrees(view, &found));
            assert_eq!(ours, agrees, "{longer_px} {sign}");
        }
    }
}

#[test]
fn only_a_blur_that_is_not_known_is_taken_from_a_start_beside_the_edges() {
    let mut bench = Bench::of_blurred(&PLAIN, 2);
    let settled = Appearance { ln_blur_sd: 0.01, ..Appearance::START };
    // 0.35 pixels.
    let beside = pose().moved_by(&Vector6::new(0.0, 0.0, 0.0, 0.3, 0.0, 0.0));
    for (start, appearance, is_corrected) in [
        (pose(), Appearance::START, true),
        (pose(), settled, true),
        (beside, Appearance::START, true),
        (beside, settled, false),
    ] {
        let pass = bench.pass(&start, appearance);
        assert_eq!(pass.blur_change > 0.0, is_corrected, "{}", pass.moved_px);
        assert_eq!(pass.appearance != appearance, is_corrected);
    }
}

#[test]
fn a_pattern_that_goes_on_is_noticed() {
    for (more_columns, goes_on) in [(0.0, false), (1.0, true)] {
        let mut bench = Bench::of(&Drawing { more_columns, ..PLAIN });
        bench.tracked(None, Appearance::START);
        let found = bench.with(None, |workspace, view| workspace.pattern_goes_on(view));
        assert_eq!(found, goes_on, "{more_columns}");
    }
}

#[test]
fn border_edges_are_fitted_where_there_is_a_border() {
    let mut bench = Bench::of(&PLAIN);
    let expected = bench.with(None, |workspace, view| {
        let nodes = workspace.nodes(view, &pose()).unwrap();
        let all = nodes.edges(true).count();
        [all - nodes.edges(true).filter(|edge| edge.is_border).count(), all]
    });
    let counts = [false, true].map(|has_border| {
        bench.pass(&pose(), Appearance { has_border, ..Appearance::START });
        bench.workspace.edges.len()
    });
    assert_eq!(counts, expected);
}

#[test]
fn an_edge_in_noise_is_left_out_from_four_times_the_least_variance_on() {
    let mut bench = Bench::of(&PLAIN);
    bench.pass(&pose(), Appearance::START);
    let edge = bench.workspace.edges[30].edge;
    let clean = bench.words.clone();
    // Four times the square of 0.8 % of white.
    let limit = 2.0 * 0.008 * f64::from(WHITE);
    for (share, is_kept) in [(0.3, true), (0.6, true), (1.4, false)] {
        bench.words.clone_from(&clean);
        bench.disturb(edge, share * limit);
        bench.pass(&pose(), Appearance::START);
        let is_there = bench.workspace.edges.iter().any(|seen| seen.edge == edge);
        assert_eq!(is_there, is_kept, "{share}");
    }
}

/// Of whole grey levels each is known with a variance of a twelfth.
#[test]
fn what_is_rounded_is_as_uncertain_as_rounding_is() {
    let mut bench = Bench::of(&PLAIN);
    let mut random = Random::new(8);
    let fine = bench.words.clone();
    // With so little contrast, what the model neglects is little, too.
    let sds = [0.0, 2.0].map(|sd| {
        let level = |word: &u16| libm::round(f64::from(*word) / 16.0 + sd * random.normal()) as u16;
        bench.words = fine.iter().map(level).collect();
        bench.tracked(None, Appearance::START).measurement.sd_mm().z
    });
    let ratio = libm::sqrt((4.0 + 1.0 / 12.0) / (1.0 / 12.0));
    // What the model neglects is no more than twice as much again.
    assert!((0.5 * ratio..ratio).contains(&(sds[1] / sds[0])), "{sds:?} {ratio}");
}

#[test]
fn a_pose_needs_seven_edges() {
    let mut bench = Bench::of(&PLAIN);
    bench.pass(&pose(), Appearance::START);
    for count in (0..=9).rev() {
        bench.workspace.edges.truncate(count);
        let enough = bench.workspace.enough_edges();
        assert_eq!(enough.is_ok(), count >= 7, "{count}");
    }
}

/// Keeps the edges at the first corners of two rows.
fn keep_corners(workspace: &mut Workspace, columns: usize, without_last: bool) {
    let nodes = &workspace.nodes;
    let is_kept = |node: u8| {
        nodes.corner(node).is_some_and(|corner| {
            let [row, column] = [corner / usize::from(COLUMNS), corner % usize::from(COLUMNS)];
            row < 2 && column < columns && !(without_last && row == 1 && column == columns - 1)
        })
    };
    let kept: Vec<SeenEdge> = workspace
        .edges
        .iter()
        .filter(|seen| seen.edge.nodes.into_iter().any(is_kept))
        .copied()
        .collect();
    workspace.edges = kept.into_iter().collect();
}

#[test]
fn a_pose_needs_six_corners() {
    for (without_last, is_enough) in [(false, true), (true, false)] {
        let mut bench = Bench::of(&PLAIN);
        let mut pass = bench.pass(&pose(), Appearance::START);
        keep_corners(&mut bench.workspace, 3, without_last);
        pass.solution = bench.workspace.solved_from(&pass.solution).unwrap();
        let judged = bench.judged(&pass);
        let expected = if is_enough { Ok(6) } else { Err(MeasureFailure::TooFewCorners) };
        assert_eq!(judged.map(|it| it.measurement.corners), expected);
    }
}

#[test]
fn a_pose_is_judged_by_its_residual_its_edges_and_its_uncertainty() {
    let mut bench = Bench::of(&PLAIN);
    let pass = bench.pass(&pose(), Appearance::START);
    assert!(bench.judged(&pass).is_ok());
    let of = |solution: Solution| Pass { solution, ..pass_of(&pass) };
    // A pixel is 0.84 mm.
    for (x_mm, is_good) in [(0.6, true), (1.1, false)] {
        let moved =
            pass.solution.cam_from_target.moved_by(&Vector6::new(0.0, 0.0, 0.0, x_mm, 0.0, 0.0));
        let moved = Solution { cam_from_target: moved, ..pass.solution };
        assert_eq!(bench.judged(&of(moved)).is_ok(), is_good, "{x_mm} mm");
    }
    for (sd_mm, is_good) in [(4.9, true), (5.1, false)] {
        let mut covariance = pass.solution.covariance;
        covariance[(5, 5)] = sd_mm * sd_mm;
        let vague = Solution { covariance, ..pass.solution };
        assert_eq!(bench.judged(&of(vague)).is_ok(), is_good, "{sd_mm} mm");
    }
    // Half of the edges at least are used. There must be room for as many others, and one more.
    bench.workspace.edges.truncate(OBSERVATIONS_MAX / 2 - 1);
    let pass = of(bench.workspace.solved_from(&pass.solution).unwrap());
    let used = pass.solution.inliers.count();
    let other = bench.workspace.edges[0];
    while bench.workspace.edges.len() < 2 * used {
        assert!(bench.judged(&pass).is_ok());
        bench.workspace.edges.push(other).unwrap();
    }
    assert!(bench.judged(&pass).is_ok());
    bench.workspace.edges.push(other).unwrap();
    assert_eq!(bench.judged(&pass).unwrap_err(), MeasureFailure::PoorFit);
}

fn pass_of(pass: &Pass) -> Pass {
    Pass { solution: pass.solution, appearance: pass.appearance, ..*pass }
}
