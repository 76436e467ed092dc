//! `plumb cohort reference`: percentiles of a cohort's figures by age and condition.

use std::io::Write as _;
use std::path::PathBuf;

use clap::Args;
use plumbline_cohort::folder::Cohort;
use plumbline_cohort::reference::{Chosen, Made, of};
use plumbline_files::counting::counted;
use plumbline_files::{BadInput, Late, write_all};
use plumbline_study::reference::{PARTICIPANTS_ADVISED, PARTICIPANTS_MIN, bytes};

/// Make reference bands: percentiles of each figure by age and condition.
///
/// The 5th, 25th, 50th, 75th and 95th percentile after Harrell and Davis (1982), of one value for each
/// participant: the mean of the own trials. Beside each stand the bounds between which it lies with a
/// confidence of 90 %, by order statistics, whatever the distribution; the 5th and 95th need 59
/// participants for both. With fewer than 20 participants a band has no percentiles. Unusable trials
/// are left out.
///
/// The file is a Parquet table, which `plumb report --bands` draws beside a trial's figures.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  plumb cohort reference cohort/ --ages 20-40,40-60,60-80 --out bands.parquet\n  \
    plumb report trials/p01-control --bands bands.parquet --age 63"
)]
pub struct Arguments {
    /// The cohort's folder
    cohort: PathBuf,

    /// The age bands, years: from each FROM up to, but excluding, its TO [default: all ages together]
    #[arg(long, value_name = "FROM-TO,...", value_delimiter = ',', value_parser = ages)]
    ages: Vec<[f64; 2]>,

    /// Leave out doubtful trials as well
    #[arg(long)]
    good_only: bool,

    /// The bands, as Parquet
    #[arg(long, value_name = "FILE")]
    out: PathBuf,

    /// Replace the file if it exists
    #[arg(long)]
    force: bool,
}

/// An age band.
fn ages(text: &str) -> Result<[f64; 2], String> {
    let number =
        |text: &str| text.trim().parse::<f64>().ok().filter(|it| (0.0..=150.0).contains(it));
    let band = text.split_once('-').and_then(|(from, to)| Some([number(from)?, number(to)?]));
    band.filter(|[from, to]| from < to)
        .ok_or_else(|| format!("{text:?} is no age band: give FROM-TO in years, such as 40-60"))
}

/// Refuses bands that overlap: a participant would be in two.
fn refuse_overlap(ages: &[[f64; 2]]) -> Result<(), BadInput> {
    let mut ages = ages.to_vec();
    ages.sort_by(|a, b| a[0].total_cmp(&b[0]));
    match ages.windows(2).find(|pair| pair[1][0] < pair[0][1]) {
        None => Ok(()),
        Some(pair) => {
            let [[from, to], [other_from, other_to]] = [pair[0], pair[1]];
            let found = format!("{from}-{to} and {other_from}-{other_to} overlap");
            Err(BadInput::whole("--ages", found, "let one begin where another ends: 20-40,40-60"))
        }
    }
}

/// Runs the subcommand.
///
/// # Errors
/// When the cohort cannot be read, or the file cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { cohort, ages, good_only, out, force } = arguments;
    refuse_overlap(ages)?;
    Late::new(out, *force)?;
    let cohort = Cohort::open(cohort)?;
    let rows = cohort.rows()?;
    let chosen = Chosen { ages_years: ages.clone(), good_only: *good_only };
    let Made { bands, trials, by_verdict, by_age } = of(&cohort, &rows, &chosen)?;
    if bands.is_empty() {
        let found = format!("none of its {} can be used", counted(rows.len(), "trial"));
        let remedy = "see their verdicts and ages with `plumb cohort list` and `show`";
        return Err(BadInput::whole(cohort.path().display(), found, remedy).into());
    }
    write_all(&[(out.clone(), bytes(&bands, out)?)], *force)?;
    for (count, why) in
        [(by_verdict, "by their verdict"), (by_age, "since the age is not known, or in no band")]
    {
        if count > 0 {
            eprintln!("note: {} left out {why}", counted(count, "trial"));
        }
    }
    let mut groups: Vec<(String, String, usize)> = Vec::new();
    for band in &bands {
        let (condition, ages) = (band.condition.clone(), band.ages());
        match groups.iter_mut().find(|it| it.0 == condition && it.1 == ages) {
            Some(group) => group.2 = group.2.max(band.participants),
            None => groups.push((condition, ages, band.participants)),
        }
    }
    let mut lines = format!("{}: {}\n", out.display(), counted(trials, "trial"));
    for (condition, ages, participants) in groups {
        let few = match participants {
            ..PARTICIPANTS_MIN => format!(": too few, at least {PARTICIPANTS_MIN} are needed"),
            PARTICIPANTS_MIN..PARTICIPANTS_ADVISED => {
                format!(": few, {PARTICIPANTS_ADVISED} are recommended")
            }
            _ => String::new(),
        };
        lines += &format!("  {condition}, {ages}: {}{few}\n", counted(participants, "participant"));
    }
    let _ = write!(std::io::stdout(), "{lines}");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn age_bands_meet_and_do_not_overlap() {
        assert_eq!(ages("40-60"), Ok([40.0, 60.0]));
        for text in ["60-40", "40", "-5-60", "40-200", "x-y"] {
            assert!(ages(text).unwrap_err().contains("no age band"), "{text}");
        }
        assert_eq!(refuse_overlap(&[[40.0, 60.0], [20.0, 40.0]]), Ok(()));
        let error = refuse_overlap(&[[40.0, 60.0], [20.0, 41.0]]).unwrap_err().to_string();
        assert!(error.contains("20-41 and 40-60 overlap"), "{error}");
    }
}
