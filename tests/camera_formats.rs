//! What a camera's format does to the measurement: the same frames, sent in grey, as a colour
//! sensor's own samples, and compressed.

use common::booth::{Booth, HEIGHT, Shot, WIDTH};
use common::coloured;
use nalgebra::Vector3;
use plumbline::pose::{Cam, Pose, Target};
use plumbline_board::source::Pixels;
use plumbline_board::source::v4l2::luma::Luma;

use crate::precision::path;

const SIZE_PX: (usize, usize) = (WIDTH as usize, HEIGHT as usize);

/// Turns a grey frame into what the camera sends.
type Encode = fn(&[u8]) -> Vec<u8>;

/// The same scene, seen by a camera with another format.
struct Seen {
    name: &'static str,
    booth: Booth,
    luma: Luma,
    encode: Encode,
    errors_mm: Vec<Vector3<f64>>,
    /// In the deviations that each pose states for itself.
    normalised: Vec<Vector3<f64>>,
}

impl Seen {
    fn new(name: &'static str, code: &[u8; 4], encode: Encode) -> Self {
        let luma = Luma::new(code, SIZE_PX, 0).expect("a format that is read");
        let booth = Booth::new(6, 5);
        Self { name, booth, luma, encode, errors_mm: Vec::new(), normalised: Vec::new() }
    }

    fn see(&mut self, grey: &[u8], truth: &Pose<Cam, Target>) {
        let sent = (self.encode)(grey);
        self.luma.load(&sent).expect("a whole frame");
        let found = match self.luma.view(&sent, &[]).expect("a whole frame") {
            Pixels::Grey8(image) => self.booth.look_at(&image),
            Pixels::Grey16(image) => self.booth.look_at(&image),
        };
        let found = found.expect("a whole target");
        let error_mm = found.cam_from_target.translation_mm - truth.translation_mm;
        self.errors_mm.push(error_mm);
        self.normalised.push(error_mm.component_div(&found.sd_mm()));
    }

    /// The mean error and its standard deviation in mm, and the latter in stated deviations.
    fn errors(&self) -> [Vector3<f64>; 3] {
        // The first frame finds the target, and the camera's blur with it.
        let (errors_mm, normalised) = (&self.errors_mm[1..], &self.normalised[1..]);
        let mean =
            |values: &[Vector3<f64>]| values.iter().sum::<Vector3<f64>>() / values.len() as f64;
        let sd = |values: &[Vector3<f64>], about: Vector3<f64>| {
            let squares: Vec<_> =
                values.iter().map(|value| (value - about).map(|part| part * part)).collect();
            mean(&squares).map(f64::sqrt)
        };
        let mean_mm = mean(errors_mm);
        [mean_mm, sd(errors_mm, mean_mm), sd(normalised, Vector3::zeros())]
    }
}

#[test]
fn a_mosaic_and_a_compressed_frame_are_measured_where_grey_is() {
    // The other two orders of a mosaic have their green where one of these has it.
    let mut grey = Seen::new("grey", b"GREY", <[u8]>::to_vec);
    let mut others = [
        // Half as many samples: at least 2^0.5 = 1.41 times the noise; and the blur of the mean.
        (Seen::new("RGGB", b"RGGB", |grey| coloured::mosaic(b"RGGB", grey, SIZE_PX.0)), 1.7),
        (Seen::new("GRBG", b"GRBG", |grey| coloured::mosaic(b"GRBG", grey, SIZE_PX.0)), 1.7),
        // Measured, with a margin for 240 frames (5 %, one standard deviation).
        (Seen::new("JPEG 95", b"MJPG", |grey| coloured::motion_jpeg(grey, SIZE_PX, 95)), 1.25),
        (Seen::new("JPEG 85", b"MJPG", |grey| coloured::motion_jpeg(grey, SIZE_PX, 85)), 1.8),
    ];
    // There and back.
    for truth in path().chain(path().collect::<Vec<_>>().into_iter().rev()) {
        let frame = grey.booth.samples(&truth, &Shot::STANDARD);
        grey.see(&frame, &truth);
        for (seen, _) in &mut others {
            seen.see(&frame, &truth);
        }
    }
    let [_, grey_sd_mm, grey_normalised] = grey.errors();
    println!("grey: SD {grey_sd_mm:.4?} mm, stated {grey_normalised:.2?}");
    // What 240 frames tell, to three standard deviations.
    assert!(grey_normalised.add_scalar(-1.0).abs().max() < 0.14, "grey: {grey_normalised}");
    for (seen, ratio_max) in &others {
        let [mean_mm, sd_mm, normalised] = seen.errors();
        let (name, ratio) = (seen.name, sd_mm.z / grey_sd_mm.z);
        println!("{name}: mean {mean_mm:.4?} mm, SD {sd_mm:.4?} mm, stated {normalised:.2?}");
        println!("{name}: {ratio:.2} times the depth's SD of grey");
        assert!(ratio < *ratio_max, "{name}: {ratio}");
        // Four standard deviations of the mean of 240 frames, where one frame's is 0.04 mm in depth
        // and 0.001 mm to the side.
        assert!(mean_mm.z.abs() < 0.01, "{name}: {mean_mm}");
        assert!(mean_mm.xy().abs().max() < 0.0003, "{name}: {mean_mm}");
        // The poses know how uncertain they are.
        assert!(normalised.min() > 0.8 && normalised.max() < 1.25, "{name}: {normalised}");
        // The same frames in grey have the same noise. What is left is the format: compression makes
        // the stated deviations too large. Its errors extend along an edge, so that they do not average
        // out over the lines from whose means the noise is estimated; but across the edge they are finer
        // than its profile, and only two thirds of their variance displace it.
        let cautious = normalised.component_div(&grey_normalised).min();
        assert!(cautious > 0.8, "{name}: {normalised}, of grey {grey_normalised}");
    }
}
