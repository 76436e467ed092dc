//! Frames with what was found drawn in, for the eye to judge.
//!
//! Every corner is drawn where the pose puts it, not where it was detected: on
//! a good pose the rings lie on the corners. Corner 0 has a second ring; the
//! axes are x red, y green, z (into the target) blue.

use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_10X20;
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::primitives::{Circle, Line, PrimitiveStyle};
use embedded_graphics::text::{Baseline, Text};
use image::{Rgb, RgbImage};
use nalgebra::Vector3;
use plumbline::config::{Config, TargetConfig};
use plumbline::lens::Lens;
use plumbline::measure::Measurement;
use plumbline::report::Report;

use crate::files::frames::{Frame, Pixels};

/// Axes reach this many squares from the origin.
const AXIS_SQUARES: f64 = 2.0;

/// The label stands this far above the topmost corner, clear of a square of 40 px.
const LABEL_HEIGHT_PX: i32 = 64;

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
    let mut canvas = Canvas(RgbImage::from_fn(frame.width as u32, frame.height as u32, |x, y| {
        let sample = grey(y as usize * frame.width + x as usize);
        Rgb([(sample.min(white) * 255 / white) as u8; 3])
    }));
    let mut line = 0;
    for (target, found) in config.targets.iter().zip(&report.targets) {
        match &found.measurement {
            Ok(measured) => canvas.target(&config.lens, target, measured),
            Err(reason) => {
                let text = format!("{}: {}, {}", target.name, found.state.word(), reason.words());
                canvas.text(&text, Point::new(8, 8 + 22 * line), Rgb888::YELLOW);
                line += 1;
            }
        }
    }
    canvas.0
}

impl Canvas {
    fn target(&mut self, lens: &Lens, target: &TargetConfig, measured: &Measurement) {
        let pixel = |point_mm: &Vector3<f64>| {
            let raw_px = lens.project(&measured.cam_from_target.transform(point_mm))?;
            Some(Point::new(raw_px.x.round() as i32, raw_px.y.round() as i32))
        };
        let geometry = &target.geometry;
        let mut top_left: Option<Point> = None;
        for index in 0..geometry.corner_count() {
            let Some(corner) = pixel(&geometry.corner_mm(index)) else { continue };
            self.ring(corner, 7, Rgb888::CSS_ORANGE);
            if index == 0 {
                self.ring(corner, 13, Rgb888::CSS_ORANGE);
            }
            top_left = Some(top_left.map_or(corner, |point| point.component_min(corner)));
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
        if let Some(top_left) = top_left {
            let text = format!(
                "{} z {:.1} mm, {}/{}",
                target.name,
                measured.cam_from_target.translation_mm.z,
                measured.corners,
                measured.corners_total
            );
            self.text(&text, top_left - Point::new(0, LABEL_HEIGHT_PX), Rgb888::YELLOW);
        }
    }

    fn ring(&mut self, centre: Point, diameter: u32, colour: Rgb888) {
        let style = PrimitiveStyle::with_stroke(colour, 1);
        let Ok(()) = Circle::with_center(centre, diameter).into_styled(style).draw(self);
    }

    fn line(&mut self, start: Point, end: Point, colour: Rgb888) {
        let style = PrimitiveStyle::with_stroke(colour, 2);
        let Ok(()) = Line::new(start, end).into_styled(style).draw(self);
    }

    /// With a black background, to be legible on any picture.
    fn text(&mut self, text: &str, top_left: Point, colour: Rgb888) {
        let mut style = MonoTextStyle::new(&FONT_10X20, colour);
        style.background_color = Some(Rgb888::BLACK);
        let Ok(_) = Text::with_baseline(text, top_left, style, Baseline::Top).draw(self);
    }
}
