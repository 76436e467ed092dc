//! Single images: PNG, JPEG, and the PNM family.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader};

use super::{Samples, check_size};
use crate::BadInput;

/// One image, decoded.
pub(super) struct Picture {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) white_level: u16,
    pub(super) samples: Samples,
}

impl Picture {
    /// Reads a file whose content, not name, says what it is.
    pub(super) fn read(path: &Path, place: &str) -> Result<Self, BadInput> {
        let file = File::open(path).map_err(|error| BadInput::io(place, &error))?;
        let reader = ImageReader::new(BufReader::new(file))
            .with_guessed_format()
            .map_err(|error| BadInput::io(place, &error))?;
        if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::Pnm))
        {
            return Err(BadInput::whole(
                place,
                "neither an image (PNG, JPEG, PGM) nor a Y4M video",
                "convert it, for example: ffmpeg -i RECORDING -pix_fmt gray out.y4m",
            ));
        }
        let decoder = reader.into_decoder().map_err(|error| damaged(&error, place))?;
        let (width, height) = decoder.dimensions();
        let (width, height) = (width as usize, height as usize);
        check_size(place, "width and height", width, height)?;
        let wide = matches!(
            decoder.color_type(),
            ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16
        );
        let picture =
            DynamicImage::from_decoder(decoder).map_err(|error| damaged(&error, place))?;
        let (samples, white_level) = if wide {
            (Samples::Grey16(picture.into_luma16().into_raw()), u16::MAX)
        } else {
            (Samples::Grey8(picture.into_luma8().into_raw()), 255)
        };
        Ok(Self { width, height, white_level, samples })
    }
}

fn damaged(error: &ImageError, place: &str) -> BadInput {
    let message = error.to_string().replace('\n', " ");
    BadInput::whole(
        place,
        format!("cannot be decoded ({message})"),
        "the file is damaged or of an unusual kind: copy it again, or convert it to an 8-bit PNG",
    )
}
