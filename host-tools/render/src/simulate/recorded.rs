//! A simulation as files: the frames with 8 or 10 bits, or 8 bits after JPEG compression, and the
//! rows of the true poses.

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat, ImageResult};

use plumbline::target::Role;
use plumbline_files::poses::PoseRow;

use super::Simulation;

/// How samples are stored in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// 8 bits, unchanged.
    Grey8,
    /// 10 bits, unchanged.
    Grey10,
    /// 8 bits, encoded as JPEG of this quality (1 to 100) and decoded again, like the frames of
    /// most USB cameras.
    Jpeg(u8),
}

impl Form {
    /// Bits per sample.
    #[must_use]
    pub fn bits(self) -> u8 {
        match self {
            Self::Grey8 | Self::Jpeg(_) => 8,
            Self::Grey10 => 10,
        }
    }

    /// The Y4M colour space. The crate `y4m` has none with 10 bits and no colour.
    pub fn colorspace(self) -> y4m::Colorspace {
        match self {
            Self::Grey8 | Self::Jpeg(_) => y4m::Colorspace::Cmono,
            Self::Grey10 => y4m::Colorspace::C420p10,
        }
    }

    /// Each of the two chroma planes of every frame, as bytes of the file: no colour.
    pub fn chroma(self, width: usize, height: usize) -> Vec<u8> {
        match self {
            Self::Grey8 | Self::Jpeg(_) => Vec::new(),
            Self::Grey10 => 512_u16.to_le_bytes().repeat(width.div_ceil(2) * height.div_ceil(2)),
        }
    }

    /// The luma plane of a frame, as bytes of the file; `luma` is overwritten.
    pub fn render(
        self,
        simulation: &Simulation,
        frame: u64,
        luma: &mut Vec<u8>,
    ) -> ImageResult<()> {
        match self {
            Self::Grey8 => simulation.render(frame, luma),
            Self::Grey10 => {
                let mut samples = Vec::<u16>::new();
                simulation.render(frame, &mut samples);
                luma.clear();
                luma.extend(samples.into_iter().flat_map(u16::to_le_bytes));
            }
            Self::Jpeg(quality) => {
                simulation.render(frame, luma);
                let lens = simulation.camera();
                *luma = through_jpeg(luma, lens.width_px.into(), lens.height_px.into(), quality)?;
            }
        }
        Ok(())
    }
}

/// The number of frames per second as the fraction that Y4M stores, to a thousandth.
#[must_use]
pub fn frame_rate(frame_rate_hz: f64) -> y4m::Ratio {
    let thousandths = (frame_rate_hz * 1000.0).round() as usize;
    if thousandths.is_multiple_of(1000) {
        y4m::Ratio::new(thousandths / 1000, 1)
    } else {
        y4m::Ratio::new(thousandths, 1000)
    }
}

/// The rows of truth.csv for one frame: the columns of poses.csv. `time_s` is when the row of the
/// target's centre was exposed, and `points` is the number of corners in view.
#[must_use]
pub fn truth_rows(simulation: &Simulation, frame: u64) -> Vec<PoseRow> {
    let truth = simulation.truth(frame);
    simulation
        .targets()
        .iter()
        .zip(&truth.targets)
        .map(|(target, known)| {
            let row = PoseRow::without_pose(frame, known.time_s, target.layout.name, "truth")
                .with_pose(&known.cam_from_target);
            let points = u32::try_from(known.visible_corners).ok();
            let row = PoseRow { points, ..row };
            match target.layout.role {
                Role::Upper | Role::Lower => row.with_trunk(&known.trunk_point),
                Role::Scene => row,
            }
        })
        .collect()
}

fn through_jpeg(samples: &[u8], width: u32, height: u32, quality: u8) -> ImageResult<Vec<u8>> {
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, quality).encode(
        samples,
        width,
        height,
        ExtendedColorType::L8,
    )?;
    Ok(image::load_from_memory_with_format(&file, ImageFormat::Jpeg)?.into_luma8().into_raw())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jpeg_changes_a_smooth_picture_by_what_its_quality_allows() {
        let samples: Vec<u8> =
            (0..64 * 48).map(|index| (index % 64 * 2 + index / 64) as u8).collect();
        let error_max = |quality| {
            let decoded = through_jpeg(&samples, 64, 48, quality).unwrap();
            assert_eq!(decoded.len(), samples.len());
            samples.iter().zip(&decoded).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
        };
        // The finest step of the usual quantisation table is 1 level at quality 95, 55 at 10.
        let (fine, coarse) = (error_max(95), error_max(10));
        assert!(fine <= 2 && coarse > fine, "{fine} {coarse}");
    }
}
