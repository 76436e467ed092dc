//! A scene, a camera or targets that were wrong, replaced after the recording.
//!
//! The packets hold the targets' poses in the camera's frame, so that nothing has to be measured
//! again. What the box was told stays as it is (`packets.bin`, `config.plb`); the configuration that
//! it should have been told stands beside it (`corrected.plb`). A [`Correction`] turns each message
//! into the one that the box would have sent with it, before anything else reads it.
//!
//! | replaced | what follows | how exact |
//! |---|---|---|
//! | scene, virtual point, role | trunk points anew from the poses | to the poses' rounding: 0.0001 mm |
//! | pitch or measured corners | poses anew from the corners | see below |
//! | camera of the same frame size | poses anew from the corners, the scene board's too | see below |
//!
//! A pose anew: the target's corners are projected through the old lens at the old pose; the core's
//! solver finds the pose at which the new target appears there through the new lens. The covariance is
//! carried over to first order. The packets do not tell where the corners themselves were seen, nor
//! which of them were covered. The pose that fits them best stands for them, with all corners of
//! equal weight: what a wrong lens or a wrong print bends within a target enters the pose as the box
//! fitted it. For a print of another pitch, which bends nothing, the result is exact; for another
//! lens the error is of the second order in the difference of the lenses within a target (tested: for
//! 1 % of focal length and 5 px of its centre, 0.0005 mm are left of 8.6 mm).
//!
//! A grid that the box did not look for, or a frame of another size, cannot be replaced: nothing was
//! measured of it. A scene that was measured with another camera than the trial's is refused.

use std::path::{Path, PathBuf};

use nalgebra::{Matrix2x6, Matrix6};
use plumbline::config::{BLOB_BYTES_MAX, Config, TargetConfig};
use plumbline::lens::{Lens, ray_by_point, ray_of};
use plumbline::packet::{AnatomicalPoint, Hello, MeasuredPose, Message, Packet, PosePacket, View};
use plumbline::parts::{SeenCorner, Shutter, solve};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::NoPose;
use plumbline::scene::SceneFrame;
use plumbline::target::{Role, TargetGeometry};
use plumbline_files::{BadInput, camera, scene, targets};
use serde::{Deserialize, Serialize};

use crate::names;

/// Steps of the solver: a camera or a print that is wrong by some percent takes four or five.
const ITERATIONS: usize = 15;

/// The standard deviation of a corner: all have the same, and its size does not matter.
const SIGMA_PX: f64 = 1.0;

/// The files that replace what was recorded.
#[derive(Debug, Clone, Default)]
pub struct Replacements {
    /// Where the scene board stood.
    pub scene: Option<PathBuf>,
    /// The camera.
    pub camera: Option<PathBuf>,
    /// The targets.
    pub targets: Option<PathBuf>,
}

/// What was replaced, as `trial.toml` has it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Corrected {
    /// When, UTC.
    pub when: String,
    /// The checksum of the configuration with it: `corrected.plb`.
    pub config_crc: String,
    /// The files.
    #[serde(rename = "file")]
    pub files: Vec<Replaced>,
}

/// One file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Replaced {
    /// `scene`, `camera` or `targets`.
    pub what: String,
    /// Its path, as it was given.
    pub path: String,
    /// Its checksum, CRC-32.
    pub crc: String,
}

impl Corrected {
    /// What was replaced, in words.
    #[must_use]
    pub fn words(&self) -> String {
        let files: Vec<String> =
            self.files.iter().map(|file| format!("{} by {}", file.what, file.path)).collect();
        format!("replaced after the recording: {}", files.join(", "))
    }
}

/// From what the box was told to what it should have been told.
#[derive(Debug, Clone)]
pub struct Correction {
    recorded: Config,
    corrected: Config,
}

