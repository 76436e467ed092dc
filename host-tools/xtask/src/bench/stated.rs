//! How near the errors of the depth come to their bound, and whether the standard deviations that
//! are stated with each pose are those of its errors.

use std::path::Path;

use anyhow::Result;

use super::{Figures, get, measure, render, share_of_bound};

/// Seeds of the recordings besides the first one's. Five recordings of 300 frames tell the
/// deviation of the errors to 2 %.
const SEEDS: [&str; 4] = ["2", "3", "4", "5"];

/// The figures of several recordings, the first of which are known. The contents of `directory` are
/// replaced.
pub fn measure_all(directory: &Path, frames: u32, first: &Figures) -> Result<Vec<Figures>> {
    let mut recordings = vec![first.clone()];
    for seed in SEEDS {
        render(directory, frames, &["--seed", seed])?;
        recordings.push(measure(directory)?);
    }
    Ok(recordings)
}

/// Two rows of the table of spreads.
pub fn rows(recordings: &[Figures], targets: &[&str]) -> Result<String> {
    let count = recordings.len();
    let mut rows =
        format!("| Plumbline, tracking, over the bound (at most 1.08; {count} recordings) |");
    for target in targets {
        let share = share_of_bound(&Vec::from_iter(recordings), target)?;
        rows += &format!(" {share} |");
    }
    rows += &format!(
        " |\n| the SD of Plumbline's errors over the SD that it states (0.95 to 1.05; {count} recordings) |"
    );
    for target in targets {
        let name = format!("tracking_normalised:{target}");
        let mut squares = 0.0;
        for recording in recordings {
            let normalised: f64 = get(recording, &name)?.parse()?;
            squares += normalised * normalised;
        }
        rows += &format!(" {:.3} |", (squares / count as f64).sqrt());
    }
    Ok(rows + " |")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviations_are_pooled_as_squares() {
        let of = |value: &str| Figures::from([("tracking_normalised:lumbar".into(), value.into())]);
        let text = rows(&[of("0.6"), of("0.8")], &["lumbar"]).unwrap();
        assert!(text.starts_with("| Plumbline, tracking, over the bound"), "{text}");
        assert!(text.ends_with("(0.95 to 1.05; 2 recordings) | 0.707 | |"), "{text}");
        assert!(rows(&[of("1")], &["shoulder"]).unwrap_err().to_string().contains("shoulder"));
    }
}
