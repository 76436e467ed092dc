//! A study's figures in tables like the paper's, each with the tests behind it.

use std::fmt;

use plumbline_analysis::physiology::bins::Event;
use plumbline_analysis::statistics::inference::{Inference, SIGNIFICANT};
use plumbline_trial::points::point_name;

use crate::figures::{StudyFigures, SwayResponse, TimeWindow};
use crate::grid::{Annotated, Grid, digits};
use crate::inference::{Tested, adjusted_text, comparisons, effects};
use crate::measures::{Direction, MEASURES, Measure};
use crate::time::time_name;
use crate::values::Response;

#[cfg(test)]
#[path = "../../analysis/tests/common/table_2.rs"]
mod paper;

/// The text of an absent value; the reason is given with the tests.
const NONE: &str = "–";

/// The number of times side by side in a table of physiology.
const TIMES_ABREAST: usize = 2;

/// A table in the paper's layout: columns in groups, rows in sections.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PaperTable {
    /// The title.
    pub title: String,
    /// The headings of the row names: of the section, if sections are named, and of the row.
    pub stub: Vec<&'static str>,
    /// Groups of columns with a common heading.
    pub groups: Vec<Group>,
    /// Groups of rows.
    pub sections: Vec<Section>,
    /// Notes that explain the marks.
    pub notes: Vec<String>,
}

/// A group of columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Group {
    /// Their common heading.
    pub name: String,
    /// Their own headings.
    pub columns: Vec<String>,
}

/// A group of rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Section {
    /// Their common name.
    pub name: Option<String>,
    /// The name and cells of each row.
    pub rows: Vec<(String, Vec<Cell>)>,
}

/// A number, with marks for significant differences.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cell {
    /// Mean and error, or Cohen's d.
    pub text: String,
    /// An asterisk and letters; the notes say what they mean.
    pub marks: String,
}

impl fmt::Display for Cell {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { text, marks } = self;
        if marks.is_empty() {
            write!(formatter, "{text}")
        } else {
            write!(formatter, "{text} {marks}")
        }
    }
}

impl PaperTable {
    /// The table as text for a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let columns = self.groups.iter().flat_map(|group| {
            group.columns.iter().map(move |column| format!("{}\n{column}", group.name))
        });
        let header = [self.stub.join(", ")].into_iter().chain(columns).collect();
        let rows = self.sections.iter().flat_map(|section| {
            section.rows.iter().map(|(name, cells)| {
                let section = section.name.as_ref();
                let name = section.map_or_else(|| name.clone(), |it| format!("{it} {name}"));
                [name].into_iter().chain(cells.iter().map(Cell::to_string)).collect()
            })
        });
        let grid = Grid { header, rows: rows.collect() };
        format!("{}\n{}{}\n", self.title, grid.text(), self.notes.join("\n"))
    }
}

/// Responses that are shown together: their means, and the tests behind them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// What they are.
    pub title: String,
    /// Their means.
    pub tables: Vec<PaperTable>,
    /// The effects on each.
    pub effects: Annotated,
    /// How the p of effects are adjusted, in words; `None` where they are not.
    pub adjusted: Option<String>,
    /// Each condition compared with the first, at each time.
    pub comparisons: Annotated,
}

impl StudyFigures {
    /// The study in parts: physiology, each figure that has a value for each time, and all other
    /// figures.
    #[must_use]
    pub fn parts(&self) -> Vec<Part> {
        let physiology = self.physiology.iter();
        let physiology: Vec<(String, &Response)> =
            physiology.map(|it| (it.quantity.name_and_unit().0.to_owned(), &it.response)).collect();
        let part = |title: &str, tables, responses: &[(String, &Response)]| {
            (!responses.is_empty()).then(|| self.part(title, tables, responses))
        };
        let mut parts: Vec<Part> =
            part("Physiology", self.physiology_tables(), &physiology).into_iter().collect();
        for measure in MEASURES.iter().filter(|it| it.is_by_time()) {
            let own = self.sway.iter().filter(|it| it.figure.figure == measure.name);
            let own: Vec<(String, &Response)> = own
                .map(|SwayResponse { figure, response }| {
                    let name = format!("{}, {}", point_name(&figure.point), figure.direction);
                    (name, response)
                })
                .collect();
            parts.extend(part(&titled(measure.name), vec![self.time_table(measure)], &own));
        }
        let of_span = self.sway.iter().filter(|it| !it.figure.is_by_time);
        let of_span: Vec<(String, &Response)> = of_span
            .map(|SwayResponse { figure, response }| {
                (format!("{}, {}", point_name(&figure.point), figure.name()), response)
            })
            .collect();
        parts.extend(part("All times together", vec![self.span_table()], &of_span));
        parts
    }