impl Correction {
    /// The correction in a trial's folder, if there is one.
    ///
    /// # Errors
    /// When it cannot be read, or does not belong to the trial's configuration.
    pub fn read(folder: &Path, recorded: Option<&Config>) -> Result<Option<Self>, BadInput> {
        let path = folder.join(names::CORRECTED);
        let blob = match std::fs::read(&path) {
            Ok(blob) => blob,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(BadInput::io(path.display(), &error)),
        };
        let remedy = "take it back with `plumb replay TRIAL --tables --as-recorded`, or give the \
                      files again";
        let corrected = Config::decode(&blob)
            .map_err(|error| BadInput::whole(path.display(), error, remedy))?;
        let correction = recorded.map(|it| Self { recorded: it.clone(), corrected });
        match correction.filter(Self::is_possible) {
            Some(correction) => Ok(Some(correction)),
            None => Err(BadInput::whole(
                path.display(),
                format!("it does not belong to the trial's {}", names::CONFIG),
                remedy,
            )),
        }
    }

    /// The correction by these files of what the box was told, and what to write about it.
    ///
    /// # Errors
    /// When a file cannot be used, or cannot replace what was recorded.
    pub fn of(
        replacements: &Replacements,
        recorded: &Config,
        warnings: &mut Vec<String>,
    ) -> Result<(Self, Corrected), BadInput> {
        let Replacements { scene, camera, targets } = replacements;
        let mut corrected = recorded.clone();
        if let Some(path) = camera {
            replace_camera(&mut corrected, path)?;
        }
        if let Some(path) = targets {
            replace_targets(&mut corrected, path)?;
        }
        let mut correction = Self { recorded: recorded.clone(), corrected };
        correction.corrected.cam_from_scene_theta = match scene {
            Some(path) => {
                let scene = scene::read(path)?;
                let lens = &correction.corrected.lens;
                warnings.extend(scene.check_lens(lens, &path.display().to_string())?);
                Some(scene.cam_from_scene_theta)
            }
            None => correction.scene_anew(camera.as_ref().or(targets.as_ref()))?,
        };
        let given = [("scene", scene), ("camera", camera), ("targets", targets)];
        let mut files = Vec::new();
        for (what, path) in
            given.into_iter().filter_map(|(what, path)| Some((what, path.as_ref()?)))
        {
            let crc = plumbline::packet::document_crc(&plumbline_files::bytes_of(path)?);
            let path = path.display().to_string();
            files.push(Replaced { what: what.to_owned(), path, crc: format!("{crc:08x}") });
        }
        let place = files.first().map(|file| file.path.clone()).unwrap_or_default();
        correction
            .corrected
            .check()
            .map_err(|error| BadInput::whole(place, error, "correct this value"))?;
        let corrected = Corrected {
            when: jiff::Timestamp::now().to_string(),
            config_crc: format!("{:08x}", correction.corrected.crc()),
            files,
        };
        Ok((correction, corrected))
    }

