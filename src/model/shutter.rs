//! When each row of a frame is exposed.
//!
//! A rolling shutter exposes and reads one row after the other, each a constant delay after the
//! row before; a global shutter exposes all at once. A frame's time is the middle of the exposure
//! of the row that is read first, and every other row is later. Within a row all pixels count as
//! simultaneous: its exposure blurs the picture of a moving target evenly to both sides.

/// The order and the pace in which a camera reads its rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shutter {
    /// From one row to the one below; negative where rows are read from the bottom.
    row_ns: f64,
    /// The row that is read first.
    first_row_px: f64,
}

impl Shutter {
    /// All rows at once.
    pub const GLOBAL: Self = Self { row_ns: 0.0, first_row_px: 0.0 };

    /// Of a camera with this readout, see
    /// [`Config::readout_ns`](crate::model::config::Config::readout_ns).
    #[must_use]
    pub fn new(readout_ns: i32, height_px: u16) -> Self {
        let row_ns = f64::from(readout_ns) / f64::from(height_px);
        let first_row_px = if readout_ns < 0 { f64::from(height_px) - 1.0 } else { 0.0 };
        Self { row_ns, first_row_px }
    }

    /// Whether all rows are exposed at once.
    #[must_use]
    pub fn is_global(&self) -> bool {
        self.row_ns == 0.0
    }

    /// From one row to the one below, in seconds; negative where rows are read from the bottom.
    #[must_use]
    pub fn row_s(&self) -> f64 {
        self.row_ns * 1e-9
    }

    /// How much later than the frame's time a row is exposed; 0 for rows that would come before.
    #[must_use]
    pub fn delay_ns(&self, row_px: f64) -> u32 {
        // `as` saturates at both ends.
        (self.row_ns * (row_px - self.first_row_px) + 0.5) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_read_from_the_top_or_from_the_bottom() {
        let down = Shutter::new(16_000_000, 1000);
        assert_eq!(
            [0.0, 1.0, 499.5, 999.0].map(|row| down.delay_ns(row)),
            [0, 16_000, 7_992_000, 15_984_000]
        );
        let up = Shutter::new(-16_000_000, 1000);
        assert_eq!([999.0, 998.0, 0.0].map(|row| up.delay_ns(row)), [0, 16_000, 15_984_000]);
        // A target may reach beyond the frame.
        assert_eq!((down.delay_ns(-3.0), up.delay_ns(1002.0)), (0, 0));
        assert!((down.row_s() - 16e-6).abs() < 1e-15 && (up.row_s() + 16e-6).abs() < 1e-15);
        assert_eq!(Shutter::GLOBAL.delay_ns(700.0), 0);
        assert!(Shutter::new(0, 1000).is_global() && !up.is_global());
    }
}
