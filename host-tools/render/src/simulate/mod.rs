//! A rendered person with known ground truth: both targets on a swaying body, seen by a real
//! camera.
//!
//! ```no_run
//! use plumbline_render::simulate::{Simulation, SimulationSettings};
//!
//! let simulation = Simulation::new(&SimulationSettings::default())?;
//! let mut samples = Vec::<u8>::new();
//! for frame in 0..300 {
//!     simulation.render(frame, &mut samples);
//!     let truth = simulation.truth(frame);
//!     println!("{} s: lumbar at {}", truth.time_s, truth.targets[0].cam_from_target.translation_mm);
//! }
//! # Ok::<(), plumbline_render::simulate::SettingsError>(())
//! ```
//!
//! The targets are integrated exactly ([`render`]); the background and an occluding arm are
//! procedural clutter. The exposure is instantaneous: there is no motion blur. The camera has a
//! global shutter, or a rolling one, whose rows each show the person where they are at the row's own
//! time.

pub mod background;
pub mod layout;
mod normal;
pub mod occluder;
pub mod photographs;
mod provisioning;
pub mod recorded;
pub mod render;
pub mod sensor;
pub mod sway;

use nalgebra::{Vector2, Vector3};
use plumbline::config::READOUT_NS_MAX;
use plumbline::lens::Lens;
use plumbline::pose::{Cam, Pose, Scene, Target};
use plumbline::scene::Anatomical;
use plumbline::target::{Origin, TargetGeometry};
use rayon::prelude::*;

use self::background::Background;
use self::layout::{LensChoice, TargetLayout};
use self::occluder::{Arm, Occlusion};
use self::render::{Board, Ink, PSF_SIGMA_PX_MAX, PSF_SIGMA_PX_MIN, Picture, PlacedBoard};
use self::sensor::{Sample, Sensor};
use self::sway::{Sway, SwaySettings, Trunk};

/// What is simulated. The default is the standard scene: 1456 x 1088, f 1740 px, 12 mm pitch, 1 m,
/// PSF 0.6 px, noise 2 levels, 8 bits, 60 Hz, prints with greys 20 and 220 of 255: paper exposed to
/// 86 % of the sensor's range, as with a properly adjusted camera, and toner that reflects a tenth
/// of that. In poor light the greys are 60 and 180.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationSettings {
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// The seed of the motion, the clutter and the noise.
    pub seed: u64,
    /// Standard deviation of the noise at mid grey, in levels of 255.
    pub noise_levels: f64,
    /// Standard deviation of the lens's Gaussian blur in the raw picture.
    pub psf_sigma_px: f64,
    /// Bits per sample, 8 to 16.
    pub bits: u8,
    /// The lens.
    pub lens: LensChoice,
    /// From the camera to the back; `None` for the lens's own distance.
    pub distance_mm: Option<f64>,
    /// Grey of the prints' black, in levels of 255.
    pub black: f64,
    /// Grey of the prints' white, in levels of 255.
    pub white: f64,
    /// How much brighter the right edge of the frame is than the left one, relative to the middle:
    /// 0.2 is 10 % more and 10 % less.
    pub gradient: f64,
    /// The time from the exposure of the first row to that of the row below the last one, negative
    /// if the sensor is read from the bottom to the top; 0 for a global shutter. The row that is read
    /// first is exposed at the frame's time.
    pub readout_ms: f64,
    /// How the person sways.
    pub sway: SwaySettings,
    /// A steady motion of the whole person besides the sway: forward, to the right, up. They pass
    /// their usual place in the first frame.
    pub drift_mm_s: [f64; 3],
    /// When an arm hides part of a target.
    pub occlusions: Vec<Occlusion>,
}

impl Default for SimulationSettings {
    fn default() -> Self {
        Self {
            frame_rate_hz: 60.0,
            seed: 1,
            noise_levels: 2.0,
            psf_sigma_px: 0.6,
            bits: 8,
            lens: LensChoice::default(),
            distance_mm: None,
            black: 20.0,
            white: 220.0,
            gradient: 0.0,
            readout_ms: 0.0,
            sway: SwaySettings::default(),
            drift_mm_s: [0.0; 3],
            occlusions: Vec::new(),
        }
    }
}

/// A setting that cannot be simulated: its name, its value, and what is possible.
#[derive(Debug, Clone, PartialEq)]
pub struct SettingsError(String);

