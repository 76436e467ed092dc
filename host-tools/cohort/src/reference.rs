//! Reference bands of a cohort: percentiles of each figure by age and condition.

use std::collections::{BTreeMap, HashMap};

use plumbline_files::BadInput;
use plumbline_study::reference::{Band, What, has_percentiles};
use plumbline_trial::parquet::Reader;
use plumbline_trial::verdict::Grade;

use crate::folder::Cohort;
use crate::names;
use crate::row::Row;

/// Far more rows than trials have figures.
const ROWS_MAX: u64 = 10_000_000_000;

/// Which trials a reference is of.
#[derive(Debug, Clone, Default)]
pub struct Chosen {
    /// Age bands, years: from each up to, but excluding, its end. Without any, one band of all ages.
    pub ages_years: Vec<[f64; 2]>,
    /// Whether doubtful trials are left out; unusable ones always are.
    pub good_only: bool,
}

/// What a reference is made of.
#[derive(Debug, Clone, Default)]
pub struct Made {
    /// The bands.
    pub bands: Vec<Band>,
    /// The trials in it.
    pub trials: usize,
    /// The trials left out by their verdict.
    pub by_verdict: usize,
    /// The trials whose participant's age is not known, or in no band.
    pub by_age: usize,
}

/// A trial's place: its age band, its condition, and the number of its participant.
struct Place {
    band: usize,
    condition: String,
    participant: usize,
}

/// One cell: an age band, a condition, and a figure.
type Cell = (usize, String, What);

/// The values of a participant's trials in a cell.
#[derive(Default)]
struct Values {
    /// By participant: the sum, and how many.
    sums: HashMap<usize, (f64, f64)>,
    measured_s: (f64, f64),
    unit: String,
    filter: String,
}

/// The bands: each participant counts once in each, with the mean of the own trials.
///
/// # Errors
/// When the cohort cannot be read.
pub fn of(cohort: &Cohort, rows: &[Row], chosen: &Chosen) -> Result<Made, BadInput> {
    let mut made = Made::default();
    let mut places: HashMap<&str, Place> = HashMap::new();
    let mut participants: HashMap<&str, usize> = HashMap::new();
    for row in rows {
        let grade = row.verdict.grade();
        if grade == Grade::Unusable || chosen.good_only && grade != Grade::Good {
            made.by_verdict += 1;
            continue;
        }
        let is_in = |[from, to]: &[f64; 2]| {
            row.person.age_years.is_some_and(|it| (*from..*to).contains(&it))
        };
        let band = match chosen.ages_years.iter().position(is_in) {
            None if chosen.ages_years.is_empty() => 0,
            None => {
                made.by_age += 1;
                continue;
            }
            Some(band) => band,
        };
        let next = participants.len();
        let participant = *participants.entry(&row.key.participant).or_insert(next);
        places
            .insert(&row.trial, Place { band, condition: row.key.condition.clone(), participant });
    }
    made.trials = places.len();
    let mut cells: BTreeMap<Cell, Values> = BTreeMap::new();
    for path in cohort.tables(names::FIGURES)? {
        let reader = Reader::open(&path, ROWS_MAX)?;
        for group in 0..reader.groups() {
            add_group(&reader, group, &places, &mut cells)?;
        }
    }
    made.bands =
        cells.into_iter().map(|(cell, values)| band(cell, values, &chosen.ages_years)).collect();
    Ok(made)
}

/// Adds the figures of one group of rows.
fn add_group(
    reader: &Reader,
    group: usize,
    places: &HashMap<&str, Place>,
    cells: &mut BTreeMap<Cell, Values>,
) -> Result<(), BadInput> {
    const NAMES: [&str; 9] = [
        "trial",
        "trunk",
        "segment",
        "figure",
        "direction",
        "value",
        "measured_s",
        "unit",
        "filter",
    ];
    let table = reader.group(group, &NAMES)?;
    let (trials, trunks) = (table.texts("trial")?, table.texts("trunk")?);
    let (segments, figures) = (table.texts("segment")?, table.texts("figure")?);
    let (directions, units) = (table.texts("direction")?, table.texts("unit")?);
    let (values, measured_s) = (table.some_numbers("value")?, table.some_numbers("measured_s")?);
    let filters = table.texts("filter")?;
    for (at, value) in values.iter().enumerate() {
        let Some((place, value)) = places.get(&*trials[at]).zip(*value) else { continue };
        if !has_percentiles(&figures[at]) {
            continue;
        }
        let what = What {
            trunk: trunks[at].clone(),
            segment: segments[at].clone(),
            figure: figures[at].clone(),
            direction: directions[at].clone(),
        };
        let cell = cells.entry((place.band, place.condition.clone(), what)).or_default();
        let (sum, count) = cell.sums.entry(place.participant).or_default();
        (*sum, *count) = (*sum + value, *count + 1.0);
        if let Some(measured_s) = measured_s[at] {
            let (sum, count) = cell.measured_s;
            cell.measured_s = (sum + measured_s, count + 1.0);
        }
        if cell.unit.is_empty() {
            cell.unit.clone_from(&units[at]);
            cell.filter.clone_from(&filters[at]);
        }
    }
    Ok(())
}

fn band((band, condition, what): Cell, values: Values, ages_years: &[[f64; 2]]) -> Band {
    let of_participants: Vec<f64> = values.sums.values().map(|(sum, count)| sum / count).collect();
    let (sum_s, count) = values.measured_s;
    Band {
        condition,
        age_from_years: ages_years.get(band).map(|it| it[0]),
        age_to_years: ages_years.get(band).map(|it| it[1]),
        what,
        unit: values.unit,
        filter: values.filter,
        measured_s: (count > 0.0).then(|| sum_s / count),
        participants: of_participants.len(),
        percentiles: Band::percentiles(of_participants),
    }
}
