//! What a camera with a lens sees, how sharply, and in how much light: the thin lens.
//!
//! An estimate for choosing: a real lens is a few percent off its nominal focal length, and
//! `plumb calibrate` measures it.

/// A camera, its lens and its distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Optics {
    /// Columns and rows of the sensor.
    pub size_px: [u16; 2],
    /// The side of a pixel.
    pub pixel_um: f64,
    /// The lens's focal length.
    pub focal_mm: f64,
    /// Focal length over the diameter of the aperture.
    pub f_number: f64,
    /// From the camera to the back.
    pub distance_mm: f64,
    /// The time for which a frame is exposed.
    pub exposure_ms: f64,
}

/// The grey midway between the prints' black and white, of 255: where noise is stated.
const MID_GREY: f64 = 120.0;

/// A print's white, of 255, in a picture that is exposed well.
const WHITE_GREY: f64 = 220.0;

/// The share of the light that matt white paper reflects, and that a lens lets through.
const REFLECTANCE: f64 = 0.85;
const TRANSMITTANCE: f64 = 0.9;

/// Photons a second and square metre in a lux of white light: 300 lm/W, as white LEDs have, and
/// 2.8e18 photons a joule, in the middle of the visible spectrum.
const PHOTONS_PER_LUX: f64 = 2.8e18 / 300.0;

/// Electrons per photon, over the visible spectrum, of a sensor for machine vision.
const QUANTUM_EFFICIENCY: f64 = 0.5;

impl Optics {
    /// The focal length in pixels.
    #[must_use]
    pub fn focal_px(&self) -> f64 {
        self.focal_mm / (1e-3 * self.pixel_um)
    }

    /// Width and height of what is seen at the distance, mm.
    #[must_use]
    pub fn field_mm(&self) -> [f64; 2] {
        self.size_px.map(|side| f64::from(side) / self.focal_px() * self.distance_mm)
    }

    /// How many pixels a length at the distance takes, frontal.
    #[must_use]
    pub fn px_of(&self, length_mm: f64) -> f64 {
        self.focal_px() * length_mm / self.distance_mm
    }

    /// From where to where a point is blurred by a disc of at most a pixel's width, with the lens
    /// focused at the distance, mm; without end beyond the hyperfocal distance. A disc as wide as a
    /// pixel has a standard deviation of a quarter of it, small beside a good lens's own blur.
    #[must_use]
    pub fn sharp_mm(&self) -> [f64; 2] {
        let Self { focal_mm, f_number, distance_mm, pixel_um, .. } = *self;
        let hyperfocal_mm = focal_mm * focal_mm / (f_number * 1e-3 * pixel_um) + focal_mm;
        let near = hyperfocal_mm + distance_mm - 2.0 * focal_mm;
        let far = hyperfocal_mm - distance_mm;
        let nearest = distance_mm * (hyperfocal_mm - focal_mm) / near;
        let farthest =
            if far > 0.0 { distance_mm * (hyperfocal_mm - focal_mm) / far } else { f64::INFINITY };
        [nearest, farthest]
    }

    /// How far a point that moves across the view at this speed is smeared during the exposure,
    /// pixels.
    #[must_use]
    pub fn smear_px(&self, speed_mm_s: f64) -> f64 {
        self.px_of(1e-3 * self.exposure_ms * speed_mm_s)
    }

    /// The illuminance on the prints at which the noise of photons at mid grey has this standard
    /// deviation, in levels of 255, lux: there `(MID_GREY / noise)^2` electrons are collected.
    #[must_use]
    pub fn lux_for(&self, noise_levels: f64) -> f64 {
        let wanted_at_white = (MID_GREY / noise_levels).powi(2) * WHITE_GREY / MID_GREY;
        let pixel_m2 = (1e-6 * self.pixel_um).powi(2);
        let per_sensor_lux =
            PHOTONS_PER_LUX * QUANTUM_EFFICIENCY * pixel_m2 * 1e-3 * self.exposure_ms;
        let sensor_lux_per_lux = REFLECTANCE * TRANSMITTANCE / (4.0 * self.f_number.powi(2));
        wanted_at_white / (per_sensor_lux * sensor_lux_per_lux)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The standard scene's camera.
    const STANDARD: Optics = Optics {
        size_px: [1456, 1088],
        pixel_um: 3.45,
        focal_mm: 6.0,
        f_number: 2.8,
        distance_mm: 1000.0,
        exposure_ms: 4.0,
    };

    #[test]
    fn what_is_seen_is_as_large_as_in_the_standard_scene() {
        assert!((STANDARD.focal_px() - 1739.13).abs() < 0.01);
        let [width, height] = STANDARD.field_mm();
        // 1456 and 1088 px of 1 / 1.73913 mm.
        assert!((width - 837.2).abs() < 0.1 && (height - 625.6).abs() < 0.1, "{width} {height}");
        assert!((STANDARD.px_of(12.0) - 20.87).abs() < 0.01);
        assert!((STANDARD.smear_px(100.0) - 0.696).abs() < 0.001);
    }

    #[test]
    fn the_blur_at_both_ends_of_what_is_sharp_is_a_pixel() {
        for distance_mm in [400.0, 1000.0, 2500.0] {
            let optics = Optics { distance_mm, ..STANDARD };
            // The image of a point lies at f z / (z - f) behind the lens; the sensor where that of
            // the distance does. The cone of rays, f / N wide at the lens, is cut there.
            let image = |z_mm: f64| optics.focal_mm * z_mm / (z_mm - optics.focal_mm);
            for z_mm in optics.sharp_mm() {
                let defocus = (image(z_mm) - image(distance_mm)).abs() / image(z_mm);
                let disc_um = 1e3 * optics.focal_mm / optics.f_number * defocus;
                assert!((disc_um - 3.45).abs() < 1e-9, "{distance_mm}: {z_mm} {disc_um}");
            }
        }
        let far = Optics { distance_mm: 4000.0, ..STANDARD };
        assert_eq!(far.sharp_mm()[1], f64::INFINITY);
    }

    #[test]
    fn more_light_is_needed_for_less_noise_a_smaller_aperture_and_a_shorter_exposure() {
        let lux = STANDARD.lux_for(2.0);
        assert!((STANDARD.lux_for(1.0) / lux - 4.0).abs() < 1e-12);
        let stopped_down = Optics { f_number: 5.6, ..STANDARD };
        assert!((stopped_down.lux_for(2.0) / lux - 4.0).abs() < 1e-12);
        let longer = Optics { exposure_ms: 8.0, ..STANDARD };
        assert!((longer.lux_for(2.0) / lux - 0.5).abs() < 1e-12);
        // 6,600 electrons at white; 12.2 lux on the sensor for 500 on the print give 2,707 in 4 ms.
        assert!((lux - 500.0 * 6600.0 / 2707.0).abs() < 2.0, "{lux}");
    }
}
