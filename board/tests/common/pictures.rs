//! Reads the files of pictures, all of which are grey.

use std::io::Cursor;

use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// The samples of a PNG and its width and height; those of 16 bits are big-endian.
pub fn of_png(file: &[u8]) -> (Vec<u8>, [usize; 2]) {
    let mut reader = png::Decoder::new(Cursor::new(file)).read_info().unwrap();
    let mut samples = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut samples).unwrap();
    assert_eq!(info.color_type, png::ColorType::Grayscale);
    (samples, [info.width, info.height].map(|side| side as usize))
}

/// The samples of a JPEG and its width and height.
pub fn of_jpeg(file: &[u8]) -> (Vec<u8>, [usize; 2]) {
    let grey = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(file), grey);
    let samples = decoder.decode().unwrap();
    assert_eq!(decoder.input_colorspace(), Some(ColorSpace::Luma));
    let (width, height) = decoder.dimensions().unwrap();
    (samples, [width, height])
}
