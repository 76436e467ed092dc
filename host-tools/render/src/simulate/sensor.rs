//! What the sensor adds: photon noise, read noise, quantisation, clipping.

use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::render::Picture;

/// The grey (of 255) at which the total noise has the given value: midway between the prints' black
/// and white.
const MID_GREY: f32 = 120.0;

/// Share of the read noise in the variance at [`MID_GREY`]; photon noise makes up the rest. A small
/// machine-vision sensor in room light is limited by photon noise.
const READ_VARIANCE_SHARE: f32 = 0.25;

/// A sample as delivered by a sensor.
pub trait Sample: Copy + Default + Send {
    /// The whole number nearest to a level that is not negative and fits the type.
    fn rounded(level: f32) -> Self;

    /// As [`Sensor::expose`]. Not generic once it is implemented, so that it is compiled with this crate
    /// and not with each that calls it, less optimised.
    fn expose(sensor: &Sensor, picture: &Picture, seed: u64, frame: u64, samples: &mut [Self]);
}

macro_rules! sample {
    ($($sample:ty),+) => {$(
        impl Sample for $sample {
            fn rounded(level: f32) -> Self {
                (level + 0.5) as Self
            }

            fn expose(
                sensor: &Sensor,
                picture: &Picture,
                seed: u64,
                frame: u64,
                samples: &mut [Self],
            ) {
                sensor.sample(picture, seed, frame, samples);
            }
        }
    )+};
}

sample!(u8, u16);

/// A sensor's noise and resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Total noise at [`MID_GREY`], standard deviation in levels of 255.
    pub noise_levels: f32,
    /// Bits per sample.
    pub bits: u8,
}

impl Sensor {
    /// The samples of a picture: scaled from levels of 255 to the sensor's bits, with noise added,
    /// rounded and clipped. The noise depends only on the seed, the frame and the row, so the
    /// number of threads does not matter.
    ///
    /// # Panics
    /// When `samples` is not as long as the picture, which is a caller's bug.
    pub fn expose<S: Sample>(&self, picture: &Picture, seed: u64, frame: u64, samples: &mut [S]) {
        S::expose(self, picture, seed, frame, samples);
    }

    fn sample<S: Sample>(&self, picture: &Picture, seed: u64, frame: u64, samples: &mut [S]) {
        assert_eq!(samples.len(), picture.grey.len());
        let variance = self.noise_levels * self.noise_levels;
        let read_variance = variance * READ_VARIANCE_SHARE;
        let photon_variance_per_level = variance * (1.0 - READ_VARIANCE_SHARE) / MID_GREY;
        let white = ((1_u32 << self.bits) - 1) as f32;
        let scale = white / 255.0;
        let rows = picture.grey.par_chunks(picture.width);
        rows.zip(samples.par_chunks_mut(picture.width)).enumerate().for_each(
            |(row, (greys, samples))| {
                let mut random = noise_of_row(seed, frame, row as u64);
                for (grey, sample) in greys.iter().zip(samples) {
                    let noise: f32 = StandardNormal.sample(&mut random);
                    let sd = (read_variance + photon_variance_per_level * grey.max(0.0)).sqrt();
                    let level = (grey + sd * noise) * scale;
                    *sample = S::rounded(level.clamp(0.0, white));
                }
            },
        );
    }
}

/// The random generator for the noise of one row.
fn noise_of_row(seed: u64, frame: u64, row: u64) -> Xoshiro256PlusPlus {
    // Neighbouring seeds, frames and rows must not share a state: the three are spread over the
    // seed's bytes, which are then mixed together.
    let mut bytes = [0; 32];
    for (bytes, value) in bytes.chunks_exact_mut(8).zip([seed, frame, row]) {
        bytes.copy_from_slice(&value.to_le_bytes());
    }
    let mut mixer = ChaCha8Rng::from_seed(bytes);
    Xoshiro256PlusPlus::from_rng(&mut mixer)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(samples: &[u8]) -> (f64, f64) {
        let count = samples.len() as f64;
        let mean = samples.iter().map(|sample| f64::from(*sample)).sum::<f64>() / count;
        let squares = samples.iter().map(|sample| (f64::from(*sample) - mean).powi(2)).sum::<f64>();
        (mean, (squares / count).sqrt())
    }

    #[test]
    fn noise_is_the_given_one_at_mid_grey_and_grows_with_light() {
        let sensor = Sensor { noise_levels: 2.0, bits: 8 };
        let measured = |grey: f32| {
            let picture = Picture::uniform(400, 400, grey);
            let mut samples = vec![0_u8; 160_000];
            sensor.expose(&picture, 1, 0, &mut samples);
            moments(&samples)
        };
        // Rounding adds 1/12 to the variance; 160,000 samples give the SD to 0.2 %.
        let (mean, sd) = measured(120.0);
        assert!((mean - 120.0).abs() < 0.02 && (sd - (4.0_f64 + 1.0 / 12.0).sqrt()).abs() < 0.015);
        let (_, sd) = measured(0.4 + 12.0);
        assert!((sd - (1.0_f64 + 3.0 * 12.4 / 120.0 + 1.0 / 12.0).sqrt()).abs() < 0.015, "{sd}");
    }

    #[test]
    fn frames_differ_and_come_back_and_bits_scale() {
        let picture = Picture::uniform(64, 64, 100.0);
        let sensor = Sensor { noise_levels: 2.0, bits: 8 };
        let exposed = |frame| {
            let mut samples = vec![0_u8; 4096];
            sensor.expose(&picture, 7, frame, &mut samples);
            samples
        };
        assert_eq!(exposed(3), exposed(3));
        assert_ne!(exposed(3), exposed(4));
        let rows = exposed(3);
        assert_ne!(rows[..64], rows[64..128]);

        let quiet = Sensor { noise_levels: 0.0, bits: 10 };
        let mut samples = vec![0_u16; 4096];
        quiet.expose(&picture, 7, 0, &mut samples);
        assert!(samples.iter().all(|sample| *sample == 401));
        quiet.expose(&Picture::uniform(64, 64, 300.0), 7, 0, &mut samples);
        assert!(samples.iter().all(|sample| *sample == 1023));
    }
}