    fn part(&self, title: &str, tables: Vec<PaperTable>, all: &[(String, &Response)]) -> Part {
        let control = &self.conditions[0];
        let tested = all.iter().map(|(name, response)| Tested {
            name: name.clone(),
            inference: &response.inference,
            adjusted: &response.adjusted,
        });
        let pairs = all.iter().flat_map(|(name, response)| {
            let condition = &response.inference.factors[0].name;
            let of_conditions = response.inference.comparisons.iter();
            of_conditions
                .filter(move |it| it.factor == *condition && it.levels[0] == *control)
                .map(move |it| (name.clone(), it))
        });
        Part {
            title: title.to_owned(),
            tables,
            effects: effects(tested),
            adjusted: adjusted_text(all.iter().flat_map(|(_, it)| &it.adjusted)),
            comparisons: comparisons(pairs),
        }
    }

    /// The paper's Table I: physiology by quantity; for each time the conditions side by side.
    /// There are as many tables as needed, each with two times, as in the paper, and none if no
    /// physiology was recorded.
    #[must_use]
    pub fn physiology_tables(&self) -> Vec<PaperTable> {
        if self.physiology.is_empty() {
            return Vec::new();
        }
        let windows: Vec<(char, &TimeWindow)> =
            self.windows.iter().enumerate().map(|(at, it)| (letter(at), it)).collect();
        let parts = windows.chunks(TIMES_ABREAST);
        let last = parts.len().saturating_sub(1);
        let table = |(at, part): (usize, &[(char, &TimeWindow)])| PaperTable {
            title: if at == 0 { "Physiology" } else { "Physiology, continued" }.to_owned(),
            stub: vec!["quantity"],
            groups: part
                .iter()
                .map(|(letter, window)| self.physiology_group(*letter, window))
                .collect(),
            sections: vec![self.physiology_section(part)],
            notes: if at == last { self.physiology_notes() } else { Vec::new() },
        };
        parts.enumerate().map(table).collect()
    }

    fn physiology_group(&self, letter: char, window: &TimeWindow) -> Group {
        let TimeWindow { name, span_s: [from, to], .. } = window;
        let name = format!("{name}, {from} to {to} s ({letter})");
        Group { name, columns: self.conditions.clone() }
    }

    fn physiology_section(&self, windows: &[(char, &TimeWindow)]) -> Section {
        let rows = self.physiology.iter().map(|it| {
            let (name, unit) = it.quantity.name_and_unit();
            let cells = windows.iter().flat_map(|(_, TimeWindow { name: time, .. })| {
                let of_condition = |condition: &String| Cell {
                    text: mean(&it.response.inference, condition, Some(time), DECIMALS),
                    marks: self.physiology_marks(&it.response.inference, condition, time),
                };
                self.conditions.iter().map(of_condition).collect::<Vec<_>>()
            });
            (format!("{name} ({unit})"), cells.collect())
        });
        Section { name: None, rows: rows.collect() }
    }

