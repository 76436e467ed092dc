//! Reference bands: percentiles of figures over many participants, by age and condition; and where a
//! trial lies among them.
//!
//! A file of bands is a Parquet table with one row for each condition, age band, trunk, segment,
//! direction and figure.

use std::path::Path;

use plumbline_analysis::statistics::quantiles::{CONFIDENCE, Quantile, quantile};
use plumbline_files::BadInput;
use plumbline_files::counting::counted;
use plumbline_trial::parquet::{self, Reader, Values};

use crate::measures::MEASURES;
use crate::tidy;

/// The percentiles of a band.
pub const PERCENTILES: [u32; 5] = [5, 25, 50, 75, 95];

/// With fewer participants a band has no percentiles.
pub const PARTICIPANTS_MIN: usize = 20;

/// With fewer, a reader is told that they are few: so many are recommended for reference limits
/// (CLSI EP28-A3c).
pub const PARTICIPANTS_ADVISED: usize = 120;

/// The measured time of a trial may differ by this share from that of the band's trials: longer trials
/// have longer paths, and wider ranges.
const TIME_DIFFERS_MAX: f64 = 0.1;

/// More rows than any file of bands has.
const ROWS_MAX: u64 = 1_000_000;

/// What a band is of.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct What {
    /// `lower` or `upper`.
    pub trunk: String,
    /// `T1`, `T2`, ... or `whole`.
    pub segment: String,
    /// The figure's name.
    pub figure: String,
    /// Its direction.
    pub direction: String,
}

/// A figure's percentiles under one condition and in one age band.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// The condition.
    pub condition: String,
    /// From this age, years; `None` for all ages.
    pub age_from_years: Option<f64>,
    /// To below this age, likewise.
    pub age_to_years: Option<f64>,
    /// The figure.
    pub what: What,
    /// Its unit.
    pub unit: String,
    /// The filter of the positions.
    pub filter: String,
    /// How much of the segment was measured: the mean over the participants, seconds.
    pub measured_s: Option<f64>,
    /// How many participants it is of.
    pub participants: usize,
    /// The percentiles, in the order of [`PERCENTILES`]; `None` with fewer participants than
    /// [`PARTICIPANTS_MIN`].
    pub percentiles: Option<[Quantile; 5]>,
}

impl Band {
    /// The percentiles of values, one for each participant.
    ///
    /// # Panics
    /// Never: there are values.
    #[must_use]
    pub fn percentiles(mut values: Vec<f64>) -> Option<[Quantile; 5]> {
        if values.len() < PARTICIPANTS_MIN {
            return None;
        }
        values.sort_by(f64::total_cmp);
        let of = |percent| quantile(&values, f64::from(percent) / 100.0).expect("there are values");
        Some(PERCENTILES.map(of))
    }

    /// Whether it is of this age; a band of all ages is of every one, and of an unknown one.
    #[must_use]
    pub fn is_of_age(&self, age_years: Option<f64>) -> bool {
        match (self.age_from_years, self.age_to_years) {
            (Some(from), Some(to)) => age_years.is_some_and(|it| (from..to).contains(&it)),
            _ => true,
        }
    }

    /// Its age band, in words.
    #[must_use]
    pub fn ages(&self) -> String {
        match (self.age_from_years, self.age_to_years) {
            (Some(from), Some(to)) => format!("aged {from} to below {to}"),
            _ => "of all ages".to_owned(),
        }
    }
}

/// The name of the column of a percentile's estimate or bound.
fn column(percent: u32, end: &str) -> String {
    format!("p{percent:02}{end}")
}

/// The file of bands.
///
/// # Errors
/// When the writer fails.
pub fn bytes(bands: &[Band], place: &Path) -> Result<Vec<u8>, BadInput> {
    let texts =
        |of: fn(&Band) -> &str| Values::Texts(bands.iter().map(|it| of(it).to_owned()).collect());
    let numbers =
        |of: fn(&Band) -> Option<f64>| Values::SomeNumbers(bands.iter().map(of).collect());
    let mut columns = vec![
        ("condition".to_owned(), texts(|it| &it.condition)),
        ("age_from_years".to_owned(), numbers(|it| it.age_from_years)),
        ("age_to_years".to_owned(), numbers(|it| it.age_to_years)),
        ("trunk".to_owned(), texts(|it| &it.what.trunk)),
        ("segment".to_owned(), texts(|it| &it.what.segment)),
        ("direction".to_owned(), texts(|it| &it.what.direction)),
        ("figure".to_owned(), texts(|it| &it.what.figure)),
        ("unit".to_owned(), texts(|it| &it.unit)),
        ("filter".to_owned(), texts(|it| &it.filter)),
        ("measured_s".to_owned(), numbers(|it| it.measured_s)),
        (
            "participants".to_owned(),
            Values::Integers(bands.iter().map(|it| it.participants as i64).collect()),
        ),
    ];
    for (at, percent) in PERCENTILES.into_iter().enumerate() {
        let mut put = |end: &str, of: &dyn Fn(&Quantile) -> Option<f64>| {
            let values = bands.iter().map(|it| it.percentiles.as_ref().and_then(|it| of(&it[at])));
            columns.push((column(percent, end), Values::SomeNumbers(values.collect())));
        };
        put("", &|it| Some(it.value));
        put("_low", &|it| it.low);
        put("_high", &|it| it.high);
    }
    let method = format!(
        "percentiles after Harrell and Davis (1982), one value for each participant; _low and _high: \
         order statistics that hold it with a probability of at least {CONFIDENCE}; null: too few \
         participants"
    );
    parquet::bytes("reference", &columns, vec![("method", method)])
        .map_err(|error| BadInput::whole(place.display(), error, "report it: rows can be written"))
}