    /// The configuration that the box should have been told.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.corrected
    }

    /// Its bytes, for [`names::CORRECTED`].
    #[must_use]
    pub fn blob(&self) -> Vec<u8> {
        let mut buffer = vec![0; BLOB_BYTES_MAX];
        self.corrected.encode(&mut buffer).expect("it has been checked").to_vec()
    }

    /// The message that the box would have sent.
    #[must_use]
    pub fn apply(&self, message: Message) -> Message {
        match message {
            Message::Pose(packet) => Message::Pose(self.pose_packet(packet)),
            Message::Hello(hello) => Message::Hello(self.hello(hello)),
            Message::View(view) => Message::View(self.view(view)),
            other => other,
        }
    }

    /// Whether each target of the box has one of the same grid, and frames have the same size.
    fn is_possible(&self) -> bool {
        let size = |config: &Config| (config.lens.width_px, config.lens.height_px);
        size(&self.recorded) == size(&self.corrected)
            && self.recorded.targets.iter().all(|it| self.counterpart(&it.geometry).is_some())
    }

    /// The target of the same grid: a configuration has no two.
    fn counterpart(&self, recorded: &TargetGeometry) -> Option<&TargetConfig> {
        self.corrected.targets.iter().find(|it| it.geometry.shape() == recorded.shape())
    }

    /// A target by the role that the box knew it by, and what it should have been told of it.
    fn target(&self, role: Role) -> Option<(&TargetGeometry, &TargetConfig)> {
        let recorded =
            &self.recorded.targets.iter().find(|it| it.geometry.role() == role)?.geometry;
        Some((recorded, self.counterpart(recorded)?))
    }

    fn role(&self, recorded: Role) -> Role {
        self.target(recorded).map_or(recorded, |(_, target)| target.geometry.role())
    }

    fn hello(&self, mut hello: Hello) -> Hello {
        for info in &mut hello.targets {
            if let Some((_, target)) = self.target(info.role) {
                info.name = target.name.clone();
                info.role = target.geometry.role();
            }
        }
        hello
    }

    fn view(&self, mut view: View) -> View {
        for target in &mut view.targets {
            target.role = self.role(target.role);
        }
        view
    }

    fn pose_packet(&self, mut packet: PosePacket) -> PosePacket {
        for seen in &mut packet.targets {
            let Some((recorded, target)) = self.target(seen.role) else { continue };
            seen.role = target.geometry.role();
            if let Ok(pose) = seen.pose {
                seen.pose = self.pose(&pose, recorded, &target.geometry).ok_or(NoPose::PoorFit);
            }
        }
        let scene = self.corrected.cam_from_scene().map(SceneFrame::new);
        let pose = |role| Some((scene?, packet.pose(role)?.cam_from_target()));
        let upper = pose(Role::Upper).map(|(scene, pose)| scene.upper_trunk(&pose));
        let lower = pose(Role::Lower).and_then(|(scene, pose)| {
            let targets = &mut self.corrected.targets.iter();
            let lower = targets.find(|it| it.geometry.role() == Role::Lower)?;
            Some(scene.lower_trunk(&pose, &lower.geometry.virtual_point_mm()))
        });
        packet.upper_trunk = upper.as_ref().map(AnatomicalPoint::from);
        packet.lower_trunk = lower.as_ref().map(AnatomicalPoint::from);
        packet
    }

    /// The pose of a target that was another than the box had been told; `None` where the new lens
    /// does not show it.
    fn pose(
        &self,
        recorded: &MeasuredPose,
        from: &TargetGeometry,
        to: &TargetGeometry,
    ) -> Option<MeasuredPose> {
        let mut pose = *recorded;
        if self.changes_poses(from, to) {
            let anew = PoseAnew::of(
                &self.recorded_sight(from),
                &self.corrected_sight(to),
                &recorded.cam_from_target(),
            )?;
            anew.write(&mut pose);
        }
        let (lens, readout_ns) = (&self.corrected.lens, self.corrected.readout_ns);
        if readout_ns != self.recorded.readout_ns {
            let shutter = Shutter::new(readout_ns, lens.height_px);
            let middle_cam_mm = pose.cam_from_target().transform(&to.middle_mm());
            pose.delay_ns = lens.project(&middle_cam_mm).map_or(0, |raw| shutter.delay_ns(raw.y));
        }
        Some(pose)
    }

    fn changes_poses(&self, from: &TargetGeometry, to: &TargetGeometry) -> bool {
        self.recorded.lens != self.corrected.lens
            || (0..from.corner_count()).any(|corner| from.corner_mm(corner) != to.corner_mm(corner))
    }

    fn recorded_sight<'a>(&'a self, target: &'a TargetGeometry) -> Sight<'a> {
        Sight { lens: &self.recorded.lens, target }
    }

    fn corrected_sight<'a>(&'a self, target: &'a TargetGeometry) -> Sight<'a> {
        Sight { lens: &self.corrected.lens, target }
    }

    /// The scene that the box measured, as it would have been with the files that `path` is one of.
    fn scene_anew(&self, path: Option<&PathBuf>) -> Result<Option<[f64; 6]>, BadInput> {
        let Some(theta) = self.recorded.cam_from_scene_theta else { return Ok(None) };
        let place = path.map(|path| path.display().to_string()).unwrap_or_default();
        let without = |found: &str| {
            BadInput::whole(&place, found, "give the scene too, measured with this: --scene FILE")
        };
        let Some((board, target)) = self.target(Role::Scene) else {
            if self.recorded.lens == self.corrected.lens {
                return Ok(Some(theta));
            }
            return Err(without(
                "the box's scene was measured with another camera, and the board is not known",
            ));
        };
        if !self.changes_poses(board, &target.geometry) {
            return Ok(Some(theta));
        }
        let (old, new) = (self.recorded_sight(board), self.corrected_sight(&target.geometry));
        let anew = PoseAnew::of(&old, &new, &Pose::from_theta(theta));
        let anew = anew.ok_or_else(|| without("the scene board has no pose with it"))?;
        Ok(Some(anew.pose.theta()))
    }
}