    fn physiology_notes(&self) -> Vec<String> {
        let control = &self.conditions[0];
        let responses: Vec<(&str, &Response)> = self
            .physiology
            .iter()
            .map(|it| (it.quantity.name_and_unit().0, &it.response))
            .collect();
        let from_transition = self.windows.iter().filter(|it| it.from == Event::Transition);
        let from_transition = from_transition
            .map(|it| format!(" (of the {} from when the person begins to rise)", it.name));
        let marks = if self.windows.len() > 1 {
            format!(
                "* differs from {control} at that time; a letter: differs from that time under the \
                 same condition (paired t tests, p < {SIGNIFICANT} after Bonferroni's correction, \
                 for the times and for the pairs of times)."
            )
        } else {
            format!(
                "{ONE_TIME} * differs from {control} (paired t tests, p < {SIGNIFICANT} after \
                 Bonferroni's correction for all conditions)."
            )
        };
        vec![
            self.participants_note(&responses),
            format!(
                "Mean ± SEM; seconds from t = 0{}. {marks}",
                from_transition.collect::<String>()
            ),
            "HR: heart rate. MAP, SBP, DBP: mean, systolic, diastolic arterial pressure. SV: \
             stroke volume. CO: cardiac output. CBFv: cerebral blood flow velocity. TSI: tissue \
             saturation index. PETCO2: end-tidal partial pressure of CO2."
                .to_owned(),
        ]
    }

    /// As the paper's Table II, of total path length: a measure by direction and time; for each
    /// point the conditions side by side, with Cohen's d of each against the first.
    fn time_table(&self, measure: &Measure) -> PaperTable {
        let sections = Direction::ALL.into_iter().filter_map(|direction| {
            let responses = self.of_points(measure.name, direction.word());
            responses.iter().any(Option::is_some).then(|| Section {
                name: Some(direction.word().to_owned()),
                rows: (0..self.bins_s.len())
                    .map(|at| {
                        let time = time_name(at);
                        let cells = responses.iter();
                        let cells = cells.flat_map(|it| self.sway_cells(*it, Some(&time)));
                        (time.clone(), cells.collect())
                    })
                    .collect(),
            })
        });
        let bins = self.bins_s.iter().enumerate();
        let times: Vec<String> =
            bins.map(|(at, [from, to])| format!("{}: {from} to {to} s", time_name(at))).collect();
        let Measure { name, unit, .. } = measure;
        let total =
            if *name == "path length" { "Total path length".to_owned() } else { titled(name) };
        let all = self.sway.iter().filter(|it| it.figure.figure == *name);
        PaperTable {
            title: format!("{total} ({unit})"),
            stub: vec!["direction", "time"],
            groups: self.groups_of_points(),
            sections: sections.collect(),
            notes: self.sway_notes(
                all,
                &format!("Mean ± SEM, {unit}. {}.", times.join("; ")),
                self.bins_s.len(),
            ),
        }
    }

    /// All figures that have one value for all times together, by direction.
    fn span_table(&self) -> PaperTable {
        let [from_s, to_s] = self.span_s;
        let sections = MEASURES.iter().filter(|it| !it.is_by_time()).filter_map(|measure| {
            let of_direction = |direction: &Direction| {
                let responses = self.of_points(measure.name, direction.word());
                responses.iter().any(Option::is_some).then(|| {
                    let cells = responses.iter().flat_map(|it| self.sway_cells(*it, None));
                    (direction.word().to_owned(), cells.collect::<Vec<_>>())
                })
            };
            let rows: Vec<(String, Vec<Cell>)> =
                measure.directions().iter().filter_map(of_direction).collect();
            let name = match measure.unit {
                "" => measure.name.to_owned(),
                unit => format!("{} ({unit})", measure.name),
            };
            (!rows.is_empty()).then_some(Section { name: Some(name), rows })
        });
        let all = self.sway.iter().filter(|it| !it.figure.is_by_time);
        PaperTable {
            title: format!("From {from_s} to {to_s} s"),
            stub: vec!["figure", "direction"],
            groups: self.groups_of_points(),
            sections: sections.collect(),
            notes: self.sway_notes(all, "Mean ± SEM.", 0),
        }
    }

    /// A figure of each point, in the order of the points.
    fn of_points(&self, figure: &str, direction: &str) -> Vec<Option<&SwayResponse>> {
        let of_point = |point: &str| {
            self.sway.iter().find(|SwayResponse { figure: it, .. }| {
                it.point == point && it.figure == figure && it.direction == direction
            })
        };
        self.points().into_iter().map(of_point).collect()
    }

