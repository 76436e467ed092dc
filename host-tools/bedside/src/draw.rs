//! Frames with the targets that were found drawn into them.
//!
//! Every corner is drawn where the pose puts it, not where it was detected: on
//! a good pose the rings lie on the corners. Corner 0 has a second ring; the
//! axes are x red, y green, z (into the target) blue. On a picture too small for
//! rings the outermost corners are joined instead.

use embedded_graphics::mono_font::ascii::{FONT_6X10, FONT_10X20};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::primitives::{Circle, Line, Polyline, PrimitiveStyle};
use embedded_graphics::text::{Baseline, Text};
use image::{Rgb, RgbImage};
use nalgebra::Vector3;
use plumbline::config::{Config, TargetConfig};
use plumbline::lens::Lens;
use plumbline::packet::{MeasuredPose, PosePacket};
use plumbline::pose::{Cam, Pose, Target};
use plumbline::report::{NoPose, Report, TargetState};
use plumbline_files::camera::is_stand_in;
use plumbline_files::frames::{Frame, Pixels};

/// Axes reach this many squares from the origin.
const AXIS_SQUARES: f64 = 2.0;

/// The label stands above the topmost corner, clear of a square of this size.
const LABEL_CLEAR_PX: f64 = 40.0;

/// Diameters of a corner's ring, and of the second one of corner 0.
const RINGS_PX: [u32; 2] = [7, 13];

/// The rings of corners that are closer together than this would overlap.
const RING_DISTANCE_PX_MIN: f64 = 9.0;

/// Pictures narrower than this have thin lines and small letters.
const WIDE_PX: u32 = 800;

/// Pictures narrower than this have no letters.
const LETTERS_PX: u32 = 240;

/// What is drawn of a target.
pub enum Drawn {
    /// It was found.
    Found {
        /// Its pose.
        cam_from_target: Pose<Cam, Target>,
        /// Corners used.
        corners: u8,
    },
    /// Why it was not found.
    Missing(TargetState, NoPose),
}

struct Canvas(RgbImage);

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = std::convert::Infallible;

    fn draw_iter<I>(&mut self, pixels: I) -> Result<(), Self::Error>
    where
        I: IntoIterator<Item = Pixel<Self::Color>>,
    {
        for Pixel(point, colour) in pixels {
            let (Ok(x), Ok(y)) = (u32::try_from(point.x), u32::try_from(point.y)) else {
                continue;
            };
            if let Some(pixel) = self.0.get_pixel_mut_checked(x, y) {
                *pixel = Rgb([colour.r(), colour.g(), colour.b()]);
            }
        }
        Ok(())
    }
}

/// The frame in grey, with each target of the report drawn in.
#[must_use]
pub fn annotated(frame: &Frame<'_>, config: &Config, report: &Report) -> RgbImage {
    let grey = |index: usize| match frame.pixels {
        Pixels::Grey8(samples) => u32::from(samples[index]),
        Pixels::Grey16(samples) => u32::from(samples[index]),
    };
    let white = u32::from(frame.white_level);
    let picture = RgbImage::from_fn(frame.width as u32, frame.height as u32, |x, y| {
        let sample = grey(y as usize * frame.width + x as usize);
        Rgb([(sample.min(white) * 255 / white) as u8; 3])
    });
    let drawn = report.targets.iter().map(|found| match &found.measurement {
        Ok(measured) => {
            Drawn::Found { cam_from_target: measured.cam_from_target, corners: measured.corners }
        }
        Err(reason) => Drawn::Missing(found.state, *reason),
    });
    annotate(picture, config, drawn)
}

/// What a pose packet says of each target of the configuration, in its order.
pub fn drawn(packet: &PosePacket, config: &Config) -> impl Iterator<Item = Drawn> {
    config.targets.iter().map(|target| {
        let found = packet.targets.iter().find(|found| found.role == target.geometry.role());
        match found.map(|found| (found.state, &found.pose)) {
            Some((_, Ok(pose))) => {
                Drawn::Found { cam_from_target: pose_of(pose), corners: pose.corners }
            }
            Some((state, Err(reason))) => Drawn::Missing(state, *reason),
            None => Drawn::Missing(TargetState::Acquiring, NoPose::Searching),
        }
    })
}

fn pose_of(pose: &MeasuredPose) -> Pose<Cam, Target> {
    let mut theta = [0.0; 6];
    for (theta, value) in theta.iter_mut().zip(pose.theta_rad.iter().chain(&pose.translation_mm)) {
        *theta = f64::from(*value);
    }
    Pose::from_theta(theta)
}

