//! Which lens something was measured through, as files name it.
//!
//! Size and focal length are for people; the checksum is of every number of the lens, bit by bit,
//! so that two calibrations of one camera are two lenses. The readout of a rolling shutter is not in
//! it: it moves times, and not what stands still.

use std::fmt;

use plumbline::lens::Lens;
use plumbline::packet::document_crc;
use serde::{Deserialize, Serialize};

/// A lens, in short.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensId {
    width_px: u16,
    height_px: u16,
    fx_px: f64,
    #[serde(with = "hexadecimal")]
    checksum: u32,
}

impl LensId {
    /// That of a lens.
    #[must_use]
    pub fn of(lens: &Lens) -> Self {
        let Lens { width_px, height_px, fx_px, fy_px, cx_px, cy_px, skew_px, distortion } = lens;
        let numbers = [*fx_px, *fy_px, *cx_px, *cy_px, *skew_px];
        let mut bytes = [width_px.to_le_bytes(), height_px.to_le_bytes()].concat();
        bytes.extend(distortion.name().bytes());
        let numbers = numbers.iter().chain(distortion.coefficients());
        bytes.extend(numbers.flat_map(|number| number.to_le_bytes()));
        let (width_px, height_px, fx_px) = (*width_px, *height_px, *fx_px);
        Self { width_px, height_px, fx_px, checksum: document_crc(&bytes) }
    }

    /// The checksum of all numbers of the lens.
    #[must_use]
    pub fn checksum(&self) -> u32 {
        self.checksum
    }
}

impl fmt::Display for LensId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width_px, height_px, fx_px, checksum } = self;
        write!(formatter, "{width_px} x {height_px} px, fx {fx_px:.1} px ({checksum:08x})")
    }
}

/// Eight hexadecimal digits, as all checksums are written.
mod hexadecimal {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<S: Serializer>(checksum: &u32, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&format!("{checksum:08x}"))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
        let text = String::deserialize(deserializer)?;
        u32::from_str_radix(&text, 16)
            .map_err(|_| D::Error::custom("a checksum has eight hexadecimal digits"))
    }
}

#[cfg(test)]
mod tests {
    use plumbline::lens::Distortion;

    use super::*;
    use crate::camera::stand_in;

    #[test]
    fn every_number_of_the_lens_is_in_it() {
        let lens = Lens { distortion: Distortion::Radial2([-0.1, 0.02]), ..stand_in(1456, 1088) };
        let changed = |change: fn(&mut Lens)| {
            let mut other = lens;
            change(&mut other);
            LensId::of(&other)
        };
        let all = [
            changed(|_| ()),
            changed(|lens| lens.width_px += 1),
            changed(|lens| lens.height_px += 1),
            changed(|lens| lens.fx_px += 1e-9),
            changed(|lens| lens.fy_px += 1e-9),
            changed(|lens| lens.cx_px += 1e-9),
            changed(|lens| lens.cy_px += 1e-9),
            changed(|lens| lens.skew_px += 1e-9),
            changed(|lens| lens.distortion = Distortion::Radial2([-0.1, 0.02 + 1e-12])),
            changed(|lens| lens.distortion = Distortion::Brown5([-0.1, 0.02, 0.0, 0.0, 0.0])),
            changed(|lens| lens.distortion = Distortion::Fisheye4([-0.1, 0.02, 0.0, 0.0])),
        ];
        for (index, one) in all.iter().enumerate() {
            assert!(all[..index].iter().all(|other| other.checksum() != one.checksum()), "{index}");
        }
    }
}
