//! The box's pipeline over recorded frames.
//!
//! The core and the calibration are generic over the pixel, so that they are compiled in the crate that
//! says which. That is this one, which dev builds optimise, unlike the programs that use it.

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

/// Tracks the targets of a configuration through frames.
pub struct Tracker {
    pipeline: Box<Pipeline>,
    /// For photographs that do not follow each other.
    alone: Option<Alone>,
}

/// What finds the targets in a photograph that stands for itself: at all sizes.
struct Alone {
    search: Search,
    wanted: Vec<GridShape>,
}

impl Tracker {
    /// For frames that follow each other, or for `independent` ones.
    ///
    /// # Errors
    /// As [`setup::configured`].
    pub fn new(config: &Config, independent: bool, places: &Places) -> Result<Self, BadInput> {
        let alone = independent.then(|| Alone {
            search: Search::new(),
            wanted: config.targets.iter().map(|target| target.geometry.shape()).collect(),
        });
        Ok(Self { pipeline: setup::configured(config, places)?, alone })
    }

    /// For the frames of a source; with the configuration of these files.
    ///
    /// # Errors
    /// As [`setup::config`], and when the frames are not of the camera's size.
    pub fn of_source(
        source: &FrameSource,
        independent: bool,
        (camera, targets, scene): (&Camera, &Targets, Option<&SceneFile>),
        places: &Places,
    ) -> Result<(Config, Self), BadInput> {
        let size = [source.width(), source.height()];
        camera::check_frame_size(&camera.lens, &places.camera, size[0], size[1], source.place())?;
        let config = setup::config(camera, targets, scene, places)?;
        let tracker = Self::new(&config, independent, places)?;
        Ok((config, tracker))
    }

    /// The next frame of a file.
    pub fn step(&mut self, frame: &Frame<'_>) -> Report {
        self.step_image(&Image::of(frame), frame.capture_time_ns)
    }

    /// The next frame.
    pub fn step_image(&mut self, image: &Image<'_>, capture_time_ns: u64) -> Report {
        let Self { pipeline, alone } = self;
        match (image, alone) {
            (Image::Grey8(image), None) => pipeline.step(image, capture_time_ns),
            (Image::Grey16(image), None) => pipeline.step(image, capture_time_ns),
            (Image::Grey8(image), Some(Alone { search, wanted })) => {
                search.measure(pipeline, image, wanted, capture_time_ns)
            }
            (Image::Grey16(image), Some(Alone { search, wanted })) => {
                search.measure(pipeline, image, wanted, capture_time_ns)
            }
        }
    }

    /// Forgets where the targets are: the next frame is searched afresh.
    pub fn forget(&mut self) {
        self.pipeline.forget();
    }
}

/// A grey picture of either depth.
pub enum Image<'a> {
    /// 8 bits.
    Grey8(GreyImage<'a, u8>),
    /// Up to 16 bits.
    Grey16(GreyImage<'a, u16>),
}

impl<'a> Image<'a> {
    fn of(frame: &Frame<'a>) -> Self {
        let &Frame { width, height, white_level, .. } = frame;
        // The source has checked the size, and gives as many samples as it says.
        const GOOD: &str = "a frame within the limits";
        match frame.pixels {
            Pixels::Grey8(samples) => {
                GreyImage::with_white_level(samples, width, height, width, white_level)
                    .expect(GOOD)
                    .into()
            }
            Pixels::Grey16(samples) => {
                GreyImage::with_white_level(samples, width, height, width, white_level)
                    .expect(GOOD)
                    .into()
            }
        }
    }
}

impl<'a> From<GreyImage<'a, u8>> for Image<'a> {
    fn from(image: GreyImage<'a, u8>) -> Self {
        Self::Grey8(image)
    }
}

impl<'a> From<GreyImage<'a, u16>> for Image<'a> {
    fn from(image: GreyImage<'a, u16>) -> Self {
        Self::Grey16(image)
    }
}

/// A frame as a small picture.
pub fn reduced(frame: &Frame<'_>, reduction: u8) -> Picture {
    match Image::of(frame) {
        Image::Grey8(image) => Picture::reduced(&image, reduction.into()),
        Image::Grey16(image) => Picture::reduced(&image, reduction.into()),
    }
}