impl std::fmt::Display for SettingsError {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.0)
    }
}

impl std::error::Error for SettingsError {}

/// One target of the simulation.
#[derive(Debug, Clone)]
pub struct SimulatedTarget {
    /// Its name, size, role and position.
    pub layout: TargetLayout,
    /// Its geometry, as the pipeline uses it.
    pub geometry: TargetGeometry,
    /// What is printed on it.
    pub board: Board,
}

/// The ground truth at one frame.
#[derive(Debug, Clone)]
pub struct Truth {
    /// The frame's number, from 0.
    pub frame: u64,
    /// The instant at which the row that is read first was exposed, from the first frame's.
    pub time_s: f64,
    /// The targets, in the order of [`Simulation::targets`].
    pub targets: Vec<TargetTruth>,
}

/// The ground truth of one target at one frame.
#[derive(Debug, Clone)]
pub struct TargetTruth {
    /// The instant at which the row of its centre was exposed, to which the rest applies.
    pub time_s: f64,
    /// The target's pose.
    pub cam_from_target: Pose<Cam, Target>,
    /// The body point (the target's virtual point) along the scene's axes.
    pub trunk_point: Anatomical,
    /// The number of inner corners inside the frame and not behind the arm.
    pub visible_corners: usize,
}

/// What is in front of the camera at an instant.
struct Moment<'a> {
    /// How far the back has moved in the image.
    trunk_shift_px: [f64; 2],
    /// In the order of [`Simulation::targets`].
    boards: Vec<PlacedBoard<'a>>,
    arms: Vec<Arm>,
}

/// A person, a camera and a room, determined by the settings.
pub struct Simulation {
    settings: SimulationSettings,
    camera: Lens,
    cam_from_scene: Pose<Cam, Scene>,
    targets: Vec<SimulatedTarget>,
    sway: Sway,
    background: Background,
}

impl Simulation {
    /// Prepares everything that does not change from frame to frame.
    ///
    /// # Errors
    /// [`SettingsError`] names the first setting that cannot be simulated.
    pub fn new(settings: &SimulationSettings) -> Result<Self, SettingsError> {
        settings.check()?;
        let camera = settings.lens.lens();
        let distance_mm = settings.distance_mm.unwrap_or(settings.lens.distance_mm());
        let cam_from_scene = layout::cam_from_scene(distance_mm);
        let ink = Ink { black: settings.black, white: settings.white };
        let targets = layout::targets().map(|layout| {
            let geometry = TargetGeometry::checker(
                layout.columns,
                layout.rows,
                layout.pitch_mm,
                Origin::Center,
                layout.role,
                layout.virtual_point_mm,
            )
            .expect("the standard targets are within the limits");
            let board = Board::new(&geometry, layout::MARGIN_MM, ink);
            SimulatedTarget { layout, geometry, board }
        });
        for occlusion in &settings.occlusions {
            if !targets.iter().any(|target| target.layout.name == occlusion.target) {
                return Err(SettingsError(format!(
                    "occlude: there is no target {:?}; the targets are lumbar and shoulder",
                    occlusion.target
                )));
            }
        }
        let frame = [usize::from(camera.width_px), usize::from(camera.height_px)];
        let midline_px = camera
            .project(&cam_from_scene.translation_mm)
            .expect("the scene's origin is in front of the camera");
        let background = Background::new(
            frame,
            midline_px.into(),
            camera.fx_px / distance_mm,
            settings.psf_sigma_px,
            settings.seed,
        );
        Ok(Self {
            camera,
            cam_from_scene,
            targets: targets.into(),
            sway: Sway::new(&settings.sway, settings.seed),
            background,
            settings: settings.clone(),
        })
    }

    /// The settings.
    #[must_use]
    pub fn settings(&self) -> &SimulationSettings {
        &self.settings
    }

    /// The camera.
    #[must_use]
    pub fn camera(&self) -> &Lens {
        &self.camera
    }

    /// The targets: lumbar, shoulder.
    #[must_use]
    pub fn targets(&self) -> &[SimulatedTarget] {
        &self.targets
    }

    /// The pose of the scene.
    #[must_use]
    pub fn cam_from_scene(&self) -> Pose<Cam, Scene> {
        self.cam_from_scene
    }