    /// Each point's columns: the conditions, with d of each but the first.
    fn groups_of_points(&self) -> Vec<Group> {
        let several = self.conditions.len() > 2;
        let others = self.conditions[1..].iter().flat_map(|condition| {
            let d = if several { format!("d ({condition})") } else { "d".to_owned() };
            [condition.clone(), d]
        });
        let columns: Vec<String> = [self.conditions[0].clone()].into_iter().chain(others).collect();
        let points = self.points().into_iter();
        points
            .map(|point| Group { name: point_name(point).to_owned(), columns: columns.clone() })
            .collect()
    }

    /// The notes of a table with this number of times; 0 where figures are of all of them together.
    fn sway_notes<'a>(
        &self,
        responses: impl Iterator<Item = &'a SwayResponse>,
        values: &str,
        times: usize,
    ) -> Vec<String> {
        let control = &self.conditions[0];
        let responses: Vec<(&str, &Response)> =
            responses.map(|it| (point_name(&it.figure.point), &it.response)).collect();
        let (at, and_times) = if times > 1 { (" at that time", " and times") } else { ("", "") };
        let one_time = if times == 1 { format!(" {ONE_TIME}") } else { String::new() };
        vec![
            self.participants_note(&responses),
            format!("{values}{one_time}"),
            format!(
                "d: Cohen's d of the condition against {control}. * differs from {control}{at} (by \
                 ranks: ANOVA-type statistic, p < {SIGNIFICANT} after Bonferroni's correction for \
                 all conditions{and_times} of this figure)."
            ),
            "AP: anterior-posterior; ML: medial-lateral; SI: superior-inferior; APML, APSI, MLSI: \
             in the transverse, sagittal and coronal plane."
                .to_owned(),
        ]
    }

    /// How many participants are in these named responses: one number, or one for each name, or a
    /// range where a name has several.
    fn participants_note(&self, responses: &[(&str, &Response)]) -> String {
        let all = self.participants.len().max(responses.iter().map(|it| it.1.n).max().unwrap_or(0));
        let range = |responses: &mut dyn Iterator<Item = &(&str, &Response)>| {
            let counts = responses.map(|it| it.1.n).map(|n| (n, n));
            let ends = counts.reduce(|(low, high), (n, _)| (low.min(n), high.max(n)));
            match ends.unwrap_or_default() {
                (low, high) if low == high => low.to_string(),
                (low, high) => format!("{low} to {high}"),
            }
        };
        let whole = range(&mut responses.iter());
        if !whole.contains(' ') {
            return format!("n = {whole} of {all} participants.");
        }
        let mut names: Vec<&str> = responses.iter().map(|it| it.0).collect();
        names.dedup();
        let each = names.into_iter().map(|name| {
            let n = range(&mut responses.iter().filter(|it| it.0 == name));
            format!("{name} {n}")
        });
        let each: Vec<String> = each.collect();
        format!("n, of {all} participants: {} (each in the table of effects).", each.join(", "))
    }

    /// The points of the body, in the order of the tables.
    #[must_use]
    pub fn points(&self) -> Vec<&str> {
        let mut points: Vec<&str> = self.sway.iter().map(|it| it.figure.point.as_str()).collect();
        points.dedup();
        points
    }

    /// The asterisk and letters of a cell of Table I.
    fn physiology_marks(&self, inference: &Inference, condition: &str, time: &str) -> String {
        let mut marks = String::new();
        let under = level_of_time(inference, Some(time));
        let differs = inference.comparison([&self.conditions[0], condition], under);
        let is_significant =
            |p: Option<f64>| p.is_some_and(|p_bonferroni| p_bonferroni < SIGNIFICANT);
        if is_significant(differs.and_then(|it| Some(it.t_test.known()?.p_bonferroni))) {
            marks.push('*');
        }
        let times = inference.factors.get(1).map_or(&[][..], |factor| &factor.levels);
        for (at, other) in times.iter().enumerate() {
            let comparison = inference
                .comparison([other, time], Some(condition))
                .or_else(|| inference.comparison([time, other], Some(condition)));
            if is_significant(comparison.and_then(|it| Some(it.t_test.known()?.p_bonferroni))) {
                marks.push(letter(at));
            }
        }
        marks
    }

    fn sway_cells(&self, response: Option<&SwayResponse>, time: Option<&str>) -> Vec<Cell> {
        let unmarked = |text: String| Cell { text, marks: String::new() };
        let Some(SwayResponse { figure, response }) = response else {
            return vec![unmarked(NONE.to_owned()); 2 * self.conditions.len() - 1];
        };
        let inference = &response.inference;
        // As in the paper. Other figures have scales of their own.
        let decimals = if figure.figure == "path length" { DECIMALS } else { None };
        let control = &self.conditions[0];
        let mut cells = vec![unmarked(mean(inference, control, time, decimals))];
        for condition in &self.conditions[1..] {
            let under = level_of_time(inference, time);
            let comparison = inference.comparison([control, condition], under);
            let p = comparison.and_then(|it| Some(it.ranks.known()?.p_bonferroni));
            let marks = if p.is_some_and(|p| p < SIGNIFICANT) { "*" } else { "" };
            let d = comparison.and_then(|it| it.d.known());
            let text = mean(inference, condition, time, decimals);
            cells.push(Cell { text, marks: marks.to_owned() });
            cells.push(unmarked(d.map_or_else(|| NONE.to_owned(), |d| format!("{d:.2}"))));
        }
        cells
    }
}

