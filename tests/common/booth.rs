//! One target in front of a camera, at any pose and in any light: frames with known truth.

use nalgebra::{Vector3, Vector6};
use plumbline::config::{Config, Links, Machine, TargetConfig};
use plumbline::image::GreyImage;
use plumbline::lens::{Distortion, Lens};
use plumbline::parts::Shutter;
use plumbline::pipeline::{Measurable, Pipeline};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::Measurement;
use plumbline::report::NoPose;
use plumbline::target::{Origin, Role, TargetGeometry};
use plumbline_render::simulate::render::{
    Board, Ink, Picture, PlacedBoard, render_targets, render_targets_by_row,
};
use plumbline_render::simulate::sensor::Sensor;

/// The part of the standard scene's picture around one target, seen through the same lens.
pub const WIDTH: u16 = 400;
/// Its rows.
pub const HEIGHT: u16 = 360;

/// In poor light; with more contrast all errors but the systematic ones are smaller.
const INK: Ink = Ink { black: 60.0, white: 180.0 };
const MARGIN_MM: f64 = 12.0;
/// What is behind the paper.
const BACKGROUND: f32 = 100.0;

/// How one frame is taken.
#[derive(Debug, Clone, Copy)]
pub struct Shot {
    /// The lens's blur.
    pub psf_sigma_px: f64,
    /// Noise at mid grey, in levels of 255; 0: neither noise nor rounding.
    pub noise_levels: f64,
    /// Factor of the light.
    pub light: f64,
    /// How much more light falls on the frame's right edge than on the left one.
    pub gradient: f64,
    /// How far the target moves while the shutter is open.
    pub motion_mm: Vector3<f64>,
}

impl Shot {
    /// As in the standard scene.
    pub const STANDARD: Self = Self {
        psf_sigma_px: 0.6,
        noise_levels: 2.0,
        light: 1.0,
        gradient: 0.0,
        motion_mm: Vector3::new(0.0, 0.0, 0.0),
    };
}

/// A camera, a target and the pipeline that watches it.
pub struct Booth {
    lens: Lens,
    board: Board,
    pipeline: Box<Pipeline>,
    frame: u64,
    rate_hz: f64,
    shutter: Shutter,
    noise_seed: u64,
}

impl Booth {
    /// A target of `columns` x `rows` corners of the standard pitch, seen 60 times a second.
    pub fn new(columns: u8, rows: u8) -> Self {
        Self::at_hz(columns, rows, 60.0)
    }

    /// The same, seen at another rate.
    pub fn at_hz(columns: u8, rows: u8, rate_hz: f64) -> Self {
        Self::rolling(columns, rows, rate_hz, 0)
    }

    /// The same, by a camera that reads the rows of the standard scene's whole picture in this time.
    pub fn rolling(columns: u8, rows: u8, rate_hz: f64, whole_readout_ns: i32) -> Self {
        Self::with_setting(columns, rows, rate_hz, whole_readout_ns, whole_readout_ns)
    }

    /// The same by a camera whose file says that all rows are exposed at once.
    pub fn taken_for_global(columns: u8, rows: u8, rate_hz: f64, whole_readout_ns: i32) -> Self {
        Self::with_setting(columns, rows, rate_hz, whole_readout_ns, 0)
    }

    fn with_setting(
        columns: u8,
        rows: u8,
        rate_hz: f64,
        whole_readout_ns: i32,
        whole_setting_ns: i32,
    ) -> Self {
        // These rows' share.
        let [readout_ns, setting_ns] = [whole_readout_ns, whole_setting_ns]
            .map(|whole_ns| (f64::from(whole_ns) * f64::from(HEIGHT) / 1088.0) as i32);
        let lens = Lens {
            width_px: WIDTH,
            height_px: HEIGHT,
            fx_px: 1740.0,
            fy_px: 1741.0,
            cx_px: f64::from(WIDTH) / 2.0 + 3.3,
            cy_px: f64::from(HEIGHT) / 2.0 - 2.1,
            skew_px: 0.0,
            distortion: Distortion::Radial2([-0.12, 0.08]),
        };
        let geometry =
            TargetGeometry::checker(columns, rows, 12.0, Origin::Center, Role::Upper, [0.0; 3])
                .expect("a usual grid");
        let board = Board::new(&geometry, MARGIN_MM, INK);
        let name = "target".try_into().expect("a short name");
        let config = Config {
            device: heapless::String::new(),
            serial_number: heapless::String::new(),
            lens,
            readout_ns: setting_ns,
            targets: [TargetConfig { name, geometry }].into_iter().collect(),
            cam_from_scene_theta: None,
            links: Links::default(),
            capture: None,
            machine: Machine::default(),
            trigger: None,
        };
        let mut pipeline = Box::new(Pipeline::new());
        pipeline.configure(&config).expect("a usual camera");
        let shutter = Shutter::new(readout_ns, HEIGHT);
        Self { lens, board, pipeline, frame: 0, rate_hz, shutter, noise_seed: 17 }
    }

    /// The same with other noise.
    pub fn with_noise(self, noise_seed: u64) -> Self {
        Self { noise_seed, ..self }
    }

