//! Cardiac output, the volume that the heart pumps: heart rate times stroke volume.

use super::cycles::Cycles;
use super::signal::Signal;

/// The longest gap between two stroke volumes over which they are interpolated. They come once a
/// beat, and two beats take at most 4 s.
const GAP_MAX_S: f64 = 4.0;

/// Millilitres per litre.
const ML_PER_L: f64 = 1000.0;

/// The cardiac output of each cycle, litres per minute: 60 / RR times the stroke volume in litres.
///
/// The stroke volume may come once a beat, as from a finger pressure monitor, or at any rate; it is
/// interpolated linearly at the middle of the cycle. The output is missing where the cycle is not
/// plausible or the stroke volume is unknown.
#[must_use]
pub fn cardiac_output_l_min(cycles: &Cycles, stroke_volume_ml: &Signal) -> Signal {
    cycles.figures(|cycle| {
        let stroke_volume_ml = stroke_volume_ml.at(cycle.middle_s(), GAP_MAX_S)?;
        Some(60.0 / cycle.interval_s() * stroke_volume_ml / ML_PER_L)
    })
}

#[cfg(test)]
mod tests {
    use super::super::cycles::Beats;
    use super::*;

    #[test]
    fn it_is_the_heart_rate_times_the_stroke_volume() {
        // The paper's supine control: 63.1 beats per minute, 92.8 mL, 5.8 L/min.
        let beats_s: Vec<f64> = (0..5).map(|beat| f64::from(beat) * 60.0 / 63.1).collect();
        let cycles = Cycles::new(Beats::RWaves, &[beats_s]);
        let volume = Signal::new(vec![0.0, 2.0, 6.5], vec![92.8, 92.8, 92.8]).unwrap();
        let output = cardiac_output_l_min(&cycles, &volume);
        // The middles of the third and fourth cycles lie in a gap of 4.5 s.
        let known: Vec<(f64, f64)> = output.present().collect();
        assert_eq!((output.values().len(), known.len()), (4, 2));
        for (_, litres) in known {
            assert!((litres - 63.1 * 92.8 / 1000.0).abs() < 1e-12, "{litres}");
        }
    }

    #[test]
    fn a_changing_stroke_volume_is_that_of_the_middle() {
        let cycles = Cycles::new(Beats::RWaves, &[vec![0.0, 1.0, 2.0], vec![9.0]]);
        let volume = Signal::new(vec![0.0, 4.0], vec![80.0, 40.0]).unwrap();
        let output = cardiac_output_l_min(&cycles, &volume);
        let known: Vec<(f64, f64)> = output.present().collect();
        assert_eq!(known, [(0.5, 60.0 * 75.0 / 1000.0), (1.5, 60.0 * 65.0 / 1000.0)]);
    }
}