/// A name with a capital.
#[must_use]
pub fn titled(name: &str) -> String {
    let (first, rest) = name.split_at(name.len().min(1));
    first.to_uppercase() + rest
}

/// The letter of a time in Table I: `a` for the first; times after `z` have none.
fn letter(time: usize) -> char {
    u8::try_from(time)
        .ok()
        .and_then(|it| b'a'.checked_add(it))
        .filter(u8::is_ascii_lowercase)
        .map_or('?', char::from)
}

/// A time as a level of the design, in which a single time is none.
fn level_of_time<'a>(inference: &Inference, time: Option<&'a str>) -> Option<&'a str> {
    time.filter(|_| inference.factors.len() > 1)
}

/// What is said of a table with a single time.
const ONE_TIME: &str = "There is a single time, so only conditions are compared.";

/// The decimals of the paper's means and errors.
const DECIMALS: Option<usize> = Some(1);

/// The mean and error of a cell, with these decimals or those that give the error two digits.
fn mean(
    inference: &Inference,
    condition: &str,
    time: Option<&str>,
    decimals: Option<usize>,
) -> String {
    let time = level_of_time(inference, time);
    let levels: Vec<&str> = [condition].into_iter().chain(time).collect();
    let cell = inference.cells.iter().find(|it| it.levels == levels);
    let description = cell.and_then(|it| it.normalised.known());
    description.map_or_else(|| NONE.to_owned(), |it| mean_and_error(it.mean, it.sem, decimals))
}

fn mean_and_error(mean: f64, error: f64, decimals: Option<usize>) -> String {
    // The decimals with which an error, rounded, has two digits.
    let own = || (0_i32..6).find(|it| error * 10_f64.powi(*it) >= 9.95);
    let own = || own().and_then(|it| usize::try_from(it).ok());
    match decimals.or_else(own) {
        Some(decimals) => format!("{mean:.decimals$} ± {error:.decimals$}"),
        None => format!("{} ± {}", digits(mean), digits(error)),
    }
}

#[cfg(test)]
mod tests {
    use plumbline_analysis::physiology::bins::Window;

    use super::*;
    use crate::manifest::Study;
    use crate::measures;
    use crate::physiology::Quantity;
    use crate::sway::SwayFigure;
    use crate::values::TrialValues;

    fn study(conditions: [&str; 2]) -> Study {
        Study { conditions: conditions.map(str::to_owned).into(), ..Study::example() }
    }