    fn cam_from_trunk(&self, time_s: f64) -> Pose<Cam, Trunk> {
        let [ap_mm, ml_mm, si_mm] = self.settings.drift_mm_s.map(|speed| speed * time_s);
        let mut scene_from_trunk = self.sway.scene_from_trunk(time_s, &layout::ankle_mm());
        scene_from_trunk.translation_mm += Vector3::new(ml_mm, -si_mm, ap_mm);
        self.cam_from_scene * scene_from_trunk
    }

    fn frame_time_s(&self, frame: u64) -> f64 {
        frame as f64 / self.settings.frame_rate_hz
    }

    /// When row `y` of a frame is exposed: at the frame's time if it is read first.
    fn row_time_s(&self, frame: u64, y: f64) -> f64 {
        let readout_s = self.settings.readout_ms * 1e-3;
        let rows = f64::from(self.camera.height_px);
        let first = if readout_s < 0.0 { rows - 1.0 } else { 0.0 };
        self.frame_time_s(frame) + (y - first) / rows * readout_s
    }

    /// What is in front of the camera at an instant.
    fn moment(&self, time_s: f64) -> Moment<'_> {
        let cam_from_trunk = self.cam_from_trunk(time_s);
        let placed = self.targets.iter().map(|target| PlacedBoard {
            board: &target.board,
            cam_from_target: cam_from_trunk * target.layout.trunk_from_target(),
        });
        let boards: Vec<_> = placed.collect();
        let arm = |occlusion: &Occlusion| {
            let hides = |target: &SimulatedTarget| target.layout.name == occlusion.target;
            let board = &boards[self.targets.iter().position(hides)?];
            occlusion.arm(time_s, &self.camera, &board.cam_from_target, board.board.paper_mm())
        };
        let arms = self.settings.occlusions.iter().filter_map(arm).collect();
        Moment { trunk_shift_px: self.trunk_shift_px(&cam_from_trunk).into(), boards, arms }
    }

    /// How far the point of the back at the scene's origin has moved in the image.
    fn trunk_shift_px(&self, cam_from_trunk: &Pose<Cam, Trunk>) -> Vector2<f64> {
        let back_cam_mm = cam_from_trunk.transform(&layout::back_origin_trunk_mm());
        let now = self.camera.project(&back_cam_mm);
        let rest = self.camera.project(&self.cam_from_scene.translation_mm);
        now.zip(rest).map_or_else(Vector2::zeros, |(now, rest)| now - rest)
    }

    /// When the row in which the centre of a target is seen is exposed.
    fn target_time_s(&self, frame: u64, target: &SimulatedTarget) -> f64 {
        let seen_s = |time_s: f64| {
            let cam_from_target = self.cam_from_trunk(time_s) * target.layout.trunk_from_target();
            let centre_px = self.camera.project(&cam_from_target.translation_mm)?;
            Some(self.row_time_s(frame, centre_px.y))
        };
        let mut time_s = self.row_time_s(frame, f64::from(self.camera.height_px) / 2.0);
        // While one row is read, the centre moves by far less than a row: each round divides the
        // error by more than ten.
        for _ in 0..20 {
            let Some(next_s) = seen_s(time_s) else { break };
            let change_s = next_s - time_s;
            time_s = next_s;
            if change_s.abs() < 1e-12 {
                break;
            }
        }
        time_s
    }

    /// The ground truth at a frame.
    #[must_use]
    pub fn truth(&self, frame: u64) -> Truth {
        let targets = (0..self.targets.len()).map(|index| self.target_truth(frame, index));
        Truth { frame, time_s: self.frame_time_s(frame), targets: targets.collect() }
    }

    fn target_truth(&self, frame: u64, index: usize) -> TargetTruth {
        let target = &self.targets[index];
        let time_s = self.target_time_s(frame, target);
        let moment = self.moment(time_s);
        let cam_from_target = moment.boards[index].cam_from_target;
        let body_cam_mm = cam_from_target.transform(&target.geometry.virtual_point_mm());
        let body_mm = self.cam_from_scene.inverse().transform(&body_cam_mm);
        let right = f64::from(self.camera.width_px - 1);
        let bottom = f64::from(self.camera.height_px - 1);
        let visible = |index: &usize| {
            let corner_mm = cam_from_target.transform(&target.geometry.corner_mm(*index));
            self.camera.project(&corner_mm).is_some_and(|raw_px| {
                (0.0..=right).contains(&raw_px.x)
                    && (0.0..=bottom).contains(&raw_px.y)
                    && moment.arms.iter().all(|arm| arm.depth_px(&raw_px) < 0.0)
            })
        };
        TargetTruth {
            time_s,
            cam_from_target,
            trunk_point: Anatomical { ap_mm: body_mm.z, ml_mm: body_mm.x, si_mm: -body_mm.y },
            visible_corners: (0..target.geometry.corner_count()).filter(visible).count(),
        }
    }

    /// The frame before noise and quantisation, in levels of 0 to 255; `picture`
    /// is resized and overwritten.
    fn render_grey(&self, frame: u64, picture: &mut Picture) {
        let psf_sigma_px = self.settings.psf_sigma_px;
        let (gradient, width) = (self.settings.gradient, usize::from(self.camera.width_px));
        let gain = move |x: f64, _y: f64| 1.0 + gradient * (x / width as f64 - 0.5);
        // One for all rows of a global shutter, or one for each row of a rolling one.
        let rows = if self.settings.readout_ms == 0.0 { 1 } else { self.camera.height_px };
        let moments: Vec<_> = (0..rows)
            .into_par_iter()
            .map(|y| self.moment(self.row_time_s(frame, f64::from(y))))
            .collect();
        let moment_of_row = |y: usize| &moments[y.min(moments.len() - 1)];
        self.background.draw(|y| moment_of_row(y).trunk_shift_px, gain, picture);
        match &moments[..] {
            [moment] => {
                render::render_targets(&self.camera, psf_sigma_px, &moment.boards, &gain, picture);
            }
            _ => render::render_targets_by_row(
                &self.camera,
                psf_sigma_px,
                &|y| &moment_of_row(y).boards,
                &gain,
                picture,
            ),
        }
        for (y, pixels) in picture.grey.chunks_mut(width).enumerate() {
            for arm in &moment_of_row(y).arms {
                arm.draw_row(psf_sigma_px, gain, y, pixels);
            }
        }
    }

    /// A frame as the sensor delivers it, row by row; `samples` is resized and overwritten. `u8`
    /// holds 8 bits, `u16` any supported number.
    ///
    /// # Panics
    /// When the sensor's bits do not fit the samples, which is a caller's bug.
    pub fn render<S: Sample>(&self, frame: u64, samples: &mut Vec<S>) {
        let bits = self.settings.bits;
        assert!(usize::from(bits) <= size_of::<S>() * 8, "{bits} bits do not fit the samples");
        let mut picture = Picture { width: 0, height: 0, grey: Vec::new() };
        self.render_grey(frame, &mut picture);
        samples.resize(picture.grey.len(), S::default());
        let sensor = Sensor { noise_levels: self.settings.noise_levels as f32, bits };
        sensor.expose(&picture, self.settings.seed, frame, samples);
    }
}

