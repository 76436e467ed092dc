//! What a camera's format does to the measurement: the same frames, sent in grey, as a colour
//! sensor's own samples, and compressed.

use common::booth::{Booth, HEIGHT, Shot, WIDTH};
use common::coloured;
use nalgebra::Vector3;
use plumbline_board::source::Pixels;
use plumbline_board::source::v4l2::luma::Luma;

use crate::precision::path;

/// Errors along a path, in mm.
struct Errors {
    mean: Vector3<f64>,
    /// One standard deviation.
    sd: Vector3<f64>,
    /// The same in the deviations that each pose states for itself.
    normalised_sd: Vector3<f64>,
}

fn errors(code: &[u8; 4], encode: impl Fn(&[u8], (usize, usize)) -> Vec<u8>) -> Errors {
    let size_px = (WIDTH.into(), HEIGHT.into());
    let mut booth = Booth::new(6, 5);
    let mut luma = Luma::new(code, size_px, 0).expect("a format that is read");
    let (mut errors_mm, mut normalised) = (Vec::new(), Vec::new());
    // There and back, so that every frame but the first has one before it.
    for truth in path().chain(path().collect::<Vec<_>>().into_iter().rev()) {
        let sent = encode(&booth.samples(&truth, &Shot::STANDARD), size_px);
        luma.load(&sent).expect("a whole frame");
        let found = match luma.view(&sent, &[]).expect("a whole frame") {
            Pixels::Grey8(image) => booth.look_at(&image),
            Pixels::Grey16(image) => booth.look_at(&image),
        };
        let found = found.expect("a whole target");
        let error_mm = found.cam_from_target.translation_mm - truth.translation_mm;
        errors_mm.push(error_mm);
        normalised.push(error_mm.component_div(&found.sd_mm()));
    }
    // The first frame finds the target, and the camera's blur with it.
    let (errors_mm, normalised) = (&errors_mm[1..], &normalised[1..]);
    let count = errors_mm.len() as f64;
    let mean = errors_mm.iter().sum::<Vector3<f64>>() / count;
    let root = |squares: Vector3<f64>| (squares / count).map(f64::sqrt);
    Errors {
        mean,
        sd: root(errors_mm.iter().map(|error| (error - mean).map(|mm| mm * mm)).sum()),
        normalised_sd: root(normalised.iter().map(|error| error.map(|sd| sd * sd)).sum()),
    }
}

#[test]
fn a_mosaic_and_a_compressed_frame_are_measured_where_grey_is() {
    let grey = errors(b"GREY", |grey, _| grey.to_vec());
    println!("GREY: {:.4?} {:.4?} {:.3?}", grey.mean, grey.sd, grey.normalised_sd);
    for code in [b"RGGB", b"GRBG", b"GBRG", b"BA81"] {
        let e = errors(code, |grey, (width, _)| coloured::mosaic(code, grey, width));
        println!("{}: {:.4?} {:.4?} {:.3?}", code.escape_ascii(), e.mean, e.sd, e.normalised_sd);
    }
    for quality in [95, 85, 70, 50] {
        let e = errors(b"MJPG", |grey, size_px| coloured::motion_jpeg(grey, size_px, quality));
        println!("MJPG {quality}: {:.4?} {:.4?} {:.3?}", e.mean, e.sd, e.normalised_sd);
    }
}