/// The packet that the box would have sent, if it was told something wrong.
pub(crate) fn corrected(correction: Option<&Correction>, packet: Packet) -> Packet {
    match correction {
        Some(correction) => Packet { message: correction.apply(packet.message), ..packet },
        None => packet,
    }
}

fn replace_camera(config: &mut Config, path: &Path) -> Result<(), BadInput> {
    let camera = camera::read(path)?;
    let place = path.display();
    if camera::is_stand_in(&camera.lens) {
        let remedy = "calibrate it with `plumb calibrate`";
        return Err(BadInput::whole(place, "the camera is not calibrated", remedy));
    }
    let size = |lens: &Lens| (lens.width_px, lens.height_px);
    let ((width, height), old) = (size(&camera.lens), size(&config.lens));
    if (width, height) != old {
        return Err(BadInput::new(
            place,
            "width_px, height_px",
            format!("{width} x {height}, and the box's frames had {} x {}", old.0, old.1),
            "give the calibration of that frame size",
        ));
    }
    (config.lens, config.readout_ns) = (camera.lens, camera.readout_ns);
    Ok(())
}

fn replace_targets(config: &mut Config, path: &Path) -> Result<(), BadInput> {
    let place = path.display();
    let file = targets::read(path)?;
    let recorded = std::mem::take(&mut config.targets);
    let shape = |geometry: &TargetGeometry| (geometry.columns(), geometry.rows());
    for target in &recorded {
        let (columns, rows) = shape(&target.geometry);
        let found = file.targets.iter().find(|it| shape(&it.geometry) == (columns, rows));
        let target = match found {
            Some(found) => TargetConfig {
                name: found.name.as_str().try_into().expect("a name that fits"),
                geometry: found.geometry.clone(),
            },
            // A board that stood there once need not be described again.
            None if target.geometry.role() == Role::Scene => target.clone(),
            None => {
                return Err(BadInput::new(
                    place,
                    "columns, rows",
                    format!(
                        "no target has {columns} x {rows} corners, as the box's {}",
                        target.name
                    ),
                    "describe the same grid; another one was not looked for and cannot be had",
                ));
            }
        };
        assert!(config.targets.push(target).is_ok(), "as many as were recorded");
    }
    let is_recorded = |geometry: &TargetGeometry| {
        recorded.iter().any(|it| shape(&it.geometry) == shape(geometry))
    };
    let unknown = file
        .targets
        .iter()
        .find(|it| it.geometry.role() != Role::Scene && !is_recorded(&it.geometry));
    match unknown {
        None => Ok(()),
        Some(target) => {
            let (columns, rows) = shape(&target.geometry);
            Err(BadInput::new(
                place,
                &target.name,
                format!("the box did not look for a grid of {columns} x {rows} corners"),
                "leave it out: it was not measured",
            ))
        }
    }
}

/// A target through a lens.
struct Sight<'a> {
    lens: &'a Lens,
    target: &'a TargetGeometry,
}

