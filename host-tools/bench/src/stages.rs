//! The parts of `Pipeline::step`, each on its own.
//!
//! What is measured mirrors the private steps of `plumbline::parts::Workspace` with the same public
//! functions: one pass for both targets, which is all that nearly every frame takes; and the
//! additional work for a frame whose target is not where it was expected. The expected pose
//! continues the true motion of the three frames before.

use std::hint::black_box;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use plumbline::lens::ray_of;
use plumbline::parts::{
    Appearance, Batch, CornerList, Detector, FrameBorder, GridFinder, Light, Motion, Nodes,
    SeenEdge, SeenEdges, View, Workspace, fit_edge, locate_edge, mirror_image, points_mm,
    robust_cost_after_step, solve,
};
use plumbline::pipeline::Measurable;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::GridRejection;

use crate::{Bench, SEARCH_EVERY, say_times};

/// Levenberg-Marquardt iterations, on located edges and on fitted ones.
const ITERATIONS: usize = 2;

/// Measures and prints all the parts.
pub fn measure<P: Measurable>(bench: &Bench<P>) -> Result<()> {
    let known = searching(bench)?;
    tracking(bench, &known)?;
    lens(bench);
    Ok(())
}

/// The nodes of both targets put into the frame, by the lens's table, and by the model that the
/// camera was calibrated with, which tracking does not use.
fn lens<P: Measurable>(bench: &Bench<P>) {
    let [mut by_table, mut by_model] = [const { Vec::new() }; 2];
    for poses in &bench.truth {
        let targets = bench.config.targets.iter().zip(poses);
        let rays: Vec<_> = targets
            .flat_map(|(target, pose)| {
                points_mm(&target.geometry).filter_map(|point| ray_of(&pose.transform(&point)))
            })
            .collect();
        let start = Instant::now();
        for ray in &rays {
            black_box(bench.lens.raw_from_ray_with_jacobian(black_box(ray)));
        }
        by_table.push(start.elapsed());
        let start = Instant::now();
        for ray in &rays {
            black_box(bench.config.lens.raw_from_ray_with_jacobian(black_box(ray)));
        }
        by_model.push(start.elapsed());
    }
    say_times("lens_table", &mut by_table);
    say_times("lens_model", &mut by_model);
}

/// What a search tells the tracking of a target.
struct Known {
    appearance: Appearance,
    first_square_dark: bool,
}

/// The parts of a search; returns what the last one found of each target.
fn searching<P: Measurable>(bench: &Bench<P>) -> Result<Vec<Known>> {
    let targets = &bench.config.targets;
    let mut detector = Box::new(Detector::new());
    let mut corners = Box::new(CornerList::new());
    let mut finder = Box::new(GridFinder::new());
    let mut workspace = Box::new(Workspace::new());
    let wanted: Vec<_> = targets.iter().map(|target| target.geometry.shape()).collect();
    let [mut detector_times, mut grid_times, mut acquire_times] = [const { Vec::new() }; 3];
    let mut known = None;
    for frame in (0..bench.frames.len()).step_by(SEARCH_EVERY) {
        let image = bench.view(frame);
        corners.clear();
        let start = Instant::now();
        detector.detect(&image, 0..image.width(), 0..image.height(), &mut corners);
        detector_times.push(start.elapsed());
        let mut grids: Vec<_> = wanted.iter().map(|_| Err(GridRejection::NoLattice)).collect();
        let start = Instant::now();
        finder.find(&image, corners.as_slice(), &wanted, FrameBorder::OutsideBoard, &mut grids);
        grid_times.push(start.elapsed());
        let start = Instant::now();
        let found = targets.iter().zip(&grids).map(|(target, grid)| {
            let grid = grid.as_ref().ok()?;
            let first_square_dark = grid.first_square_dark;
            let (lens, target) = (&*bench.lens, &target.geometry);
            let view = View { image: &image, lens, target, first_square_dark, rolling: None };
            let fitted = workspace.acquire(&view, grid, corners.as_slice()).ok()?;
            Some(Known { appearance: fitted.appearance, first_square_dark })
        });
        let found: Option<Vec<_>> = found.collect();
        acquire_times.push(start.elapsed());
        known = found.or(known);
    }
    say_times("stage_detector", &mut detector_times);
    say_times("stage_grid", &mut grid_times);
    say_times("stage_acquire", &mut acquire_times);
    known.context("no search found all targets")
}