    /// Before noise and rounding.
    fn expose(&self, cam_from_target: &Pose<Cam, Target>, shot: &Shot) -> Picture {
        let (width, height) = (usize::from(WIDTH), usize::from(HEIGHT));
        let gain =
            |x: f64, _y: f64| shot.light * (1.0 + shot.gradient * (x / f64::from(WIDTH) - 0.5));
        // An odd number of instants, evenly spaced: their mean is the pose itself. Where they are less than
        // half of the blur's deviation apart, a steady motion would look the same.
        let moved_px = shot.motion_mm.norm() * self.lens.fx_px / cam_from_target.translation_mm.z;
        let instants = match moved_px / shot.psf_sigma_px {
            0.0 => 1,
            ..2.0 => 5,
            _ => 9,
        };
        let mut sum = Picture::uniform(width, height, 0.0);
        for instant in 0..instants {
            let mut pose = *cam_from_target;
            let part = (f64::from(instant) + 0.5) / f64::from(instants) - 0.5;
            pose.translation_mm += shot.motion_mm * part;
            let mut picture = Picture::uniform(width, height, BACKGROUND);
            let placed = PlacedBoard { board: &self.board, cam_from_target: pose };
            render_targets(&self.lens, shot.psf_sigma_px, &[placed], &gain, &mut picture);
            for (sum, grey) in sum.grey.iter_mut().zip(&picture.grey) {
                *sum += grey / instants as f32;
            }
        }
        sum
    }

    /// The same for a target that moves while its rows are read: `pose_at` some seconds after the
    /// first frame.
    fn expose_rows(
        &self,
        pose_at: impl Fn(f64) -> Pose<Cam, Target>,
        psf_sigma_px: f64,
    ) -> Picture {
        let rows: Vec<_> = (0..HEIGHT)
            .map(|row| {
                let time_s = self.time_s(self.shutter.delay_ns(f64::from(row)));
                [PlacedBoard { board: &self.board, cam_from_target: pose_at(time_s) }]
            })
            .collect();
        let mut picture = Picture::uniform(usize::from(WIDTH), usize::from(HEIGHT), BACKGROUND);
        let boards_of_row = |y: usize| &rows[y][..];
        render_targets_by_row(&self.lens, psf_sigma_px, &boards_of_row, &|_, _| 1.0, &mut picture);
        picture
    }

    /// This long after the next frame's time, in seconds since the first one's.
    fn time_s(&self, delay_ns: u32) -> f64 {
        (self.time_ns() + u64::from(delay_ns)) as f64 * 1e-9
    }

    fn time_ns(&self) -> u64 {
        (self.frame as f64 * 1e9 / self.rate_hz) as u64
    }

    /// The next frame as a camera of 8 bits takes it.
    pub fn samples(&self, cam_from_target: &Pose<Cam, Target>, shot: &Shot) -> Vec<u8> {
        self.sampled(&self.expose(cam_from_target, shot), shot)
    }

    fn sampled(&self, picture: &Picture, shot: &Shot) -> Vec<u8> {
        let mut samples = vec![0; picture.grey.len()];
        let sensor = Sensor { noise_levels: shot.noise_levels as f32, bits: 8 };
        sensor.expose(picture, self.noise_seed, self.frame, &mut samples);
        samples
    }

    /// Measures the pixels as the next frame.
    pub fn measure<P: Measurable>(
        &mut self,
        pixels: &[P],
        white: u16,
    ) -> Result<Measurement, NoPose> {
        let (width, height) = (usize::from(WIDTH), usize::from(HEIGHT));
        let view = GreyImage::with_white_level(pixels, width, height, width, white);
        self.look_at(&view.expect("a whole frame"))
    }

    /// Measures an image as the next frame.
    pub fn look_at<P: Measurable>(
        &mut self,
        image: &GreyImage<'_, P>,
    ) -> Result<Measurement, NoPose> {
        let time_ns = self.time_ns();
        self.frame += 1;
        self.pipeline.step(image, time_ns).targets[0].measurement
    }

    /// Takes a picture and measures it: the error of the position, and the measurement.
    pub fn error_mm(
        &mut self,
        cam_from_target: &Pose<Cam, Target>,
        shot: &Shot,
    ) -> Result<(Vector3<f64>, Measurement), NoPose> {
        let picture = self.expose(cam_from_target, shot);
        let found = self.develop(&picture, shot)?;
        Ok((found.cam_from_target.translation_mm - cam_from_target.translation_mm, found))
    }

    /// The same of a target that moves while its rows are read: the error, as an increment of the
    /// pose at the time that the measurement states; that time in seconds since the first frame; and
    /// the measurement.
    pub fn moving_error(
        &mut self,
        pose_at: impl Fn(f64) -> Pose<Cam, Target>,
        shot: &Shot,
    ) -> Result<(Vector6<f64>, f64, Measurement), NoPose> {
        let picture = self.expose_rows(&pose_at, shot.psf_sigma_px);
        let frame_time_s = self.time_s(0);
        let found = self.develop(&picture, shot)?;
        let time_s = frame_time_s + f64::from(found.delay_ns) * 1e-9;
        Ok((pose_at(time_s).increment_to(&found.cam_from_target), time_s, found))
    }

    /// Adds noise, rounds, and measures.
    fn develop(&mut self, picture: &Picture, shot: &Shot) -> Result<Measurement, NoPose> {
        if shot.noise_levels > 0.0 {
            self.measure(&self.sampled(picture, shot), 255)
        } else {
            // Without noise 8 bits would round the same way over and over.
            let samples: Vec<u16> = picture.grey.iter().map(|grey| (grey * 257.0) as u16).collect();
            self.measure(&samples, 65_535)
        }
    }
}
