//! Pictures as PNG files.

use std::io::Cursor;
use std::ops::Deref;
use std::path::Path;

use image::{ImageBuffer, ImageFormat, Pixel, PixelWithColorType};
use plumbline_files::BadInput;

/// Writes a picture of 8 bits per sample, in place of one that exists.
///
/// # Errors
/// When the operating system refuses.
pub fn write<P, Samples>(path: &Path, picture: &ImageBuffer<P, Samples>) -> Result<(), BadInput>
where
    P: Pixel<Subpixel = u8> + PixelWithColorType,
    Samples: Deref<Target = [u8]>,
{
    let mut file = Cursor::new(Vec::new());
    picture.write_to(&mut file, ImageFormat::Png).map_err(|error| {
        BadInput::whole(path.display(), error, "make a picture of another size")
    })?;
    plumbline_files::replace(path, file.get_ref())
}