/// Reads a file of bands.
///
/// # Errors
/// When it cannot be read, or is another table.
pub fn read(path: &Path) -> Result<Vec<Band>, BadInput> {
    let table = Reader::open(path, ROWS_MAX)?.all()?;
    let (conditions, trunks) = (table.texts("condition")?, table.texts("trunk")?);
    let (from, to) = (table.some_numbers("age_from_years")?, table.some_numbers("age_to_years")?);
    let (segments, directions) = (table.texts("segment")?, table.texts("direction")?);
    let (figures, units) = (table.texts("figure")?, table.texts("unit")?);
    let (filters, measured_s) = (table.texts("filter")?, table.some_numbers("measured_s")?);
    let participants = table.integers("participants")?;
    let mut percentiles = Vec::new();
    for percent in PERCENTILES {
        percentiles.push((
            table.some_numbers(&column(percent, ""))?,
            table.some_numbers(&column(percent, "_low"))?,
            table.some_numbers(&column(percent, "_high"))?,
        ));
    }
    let of_row = |at: usize| Band {
        condition: conditions[at].clone(),
        age_from_years: from[at],
        age_to_years: to[at],
        what: What {
            trunk: trunks[at].clone(),
            segment: segments[at].clone(),
            figure: figures[at].clone(),
            direction: directions[at].clone(),
        },
        unit: units[at].clone(),
        filter: filters[at].clone(),
        measured_s: measured_s[at],
        participants: usize::try_from(participants[at]).unwrap_or(0),
        percentiles: {
            let all: Option<Vec<Quantile>> = percentiles
                .iter()
                .map(|(value, low, high)| {
                    Some(Quantile { value: value[at]?, low: low[at], high: high[at] })
                })
                .collect();
            all.and_then(|it| it.try_into().ok())
        },
    };
    Ok((0..conditions.len()).map(of_row).collect())
}

/// A trial's figure beside its band.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
    /// The band.
    pub band: Band,
    /// Its percentiles.
    pub percentiles: [Quantile; 5],
    /// The trial's value.
    pub value: f64,
}

impl Placed {
    /// Where the value lies, in words.
    #[must_use]
    pub fn words(&self) -> String {
        let below = self.percentiles.iter().filter(|it| it.value <= self.value).count();
        let name = |at: usize| format!("{}th", PERCENTILES[at]);
        match below {
            0 => format!("below the {} percentile", name(0)),
            5 => format!("above the {} percentile", name(4)),
            below => {
                format!("between the {} and the {} percentile", name(below - 1), name(below))
            }
        }
    }
}

/// What comes of placing a trial.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Comparison {
    /// The figures that have a band.
    pub placed: Vec<Placed>,
    /// Why others have none: one sentence for each reason.
    pub absent: Vec<String>,
}

/// The figures that a report shows beside their bands, by name and direction.
const SHOWN: [(&str, &str); 8] = [
    ("path length", "APML"),
    ("RMS", "AP"),
    ("RMS", "ML"),
    ("range", "AP"),
    ("range", "ML"),
    ("ellipse area", "APML"),
    ("F95", "AP"),
    ("F95", "ML"),
];

