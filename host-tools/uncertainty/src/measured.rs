//! What a budget needs of a trial: positions, poses, and what each term does to them.

use nalgebra::{Matrix3, SMatrix, Vector3};
use plumbline::config::Config;
use plumbline::lens::Lens;
use plumbline::pose::{Cam, Pose, Target};
use plumbline::scene::SceneFrame;
use plumbline::target::{Role, TargetGeometry};
use plumbline_analysis::series::Series;
use plumbline_files::BadInput;
use plumbline_files::camera::Camera;
use plumbline_trial::Trial;
use plumbline_trial::frame::Trunk;
use plumbline_trial::manifest::Zero;
use plumbline_trial::points::{Points, frames_of};
use rayon::prelude::*;

use crate::lens::LensUncertainty;
use crate::response::{NUMBERS, response};

/// The most samples of a point: four and a half hours at 60 Hz.
pub const SAMPLES_MAX: usize = 1_000_000;

/// A trial and the camera that it was measured with.
#[derive(Debug, Clone)]
pub struct Measured {
    /// The points of the body.
    pub bodies: Vec<Body>,
    /// How well the camera is known.
    pub lens: LensUncertainty,
    /// Standard uncertainty of the time of t = 0; `None` where nothing is known of it.
    pub zero_u_s: Option<f64>,
}

/// One point of the body.
#[derive(Debug, Clone)]
pub struct Body {
    /// Which.
    pub trunk: Trunk,
    /// Its positions.
    pub series: Series,
    /// The covariance of each, mm².
    pub covariance_mm2: Vec<Matrix3<f64>>,
    /// How each position moves if the target is larger than believed, mm per unit of scale.
    pub by_scale_mm: Vec<Vector3<f64>>,
    /// How each position moves with the numbers of the lens and of the target's shape. Single
    /// precision, because they are the largest part of what a trial takes.
    pub by_numbers: Vec<SMatrix<f32, 3, NUMBERS>>,
}

impl Measured {
    /// A trial's; `camera` is that of `place`.
    ///
    /// # Errors
    /// When the trial does not have its configuration or its poses, or was measured with another
    /// camera.
    pub fn of(
        trial: &Trial,
        points: &Points,
        zero: Zero,
        camera: &Camera,
        place: &str,
    ) -> Result<Self, BadInput> {
        let folder = trial.folder.display();
        let Some(config) = &trial.config else {
            let found =
                "the box's configuration is not known, and with it neither lens nor targets";
            let remedy = "record with `plumb receive --out`, which asks the box for it";
            return Err(BadInput::whole(folder, found, remedy));
        };
        if config.lens != camera.lens {
            let found = format!("it is not the lens with which {folder} was measured");
            let remedy = "give the camera.toml that the box had; `plumb show` and the trial's \
                          config.plb tell its numbers";
            return Err(BadInput::whole(place, found, remedy));
        }
        if config.readout_ns != camera.readout_ns {
            let [own_ms, other_ms] =
                [camera.readout_ns, config.readout_ns].map(|it| 1e-6 * f64::from(it));
            let found = format!("{own_ms} ms, where {folder} was measured with {other_ms} ms");
            let remedy = "give the camera.toml that the box had; `plumb show` and the trial's \
                          config.plb tell its readout";
            return Err(BadInput::new(place, "readout_ms", found, remedy));
        }
        for point in &points.points {
            check_samples(point.series.samples(), &folder)?;
        }
        let lens = LensUncertainty::of(camera, place)?;
        let bodies = points.points.iter().filter_map(|point| {
            let trunk = Trunk::ALL.into_iter().find(|trunk| trunk.word() == point.name)?;
            Some(body(trial, config, trunk, &point.series))
        });
        let bodies: Vec<Body> = bodies.collect::<Result<_, _>>()?;
        Ok(Self { bodies, lens, zero_u_s: zero_u_s(trial, zero) })
    }
}