    /// Two trials of each of the paper's participants under each condition, whose path lengths
    /// have the means and errors of its Table II.
    fn papers_sway() -> StudyFigures {
        let rows = paper::rows();
        let mut trials: Vec<TrialValues<SwayFigure>> = Vec::new();
        for participant in 0..paper::SUBJECTS {
            for condition in paper::CONDITIONS {
                for _ in 0..2 {
                    trials.push(TrialValues {
                        place: String::new(),
                        participant: format!("P{}", participant + 1),
                        condition: condition.to_owned(),
                        responses: Vec::new(),
                    });
                }
            }
        }
        for (point, first) in [("lower", 0), ("upper", 5)] {
            for (at, chosen) in measures::default_choice().into_iter().enumerate() {
                let direction = chosen.direction.word();
                let of_direction = &rows[3 * at..3 * at + 3];
                assert!(of_direction.iter().all(|row| row.0 == direction));
                let column =
                    |column: usize| of_direction.iter().map(move |row| row.1[first + column]);
                let means: Vec<f64> = column(0).chain(column(2)).collect();
                let sems: Vec<f64> = column(1).chain(column(3)).collect();
                let values = paper::study(&means, &sems);
                for (trial, it) in trials.iter_mut().enumerate() {
                    let (participant, condition) = (trial / 4, trial / 2 % 2);
                    // One trial is longer by as much as the other is shorter.
                    let more = if trial % 2 == 0 { 3.0 } else { -3.0 };
                    let cells = values.row(participant);
                    let lengths = cells.iter().skip(3 * condition).take(3);
                    let figure = SwayFigure::new(chosen, point);
                    it.responses.push((figure, lengths.map(|value| Ok(value + more)).collect()));
                }
            }
        }
        StudyFigures::of(&study(paper::CONDITIONS), &[], &trials, &[], Vec::new()).unwrap()
    }

    #[test]
    fn the_papers_table_2_is_shown_as_the_paper_has_it() {
        let figures = papers_sway();
        let table = &figures.parts()[0].tables[0];
        let headings: Vec<(&str, usize)> =
            table.groups.iter().map(|it| (&*it.name, it.columns.len())).collect();
        assert_eq!(headings, [("Lower trunk", 3), ("Upper trunk", 3)]);
        assert_eq!(table.groups[0].columns, ["control", "hyperventilation", "d"]);
        let mut printed = paper::rows().into_iter();
        let mut compared = 0;
        for section in &table.sections {
            for (time, cells) in &section.rows {
                let (direction, numbers) = printed.next().unwrap();
                assert_eq!(section.name.as_deref(), Some(direction));
                for (point, cells) in cells.chunks(3).enumerate() {
                    let [mean, sem, other_mean, other_sem, d] = numbers[5 * point..][..5] else {
                        panic!("ten numbers");
                    };
                    assert_eq!(
                        cells[0].text,
                        format!("{mean:.1} ± {sem:.1}"),
                        "{direction} {time}"
                    );
                    let other = format!("{other_mean:.1} ± {other_sem:.1}");
                    assert_eq!(cells[1].text, other, "{direction} {time}");
                    // The printed means and errors are rounded, which changes d by up to 0.016; two
                    // digits of d are shown.
                    let found: f64 = cells[2].text.parse().unwrap();
                    assert!((found - d).abs() < 0.016 + 0.005, "{direction} {time}: {found} {d}");
                    compared += 1;
                }
            }
        }
        assert_eq!((compared, printed.count()), (36, 0));
        let text = table.text();
        for part in ["Lower trunk", "hyperventilation", "AP T1", "T3: 40 to 60 s"] {
            assert!(text.contains(part), "no {part}: {text}");
        }
    }