/// A pose that was found anew.
struct PoseAnew {
    pose: Pose<Cam, Target>,
    /// How it changes with the pose that it was found from, as increments of [`Pose::moved_by`].
    by_old: Matrix6<f64>,
    /// What the corners are off: the new target or lens bends them otherwise.
    rms_px: f64,
}

impl PoseAnew {
    /// The pose at which the target appears through `new` where it appeared through `old`.
    fn of(old: &Sight<'_>, new: &Sight<'_>, old_pose: &Pose<Cam, Target>) -> Option<Self> {
        let mut seen = Vec::with_capacity(new.target.corner_count());
        for corner in 0..new.target.corner_count() {
            let old_cam_mm = old_pose.transform(&old.target.corner_mm(corner));
            let ray = new.lens.ray_from_raw(&old.lens.project(&old_cam_mm)?)?;
            let (_, raw_by_ray) = new.lens.raw_from_ray_with_jacobian(&ray);
            let point_target_mm = new.target.corner_mm(corner);
            seen.push(SeenCorner { point_target_mm, ray, raw_by_ray, sigma_px: SIGMA_PX });
        }
        let pose = solve(old_pose, &seen[..], ITERATIONS).ok()?.cam_from_target;

        // Least squares: the increments that move the corners alike, to first order.
        let (mut normal, mut right) = (Matrix6::zeros(), Matrix6::zeros());
        let mut square_px2 = 0.0;
        for (corner, seen) in seen.iter().enumerate() {
            let new_ray = ray_of(&pose.transform(&seen.point_target_mm))?;
            square_px2 += (seen.raw_by_ray * (new_ray - seen.ray)).norm_squared();
            let new_rows = new.raw_by_increment(&pose, corner)?;
            let old_rows = old.raw_by_increment(old_pose, corner)?;
            normal += new_rows.transpose() * new_rows;
            right += new_rows.transpose() * old_rows;
        }
        let by_old = normal.cholesky()?.solve(&right);
        Some(Self { pose, by_old, rms_px: (square_px2 / seen.len() as f64).sqrt() })
    }

    /// Writes it in place of the pose that it was found from.
    fn write(&self, pose: &mut MeasuredPose) {
        let [a, b, c, x, y, z] = self.pose.theta().map(|it| it as f32);
        let covariance = self.by_old * pose.covariance() * self.by_old.transpose();
        let sd = |axis: usize| covariance[(axis, axis)].max(0.0).sqrt();
        (pose.theta_rad, pose.translation_mm) = ([a, b, c], [x, y, z]);
        pose.sd_rad = [0, 1, 2].map(|axis| sd(axis) as f32);
        pose.sd_mm = [3, 4, 5].map(|axis| sd(axis) as f32);
        let pairs = (0..6).flat_map(|i| (i + 1..6).map(move |j| (i, j)));
        for ((i, j), correlation) in pairs.zip(&mut pose.correlations) {
            let sds = sd(i) * sd(j);
            *correlation = if sds > 0.0 { (covariance[(i, j)] / sds) as f32 } else { 0.0 };
        }
        pose.rms_px = f64::from(pose.rms_px).hypot(self.rms_px) as f32;
    }
}

impl Sight<'_> {
    /// How a corner's raw pixel moves with an increment of the pose: of its x, and of its y.
    fn raw_by_increment(
        &self,
        cam_from_target: &Pose<Cam, Target>,
        corner: usize,
    ) -> Option<Matrix2x6<f64>> {
        let point_target_mm = self.target.corner_mm(corner);
        let point_cam_mm = cam_from_target.transform(&point_target_mm);
        let ray = ray_of(&point_cam_mm)?;
        let (_, raw_by_ray) = self.lens.raw_from_ray_with_jacobian(&ray);
        let raw_by_point = raw_by_ray * ray_by_point(&point_cam_mm, &ray);
        Some(raw_by_point * cam_from_target.point_by_increment(&point_target_mm))
    }
}

#[cfg(test)]
mod tests;