fn check_samples(samples: usize, folder: &impl std::fmt::Display) -> Result<(), BadInput> {
    if samples <= SAMPLES_MAX {
        return Ok(());
    }
    let found = format!(
        "{samples} frames, and a budget takes {SAMPLES_MAX}, four and a half hours at 60 Hz: more \
         might not fit into the memory"
    );
    Err(BadInput::whole(folder, found, "record the time of interest as a trial of its own"))
}

/// Standard uncertainty of t = 0: a bound of the error is taken to be a rectangle's half width.
fn zero_u_s(trial: &Trial, zero: Zero) -> Option<f64> {
    match zero {
        Zero::Start => Some(0.0),
        Zero::Mark => {
            let mark = trial.manifest.zero_mark();
            Some(mark.map_or(0.0, |mark| mark.uncertain_s / 3_f64.sqrt()))
        }
        Zero::Onset => None,
    }
}

fn body(trial: &Trial, config: &Config, trunk: Trunk, series: &Series) -> Result<Body, BadInput> {
    let place = trial.folder.display();
    let role = match trunk {
        Trunk::Upper => Role::Upper,
        Trunk::Lower => Role::Lower,
    };
    let remedy = "record again with the box's present program";
    let missing = |found: String| BadInput::new(&place, trunk.word(), found, remedy);
    let target = config
        .target(role)
        .ok_or_else(|| missing("the configuration has no target of this role".to_owned()))?;
    let cam_from_scene = config
        .cam_from_scene()
        .ok_or_else(|| missing("the configuration has no scene".to_owned()))?;
    let mut poses = Vec::with_capacity(series.samples());
    let mut covariance_mm2 = Vec::with_capacity(series.samples());
    for (frame, point) in frames_of(&trial.frames, trunk) {
        let pose = frame.cam_from_target(trunk).zip(point.covariance_mm2);
        let (pose, covariance) = pose.ok_or_else(|| {
            missing(format!("frame {} has a position but no pose", frame.sequence))
        })?;
        poses.push(pose);
        covariance_mm2.push(covariance);
    }
    let scene = SceneFrame::new(cam_from_scene);
    let lens = &config.lens;
    Body::new(trunk, series.clone(), covariance_mm2, &poses, lens, &scene, &target.geometry)
        .ok_or_else(|| missing("a pose is edge-on or behind the camera".to_owned()))
}

impl Body {
    /// A point of the body from the poses of its target, one for each sample of `series`; `None`
    /// where a pose is not fixed by what the camera would see.
    ///
    /// # Panics
    /// When the numbers of samples, covariances and poses differ: a caller's bug.
    #[must_use]
    pub fn new(
        trunk: Trunk,
        series: Series,
        covariance_mm2: Vec<Matrix3<f64>>,
        poses: &[Pose<Cam, Target>],
        lens: &Lens,
        scene: &SceneFrame,
        target: &TargetGeometry,
    ) -> Option<Self> {
        assert_eq!([covariance_mm2.len(), poses.len()], [series.samples(); 2]);
        let lever_mm = match trunk {
            Trunk::Upper => Vector3::zeros(),
            Trunk::Lower => target.virtual_point_mm(),
        };
        let body_from_cam = scene.anatomical_from_cam();
        let by_numbers = |pose: &Pose<Cam, Target>| {
            let by_pose = body_from_cam * pose.point_by_increment(&lever_mm);
            let by_numbers = by_pose * response(lens, target, pose)?;
            Some(by_numbers.map(|it| it as f32))
        };
        let by_numbers = poses.par_iter().map(by_numbers).collect::<Option<Vec<_>>>()?;
        let by_scale_mm = poses.iter().map(|pose| body_from_cam * pose.translation_mm).collect();
        Some(Self { trunk, series, covariance_mm2, by_scale_mm, by_numbers })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trial_that_is_too_long_is_refused_with_what_to_do() {
        assert!(check_samples(1_000_000, &"trial").is_ok());
        let refused = check_samples(1_000_001, &"trial").unwrap_err().to_string();
        for part in ["trial: 1000001 frames", "takes 1000000", "record the time of interest"] {
            assert!(refused.contains(part), "{refused}");
        }
    }
}