impl SimulationSettings {
    fn check(&self) -> Result<(), SettingsError> {
        let within = |name: &str, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            Err(SettingsError(format!("{name}: {value}; give a value from {low} to {high}")))
        };
        within("fps", self.frame_rate_hz, 1e-3, 1e5)?;
        within("noise", self.noise_levels, 0.0, 100.0)?;
        within("psf", self.psf_sigma_px, PSF_SIGMA_PX_MIN, PSF_SIGMA_PX_MAX)?;
        within("bits", f64::from(self.bits), 8.0, 16.0)?;
        // If closer, a target fills the frame; if farther, its squares are smaller than a pixel.
        within("distance", self.distance_mm.unwrap_or(1000.0), 100.0, 20_000.0)?;
        within("black", self.black, 0.0, 255.0)?;
        within("white", self.white, 0.0, 255.0)?;
        within("gradient", self.gradient, -1.0, 1.0)?;
        let readout_ms_max = 1e-6 * f64::from(READOUT_NS_MAX);
        within("readout-ms", self.readout_ms, -readout_ms_max, readout_ms_max)?;
        for speed_mm_s in self.drift_mm_s {
            within("drift-mm-s", speed_mm_s, -1e4, 1e4)?;
        }
        within("sway-mm", self.sway.ap_sd_mm, 0.0, 100.0)?;
        within("sway.ml_sd_mm", self.sway.ml_sd_mm, 0.0, 100.0)?;
        within("sway.twist_sd_rad", self.sway.twist_sd_rad, 0.0, 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn still() -> SimulationSettings {
        let sway = SwaySettings { ap_sd_mm: 0.0, ml_sd_mm: 0.0, twist_sd_rad: 0.0 };
        SimulationSettings { sway, ..SimulationSettings::default() }
    }

    #[test]
    fn a_person_who_stands_still_is_where_the_layout_says() {
        let truth = Simulation::new(&still()).unwrap().truth(0);
        let half_mm = layout::SHOULDER_ABOVE_LUMBAR_MM / 2.0;
        // The lumbar virtual point is 100 mm along an axis tilted by 3 and 5 degrees.
        let (yaw, pitch) = (3.0_f64.to_radians(), 5.0_f64.to_radians());
        let lower = truth.targets[0].trunk_point;
        assert!((lower.ap_mm - 100.0 * yaw.cos() * pitch.cos()).abs() < 1e-9);
        assert!((lower.ml_mm - 100.0 * yaw.sin() * pitch.cos()).abs() < 1e-9);
        assert!((lower.si_mm - (-half_mm - 100.0 * pitch.sin())).abs() < 1e-9);
        let upper = truth.targets[1].trunk_point;
        let found = [upper.ap_mm, upper.ml_mm, upper.si_mm];
        for (found, wanted) in found.iter().zip([15.0, -170.0, half_mm]) {
            assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
        }
    }

    #[test]
    fn both_prints_stay_in_the_frame_with_every_lens() {
        for lens in [LensChoice::None, LensChoice::Mild, LensChoice::Wide] {
            let simulation =
                Simulation::new(&SimulationSettings { lens, ..SimulationSettings::default() })
                    .unwrap();
            let camera = simulation.camera();
            // Ten minutes, every second.
            for frame in (0..36_000).step_by(60) {
                for (target, known) in
                    simulation.targets().iter().zip(simulation.truth(frame).targets)
                {
                    let [left, top, right, bottom] = target.board.paper_mm();
                    for (x, y) in [(left, top), (right, top), (left, bottom), (right, bottom)] {
                        let corner_mm = known.cam_from_target.transform(&Vector3::new(x, y, 0.0));
                        let raw_px = camera.project(&corner_mm).unwrap();
                        // The detector's largest kernel must fit around the outermost corner.
                        const BORDER_PX: f64 = 15.0;
                        assert!((BORDER_PX..1456.0 - BORDER_PX).contains(&raw_px.x), "{raw_px}");
                        assert!((BORDER_PX..1088.0 - BORDER_PX).contains(&raw_px.y), "{raw_px}");
                    }
                }
            }
        }
    }

    #[test]
    fn frames_do_not_depend_on_the_number_of_threads() {
        let simulation = Simulation::new(&SimulationSettings::default()).unwrap();
        let rendered = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut samples: Vec<u8> = Vec::new();
            pool.install(|| simulation.render(5, &mut samples));
            samples
        };
        assert!(rendered(1) == rendered(3));
    }