/// Places a trial's figures, given by their rows: those of the whole that a report shows.
#[must_use]
pub fn compare(bands: &[Band], rows: &[tidy::Row], age_years: Option<f64>) -> Comparison {
    let mut found = Comparison::default();
    let mut refuse = |reason: String| {
        if !found.absent.contains(&reason) {
            found.absent.push(reason);
        }
    };
    let rows = rows
        .iter()
        .filter(|row| row.segment == "whole" && SHOWN.contains(&(row.figure, row.direction)));
    for row in rows {
        let name = format!("{} {}, {} trunk", row.figure, row.direction, row.trunk);
        let is_it = |band: &&Band| {
            let What { trunk, segment, figure, direction } = &band.what;
            (&**trunk, &**segment, &**figure, &**direction)
                == (row.trunk, &*row.segment, row.figure, row.direction)
        };
        let of_condition = |band: &&Band| band.condition == row.condition;
        let mut own = bands.iter().filter(is_it).filter(of_condition);
        let of_age = own.clone().find(|band| band.is_of_age(age_years));
        let Some(band) = of_age else {
            refuse(match (own.next(), age_years) {
                (None, _) => format!("the reference has no trials under {:?}", row.condition),
                (Some(_), None) => {
                    "the participant's age is not known, and the reference is by age \
                                    (--age says it)"
                        .to_owned()
                }
                (Some(_), Some(age)) => format!("the reference has no band for {age} years"),
            });
            continue;
        };
        let Some(percentiles) = band.percentiles else {
            refuse(format!(
                "the reference has {} {} under {:?}, and at least {PARTICIPANTS_MIN} are needed",
                counted(band.participants, "participant"),
                band.ages(),
                band.condition
            ));
            continue;
        };
        if band.filter != row.filter {
            refuse(format!(
                "the reference's figures are of another filter, {}, than this report's, {}",
                band.filter, row.filter
            ));
            continue;
        }
        if let Some((own_s, of_band_s)) = row.measured_s.zip(band.measured_s)
            && (own_s / of_band_s - 1.0).abs() > TIME_DIFFERS_MAX
        {
            refuse(format!(
                "{name}: of {own_s:.1} s, and the reference's of {of_band_s:.1} s: \
                 --span makes them alike"
            ));
            continue;
        }
        match row.value {
            Some(value) => found.placed.push(Placed { band: band.clone(), percentiles, value }),
            None => refuse(format!("{name}: {}", row.reason)),
        }
    }
    found
}

/// Whether a figure of this name has percentiles: an angle of an axis has none.
#[must_use]
pub fn has_percentiles(figure: &str) -> bool {
    MEASURES.iter().any(|it| it.name == figure && it.has_mean())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::band;

    fn row(value: Option<f64>) -> tidy::Row {
        tidy::Row {
            participant: "P01".to_owned(),
            condition: "calm".to_owned(),
            trial: "t".to_owned(),
            verdict: "good",
            trunk: "lower",
            segment: "whole".to_owned(),
            start_s: Some(0.0),
            end_s: Some(60.0),
            measured_s: Some(60.0),
            direction: "AP",
            figure: "RMS",
            value,
            standard_uncertainty: None,
            unit: "mm",
            filter: "none".to_owned(),
            rate_hz: Some(60.0),
            reason: "gone".to_owned(),
        }
    }

    fn hundred() -> Vec<f64> {
        (1..=100).map(f64::from).collect()
    }

    #[test]
    fn a_trial_is_placed_in_the_band_of_its_condition_and_age() {
        let bands = [band(hundred())];
        let place = |value: f64| compare(&bands, &[row(Some(value))], Some(40.0)).placed[0].words();
        assert_eq!(place(1.0), "below the 5th percentile");
        assert_eq!(place(30.0), "between the 25th and the 50th percentile");
        assert_eq!(place(60.0), "between the 50th and the 75th percentile");
        assert_eq!(place(99.0), "above the 95th percentile");
        // All ages are one band.
        let all = Band { age_from_years: None, age_to_years: None, ..band(hundred()) };
        assert_eq!(compare(&[all], &[row(Some(1.0))], None).placed.len(), 1);
    }

    #[test]
    fn what_cannot_be_compared_says_why() {
        let of = |band: Band, row: tidy::Row, age: Option<f64>| {
            let found = compare(&[band], &[row], age);
            assert_eq!((found.placed.len(), found.absent.len()), (0, 1), "{found:?}");
            found.absent[0].clone()
        };
        let whole = || band(hundred());
        let other = tidy::Row { condition: "wild".to_owned(), ..row(Some(1.0)) };
        let short = tidy::Row { measured_s: Some(30.0), ..row(Some(1.0)) };
        for (reason, part) in [
            (of(whole(), row(Some(1.0)), None), "age is not known"),
            (of(whole(), row(Some(1.0)), Some(60.0)), "no band for 60 years"),
            (of(whole(), other, Some(50.0)), "no trials under \"wild\""),
            (of(whole(), short, Some(50.0)), "of 30.0 s, and the reference's of 60.0 s"),
            (of(whole(), row(None), Some(50.0)), "RMS AP, lower trunk: gone"),
            (
                of(Band { filter: "x".into(), ..whole() }, row(Some(1.0)), Some(50.0)),
                "another filter",
            ),
            (of(band(vec![1.0; 19]), row(Some(1.0)), Some(50.0)), "has 19 participants aged 40 to"),
        ] {
            assert!(reason.contains(part), "no {part}: {reason}");
        }
    }

    #[test]
    fn bands_survive_the_disk() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bands.parquet");
        let few = Band { age_from_years: None, age_to_years: None, ..band(vec![1.0; 5]) };
        let bands = [band(hundred()), band(hundred()[..30].to_vec()), few];
        // With thirty, the 5th and the 95th percentile have one bound each.
        let thirty = bands[1].percentiles.unwrap();
        assert_eq!((thirty[0].low, thirty[4].high), (None, None));
        assert!(thirty[0].high.is_some() && thirty[2].low.is_some());
        std::fs::write(&path, bytes(&bands, &path).unwrap()).unwrap();
        assert_eq!(read(&path).unwrap(), bands);
    }
}
