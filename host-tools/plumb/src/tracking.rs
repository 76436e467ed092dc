//! The box's pipeline over recorded frames.

use plumbline::config::Config;
use plumbline::image::GreyImage;
use plumbline::pipeline::Pipeline;
use plumbline::report::Report;
use plumbline_files::BadInput;
use plumbline_files::camera::{self, Camera};
use plumbline_files::frames::{Frame, FrameSource, Pixels};
use plumbline_files::scene::SceneFile;
use plumbline_files::targets::Targets;

use crate::setup::{self, Places};

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
    let &Frame { width, height, white_level, capture_time_ns, .. } = frame;
    // The source has checked the size, and gives as many samples as it says.
    const GOOD: &str = "a frame within the limits";
    match frame.pixels {
        Pixels::Grey8(samples) => {
            let image = GreyImage::with_white_level(samples, width, height, width, white_level);
            pipeline.step(&image.expect(GOOD), capture_time_ns)
        }
        Pixels::Grey16(samples) => {
            let image = GreyImage::with_white_level(samples, width, height, width, white_level);
            pipeline.step(&image.expect(GOOD), capture_time_ns)
        }
    }
}