    #[test]
    fn an_error_has_two_digits_or_the_papers_decimals() {
        let found = |mean, error| mean_and_error(mean, error, None);
        assert_eq!(found(139.24, 5.26), "139.2 ± 5.3");
        assert_eq!(found(367.3, 14.9), "367 ± 15");
        assert_eq!(found(1.8684, 0.0336), "1.868 ± 0.034");
        // 0.0996 is 0.10: a digit less.
        assert_eq!(found(2.163, 0.0996), "2.16 ± 0.10");
        assert_eq!(found(-1.2e-6, 3.1e-6), "-1.2e-6 ± 3.1e-6");
        assert_eq!(found(5.0, 0.0), "5.000 ± 0");
        assert_eq!(mean_and_error(1.07, 0.01, DECIMALS), "1.1 ± 0.0");
    }

    #[test]
    fn an_asterisk_is_a_difference_by_ranks() {
        let figures = papers_sway();
        let asterisks = figures.sway.iter().flat_map(|it| {
            let ranks =
                it.response.inference.comparisons.iter().filter(|it| it.factor == "condition");
            ranks.filter(|it| it.ranks.known().is_some_and(|it| it.p_bonferroni < 0.05))
        });
        let table = &figures.parts()[0].tables[0];
        let shown = table.text().matches(" *").count();
        assert_eq!(shown, asterisks.count() + 1, "and one in the note");
        // With these spreads a difference of d = 0.9 among fourteen people is significant, one of
        // 0.1 is not.
        let cells = &table.sections[0].rows;
        assert_eq!((&*cells[0].1[1].marks, &*cells[2].1[1].marks), ("*", ""));
    }

    /// Four participants; `cells` gives, by condition and time, each one's deviation from their own
    /// level.
    fn heart_rates(cells: [[f64; 4]; 6]) -> Vec<Cell> {
        let people = [("P1", 100.0), ("P2", 80.0), ("P3", 120.0), ("P4", 90.0)];
        let mut trials = Vec::new();
        for (at, condition) in ["control", "hypo"].into_iter().enumerate() {
            for (person, (participant, level)) in people.into_iter().enumerate() {
                let values = cells[3 * at..3 * at + 3].iter().map(|it| Ok(level + it[person]));
                trials.push(TrialValues {
                    place: String::new(),
                    participant: participant.to_owned(),
                    condition: condition.to_owned(),
                    responses: vec![(Quantity::HeartRate, values.collect())],
                });
            }
        }
        let window =
            |name: &str| Window { name: name.to_owned(), from: Event::Stance, span_s: 0.0..10.0 };
        let windows = ["baseline", "T1", "T2"].map(window);
        let study = study(["control", "hypo"]);
        let figures = StudyFigures::of(&study, &windows, &[], &trials, Vec::new()).unwrap();
        let tables = figures.physiology_tables();
        assert_eq!(tables[0].groups[1].name, "T1, 0 to 10 s (b)");
        assert_eq!((tables.len(), tables[0].notes.len(), tables[1].notes.len()), (2, 0, 3));
        assert_eq!(tables[0].sections[0].rows[0].0, "HR (bpm)");
        tables.iter().flat_map(|it| it.sections[0].rows[0].1.clone()).collect()
    }

    fn marks(cells: &[Cell]) -> Vec<&str> {
        cells.iter().map(|cell| &*cell.marks).collect()
    }

    #[test]
    fn marks_of_the_papers_table_1_are_those_of_the_tests() {
        let none = [1.0, -1.0, -1.0, 1.0];
        let cells = heart_rates([
            [0.0; 4],
            [19.0, 20.0, 21.0, 20.0],
            none,
            [9.0, 10.0, 11.0, 10.0],
            [20.0, 20.0, 21.0, 19.0],
            none.map(|it| -it),
        ]);
        // In the order of the times, control first.
        assert_eq!(marks(&cells), ["b", "*bc", "ac", "ac", "b", "ab"]);
        assert!(cells[2].text.starts_with("117.5 ± "), "{cells:?}");
    }

    #[test]
    fn differences_that_cannot_be_tested_are_not_marked() {
        let cells = heart_rates([[0.0; 4], [1.0; 4], [2.0; 4], [3.0; 4], [4.0; 4], [5.0; 4]]);
        assert_eq!(marks(&cells), [""; 6]);
    }
}