    #[test]
    fn an_arm_hides_a_part_of_its_target_and_only_then() {
        let occlusions = vec!["shoulder:1:2:0.5".parse().unwrap()];
        let simulation = Simulation::new(&SimulationSettings { occlusions, ..still() }).unwrap();
        let visible = |frame: u64| {
            let targets = simulation.truth(frame).targets;
            [targets[0].visible_corners, targets[1].visible_corners]
        };
        assert_eq!(visible(59), [30, 20]);
        assert_eq!(visible(121), [30, 20]);
        let [lumbar, shoulder] = visible(90);
        assert_eq!(lumbar, 30);
        // Half of the paper's width, with a slanted round tip: two to three of five columns.
        assert!((8..=12).contains(&shoulder), "{shoulder}");
        let (mut before, mut during) = (Picture::uniform(0, 0, 0.0), Picture::uniform(0, 0, 0.0));
        simulation.render_grey(59, &mut before);
        simulation.render_grey(90, &mut during);
        let changed = before.grey.iter().zip(&during.grey).filter(|(a, b)| a != b).count();
        assert!((20_000..400_000).contains(&changed), "{changed}");
    }

    #[test]
    fn the_light_grows_to_the_right_by_the_gradient() {
        let mean = |gradient: f64, columns: std::ops::Range<usize>| {
            let simulation = Simulation::new(&SimulationSettings { gradient, ..still() }).unwrap();
            let mut picture = Picture::uniform(0, 0, 0.0);
            simulation.render_grey(0, &mut picture);
            let rows = picture.grey.chunks(picture.width);
            rows.flat_map(|row| row[columns.clone()].iter().map(|grey| f64::from(*grey)))
                .sum::<f64>()
        };
        // Columns 546 and 910 are a quarter of the width apart: +-1/8 of the gradient.
        let ratio =
            |columns: std::ops::Range<usize>| mean(0.4, columns.clone()) / mean(0.0, columns);
        assert!((ratio(545..548) - 0.95).abs() < 1e-3);
        assert!((ratio(909..912) - 1.05).abs() < 1e-3);
    }

