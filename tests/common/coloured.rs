//! A grey scene as a colour camera sends it. Paper under a warm lamp, without white balance: red and
//! blue are fainter than green, which is as bright as the grey was.

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

fn colours(grey: u8) -> [u8; 3] {
    let grey = u32::from(grey);
    [grey * 9 / 10, grey, grey * 6 / 10].map(|level| level as u8)
}

/// Blue, green and red of each pixel.
pub fn bgr(grey: &[u8]) -> Vec<u8> {
    let pixel = |&grey: &u8| {
        let [red, green, blue] = colours(grey);
        [blue, green, red]
    };
    grey.iter().flat_map(pixel).collect()
}

/// The samples of a sensor with one colour per pixel. `code` is the kernel's: it names the colours of
/// the first row and the second, except `BA81`, which is BGGR.
///
/// # Panics
/// When it is another.
pub fn mosaic(code: &[u8; 4], grey: &[u8], width: usize) -> Vec<u8> {
    let colours_of = if code == b"BA81" { b"BGGR" } else { code };
    let sample = |(place, &grey): (usize, &u8)| {
        let [red, green, blue] = colours(grey);
        match colours_of[2 * (place / width % 2) + place % width % 2] {
            b'R' => red,
            b'G' => green,
            b'B' => blue,
            other => panic!("{} is no colour", other.escape_ascii()),
        }
    };
    grey.iter().enumerate().map(sample).collect()
}

/// Compressed as most USB cameras do it: half as many colours along the rows.
///
/// # Panics
/// When the size is not that of the pixels.
pub fn motion_jpeg(grey: &[u8], (width, height): (usize, usize), quality: u8) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, quality);
    encoder.set_sampling_factor(SamplingFactor::R_4_2_2);
    encoder
        .encode(&bgr(grey), width as u16, height as u16, ColorType::Bgr)
        .expect("a frame of this size");
    file
}