/// Time spent in each part while one frame is tracked. The grid is projected before the light is
/// measured, and again before edges are located; each figure includes its projection.
#[derive(Default)]
struct Parts {
    light: Duration,
    fit: Duration,
    solve: Duration,
    /// Includes solving the pose from the located edges; needed only where the first pass was not
    /// enough.
    locate: Duration,
}

/// The parts of a tracked frame.
fn tracking<P: Measurable>(bench: &Bench<P>, known: &[Known]) -> Result<()> {
    let mut tracker = Tracker { nodes: Nodes::new(), batch: Batch::new() };
    let mut frames = Vec::new();
    for frame in 3..bench.frames.len() {
        let mut parts = Parts::default();
        for (target, known) in known.iter().enumerate() {
            let mut motion = Motion::new(bench.truth[frame - 3][target], bench.time_ns(frame - 3));
            for earlier in frame - 2..frame {
                motion = motion.continued(bench.truth[earlier][target], bench.time_ns(earlier));
            }
            let expected = motion.predict(bench.time_ns(frame));
            tracker
                .track(bench, frame, target, known, &expected, &mut parts)
                .with_context(|| format!("frame {frame}: no pose"))?;
        }
        frames.push(parts);
    }
    type Part = fn(&Parts) -> Duration;
    let parts: [(&str, Part); 4] = [
        ("stage_light", |parts| parts.light),
        ("stage_fit", |parts| parts.fit),
        ("stage_solve", |parts| parts.solve),
        ("stage_locate", |parts| parts.locate),
    ];
    for (name, part) in parts {
        let mut times: Vec<_> = frames.iter().map(part).collect();
        say_times(name, &mut times);
    }
    Ok(())
}

struct Tracker {
    nodes: Nodes,
    batch: Batch,
}

impl Tracker {
    /// Follows `Workspace::track`, without its bookkeeping.
    fn track<P: Measurable>(
        &mut self,
        bench: &Bench<P>,
        frame: usize,
        target: usize,
        known: &Known,
        expected: &Pose<Cam, Target>,
        parts: &mut Parts,
    ) -> Option<()> {
        let (image, lens) = (&bench.view(frame), &*bench.lens);
        let target = &bench.config.targets[target].geometry;
        let Self { nodes, batch } = self;
        let start = Instant::now();
        if !nodes.project(lens, target, expected) {
            return None;
        }
        let blur_px = known.appearance.x_blur_px.max(known.appearance.y_blur_px);
        let light = Light::measure(image, nodes, known.first_square_dark, blur_px);
        parts.light += start.elapsed();

        let start = Instant::now();
        let appearance = &known.appearance;
        let (mut fitted, mut variances): (Vec<SeenEdge>, Vec<f32>) = nodes
            .edges(known.first_square_dark)
            .filter_map(|edge| fit_edge(image, nodes, &edge, appearance, light.as_ref(), batch))
            .map(|(seen, pixels)| (seen, pixels.noise_variance))
            .unzip();
        parts.fit += start.elapsed();

        variances.sort_unstable_by(f32::total_cmp);
        let noise = f64::from(*variances.get(variances.len() / 2)?).sqrt();
        fitted.iter_mut().for_each(|seen| seen.scale_uncertainty(noise));
        let seen = SeenEdges::new(nodes, &fitted);
        let start = Instant::now();
        let solution = solve(expected, &seen, ITERATIONS).ok()?;
        let mirrored = mirror_image(&solution.cam_from_target);
        black_box(robust_cost_after_step(&mirrored, &seen, solution.scale));
        parts.solve += start.elapsed();

        let start = Instant::now();
        if !nodes.project(lens, target, expected) {
            return None;
        }
        let located: Vec<SeenEdge> = nodes
            .edges(known.first_square_dark)
            .filter_map(|edge| locate_edge(image, nodes, &edge))
            .collect();
        black_box(solve(expected, &SeenEdges::new(nodes, &located), ITERATIONS)).ok()?;
        parts.locate += start.elapsed();
        Some(())
    }
}