    #[test]
    fn a_row_of_a_rolling_shutter_shows_the_person_at_its_own_time() {
        // The frames of a camera with a global shutter that takes one frame while the other reads
        // one row.
        let occlusions: Vec<Occlusion> = vec!["shoulder:0:0.03:0.5".parse().unwrap()];
        let moving = SimulationSettings {
            drift_mm_s: [30.0, -200.0, 100.0],
            occlusions,
            ..SimulationSettings::default()
        };
        let row_hz = 1088.0 / 0.016;
        let fast = SimulationSettings { frame_rate_hz: row_hz, ..moving.clone() };
        let fast = Simulation::new(&fast).unwrap();
        let rolling = SimulationSettings { readout_ms: 16.0, ..moving };
        let rolling = Simulation::new(&rolling).unwrap();
        let [mut rows, mut still] = [Picture::uniform(0, 0, 0.0), Picture::uniform(0, 0, 0.0)];
        rolling.render_grey(0, &mut rows);
        // Each crosses a target.
        for y in [150, 300, 350, 800, 950] {
            fast.render_grey(y as u64, &mut still);
            let row = |picture: &Picture| picture.grey[y * 1456..][..1456].to_vec();
            let error = row(&rows).into_iter().zip(row(&still)).map(|(a, b)| (a - b).abs());
            // The times differ by the rounding of y / 1088 * 0.016.
            assert!(error.fold(0.0, f32::max) < 1e-4, "row {y}");
        }
    }

    #[test]
    fn the_truth_of_a_target_is_that_of_the_row_of_its_centre() {
        for (readout_ms, first) in [(16.0, 0.0), (-16.0, 1087.0)] {
            let drift_mm_s = [0.0, 0.0, 200.0];
            let settings = SimulationSettings { readout_ms, drift_mm_s, ..still() };
            let simulation = Simulation::new(&settings).unwrap();
            let rest = Simulation::new(&still()).unwrap().truth(0);
            for (target, rest) in simulation.truth(3).targets.iter().zip(&rest.targets) {
                let centre = target.cam_from_target.translation_mm;
                let y = simulation.camera().project(&centre).unwrap().y;
                let exposed_s = 3.0 / 60.0 + (y - first) / 1088.0 * readout_ms * 1e-3;
                assert!((target.time_s - exposed_s).abs() < 1e-11, "{}", target.time_s);
                let risen_mm = target.trunk_point.si_mm - rest.trunk_point.si_mm;
                assert!((risen_mm - 200.0 * exposed_s).abs() < 1e-8, "{risen_mm}");
            }
        }
    }

    #[test]
    fn impossible_settings_are_named() {
        let message = |settings: SimulationSettings| {
            Simulation::new(&settings).map(|_| ()).unwrap_err().to_string()
        };
        assert!(
            message(SimulationSettings { noise_levels: f64::NAN, ..still() }).contains("noise")
        );
        assert!(message(SimulationSettings { psf_sigma_px: 0.0, ..still() }).contains("psf"));
        assert!(
            message(SimulationSettings { distance_mm: Some(5.0), ..still() }).contains("distance")
        );
        assert!(
            message(SimulationSettings { readout_ms: f64::NAN, ..still() }).contains("readout-ms")
        );
        let drift_mm_s = [0.0, f64::INFINITY, 0.0];
        assert!(message(SimulationSettings { drift_mm_s, ..still() }).contains("drift-mm-s"));
        let occlusions = vec!["knee:1:2".parse().unwrap()];
        assert!(message(SimulationSettings { occlusions, ..still() }).contains("knee"));
    }
}