/// A whole frame at any size, with each target drawn into it; `drawn` is in the order of
/// the configuration's targets.
#[must_use]
pub fn annotate(
    picture: RgbImage,
    config: &Config,
    drawn: impl Iterator<Item = Drawn>,
) -> RgbImage {
    let scale = f64::from(picture.width()) / f64::from(config.lens.width_px);
    let mut canvas = Canvas(picture);
    let mut line = 0;
    for (target, drawn) in config.targets.iter().zip(drawn) {
        match drawn {
            Drawn::Found { cam_from_target, corners } => {
                canvas.target(&config.lens, scale, target, &cam_from_target, corners);
            }
            Drawn::Missing(state, reason) => {
                let text = format!("{}: {}, {}", target.name, state.word(), reason.words());
                let top = 8 + line * (canvas.font().character_size.height as i32 + 2);
                canvas.text(&text, Point::new(8, top), Rgb888::YELLOW);
                line += 1;
            }
        }
    }
    canvas.0
}

impl Canvas {
    fn target(
        &mut self,
        lens: &Lens,
        scale: f64,
        target: &TargetConfig,
        cam_from_target: &Pose<Cam, Target>,
        corners: u8,
    ) {
        let pixel = |point_mm: &Vector3<f64>| {
            let raw_px = lens.project(&cam_from_target.transform(point_mm))?;
            // Of a pixel of the picture that is the mean of some of the frame, the middle is
            // theirs.
            let [x, y] = [raw_px.x, raw_px.y].map(|px| ((px + 0.5) * scale - 0.5).round() as i32);
            Some(Point::new(x, y))
        };
        let geometry = &target.geometry;
        let [columns, count] = [geometry.columns(), geometry.corner_count()];
        let places: Vec<Option<Point>> =
            (0..count).map(|index| pixel(&geometry.corner_mm(index))).collect();
        let distance_px = places[0].zip(places[1]).map_or(0.0, |(first, second)| {
            let step = second - first;
            f64::from(step.x).hypot(f64::from(step.y))
        });
        if distance_px >= RING_DISTANCE_PX_MIN {
            for place in places.iter().flatten() {
                self.ring(*place, RINGS_PX[0], Rgb888::CSS_ORANGE);
            }
            if let Some(first) = places[0] {
                self.ring(first, RINGS_PX[1], Rgb888::CSS_ORANGE);
            }
        } else {
            let round = [0, columns - 1, count - 1, count - columns, 0];
            let round: Vec<Point> = round.iter().filter_map(|&corner| places[corner]).collect();
            let style = PrimitiveStyle::with_stroke(Rgb888::CSS_ORANGE, 1);
            let Ok(()) = Polyline::new(&round).into_styled(style).draw(self);
        }
        let square_mm = (geometry.corner_mm(1) - geometry.corner_mm(0)).norm();
        let axes = [Rgb888::RED, Rgb888::GREEN, Rgb888::CSS_DODGER_BLUE];
        for (axis, colour) in axes.into_iter().enumerate() {
            let mut end_mm = Vector3::zeros();
            end_mm[axis] = AXIS_SQUARES * square_mm;
            if let (Some(origin), Some(end)) = (pixel(&Vector3::zeros()), pixel(&end_mm)) {
                self.line(origin, end, colour);
            }
        }
        if let Some(top_left) = places.into_iter().flatten().reduce(Point::component_min) {
            // Without a calibration the depth means nothing.
            let depth = if is_stand_in(lens) {
                String::new()
            } else {
                format!(" z {:.1} mm", cam_from_target.translation_mm.z)
            };
            let text = format!("{}{depth}, {corners}/{count}", target.name);
            let clear_px = (LABEL_CLEAR_PX * scale) as i32 + 4;
            let height_px = self.font().character_size.height as i32;
            let place = top_left - Point::new(0, clear_px + height_px);
            self.text(&text, place, Rgb888::YELLOW);
        }
    }

    fn font(&self) -> MonoFont<'static> {
        if self.0.width() < WIDE_PX { FONT_6X10 } else { FONT_10X20 }
    }

    fn ring(&mut self, centre: Point, diameter: u32, colour: Rgb888) {
        let style = PrimitiveStyle::with_stroke(colour, 1);
        let Ok(()) = Circle::with_center(centre, diameter).into_styled(style).draw(self);
    }

    fn line(&mut self, start: Point, end: Point, colour: Rgb888) {
        let width = if self.0.width() < WIDE_PX { 1 } else { 2 };
        let style = PrimitiveStyle::with_stroke(colour, width);
        let Ok(()) = Line::new(start, end).into_styled(style).draw(self);
    }

    /// With a black background, to be legible on any picture.
    fn text(&mut self, text: &str, top_left: Point, colour: Rgb888) {
        if self.0.width() < LETTERS_PX {
            return;
        }
        let font = self.font();
        let mut style = MonoTextStyle::new(&font, colour);
        style.background_color = Some(Rgb888::BLACK);
        let Ok(_) = Text::with_baseline(text, top_left, style, Baseline::Top).draw(self);
    }
}
