//! The box's pipeline over recorded frames.

use plumbline::config::Config;
use plumbline::image::GreyImage;
use plumbline::pipeline::Pipeline;
use plumbline::report::Report;
use plumbline::target::GridShape;
use plumbline_bedside::setup::{self, Places};
use plumbline_calibration::Search;
use plumbline_calibration::background::Picture;
use plumbline_files::BadInput;
use plumbline_files::camera::{self, Camera};
use plumbline_files::frames::{Frame, FrameSource, Pixels};
use plumbline_files::scene::SceneFile;
use plumbline_files::targets::Targets;

/// The configuration of these files, and a pipeline that has it, for the frames of a source.
///
/// # Errors
/// As [`setup::config`], and when the frames are not of the camera's size.
pub fn pipeline(
    camera: &Camera,
    targets: &Targets,
    scene: Option<&SceneFile>,
    source: &FrameSource,
    places: &Places,
) -> Result<(Config, Box<Pipeline>), BadInput> {
    camera::check_frame_size(
        &camera.lens,
        &places.camera,
        source.width(),
        source.height(),
        source.place(),
    )?;
    let config = setup::config(camera, targets, scene, places)?;
    let pipeline = setup::configured(&config, places)?;
    Ok((config, pipeline))
}

/// One frame of a source through the pipeline.
pub fn step(pipeline: &mut Pipeline, frame: &Frame<'_>) -> Report {
    let time_ns = frame.capture_time_ns;
    match view(frame) {
        View::Grey8(image) => pipeline.step(&image, time_ns),
        View::Grey16(image) => pipeline.step(&image, time_ns),
    }
}

/// A photograph, which stands for itself, searched at all sizes and measured by the pipeline.
pub fn step_alone(
    pipeline: &mut Pipeline,
    search: &mut Search,
    wanted: &[GridShape],
    frame: &Frame<'_>,
) -> Report {
    let time_ns = frame.capture_time_ns;
    match view(frame) {
        View::Grey8(image) => search.measure(pipeline, &image, wanted, time_ns),
        View::Grey16(image) => search.measure(pipeline, &image, wanted, time_ns),
    }
}

/// A frame as a small picture.
pub fn reduced(frame: &Frame<'_>, reduction: u8) -> Picture {
    match view(frame) {
        View::Grey8(image) => Picture::reduced(&image, reduction.into()),
        View::Grey16(image) => Picture::reduced(&image, reduction.into()),
    }
}

enum View<'a> {
    Grey8(GreyImage<'a, u8>),
    Grey16(GreyImage<'a, u16>),
}

fn view<'a>(frame: &Frame<'a>) -> View<'a> {
    let &Frame { width, height, white_level, .. } = frame;
    // The source has checked the size, and gives as many samples as it says.
    const GOOD: &str = "a frame within the limits";
    match frame.pixels {
        Pixels::Grey8(samples) => View::Grey8(
            GreyImage::with_white_level(samples, width, height, width, white_level).expect(GOOD),
        ),
        Pixels::Grey16(samples) => View::Grey16(
            GreyImage::with_white_level(samples, width, height, width, white_level).expect(GOOD),
        ),
    }
}
