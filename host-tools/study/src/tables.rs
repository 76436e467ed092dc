//! A study's figures in tables like the paper's.

use std::fmt;

use plumbline_analysis::physiology::bins::Event;
use plumbline_analysis::statistics::inference::{Inference, SIGNIFICANT};
use plumbline_trial::points::point_name;

use crate::figures::{PathLength, StudyFigures, TimeWindow};
use crate::grid::Grid;
use crate::sway::DIRECTIONS;
use crate::time::time_name;

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
    pub name: Option<&'static str>,
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
                let name = section.name.map_or_else(|| name.clone(), |it| format!("{it} {name}"));
                [name].into_iter().chain(cells.iter().map(Cell::to_string)).collect()
            })
        });
        let grid = Grid { header, rows: rows.collect() };
        format!("{}\n{}{}\n", self.title, grid.text(), self.notes.join("\n"))
    }
}

impl StudyFigures {
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
                    text: mean(&it.inference, condition, time),
                    marks: self.physiology_marks(&it.inference, condition, time),
                };
                self.conditions.iter().map(of_condition).collect::<Vec<_>>()
            });
            (format!("{name} ({unit})"), cells.collect())
        });
        Section { name: None, rows: rows.collect() }
    }

    fn physiology_notes(&self) -> Vec<String> {
        let control = &self.conditions[0];
        let from_transition = self.windows.iter().filter(|it| it.from == Event::Transition);
        let from_transition = from_transition
            .map(|it| format!(" (of the {} from when the person begins to rise)", it.name));
        vec![
            format!(
                "Mean ± SEM; seconds from t = 0{}. * differs from {control} at that time; a \
                 letter: differs from that time under the same condition (paired t tests, p < \
                 {SIGNIFICANT} after Bonferroni's correction, for the times and for the pairs of \
                 times).",
                from_transition.collect::<String>()
            ),
            "HR: heart rate. MAP, SBP, DBP: mean, systolic, diastolic arterial pressure. SV: \
             stroke volume. CO: cardiac output. CBFv: cerebral blood flow velocity. TSI: tissue \
             saturation index. PETCO2: end-tidal partial pressure of CO2."
                .to_owned(),
        ]
    }

    /// The paper's Table II: total path length by direction and time; for each point the conditions
    /// side by side, with Cohen's d of each against the first.
    #[must_use]
    pub fn sway_table(&self) -> PaperTable {
        let points = self.points();
        let control = &self.conditions[0];
        let several = self.conditions.len() > 2;
        let groups = points.iter().map(|point| {
            let others = self.conditions[1..].iter().flat_map(|condition| {
                let d = if several { format!("d ({condition})") } else { "d".to_owned() };
                [condition.clone(), d]
            });
            let columns = [control.clone()].into_iter().chain(others).collect();
            Group { name: point_name(point).to_owned(), columns }
        });
        let sections = DIRECTIONS.into_iter().filter_map(|direction| {
            let of_point = |point: &&str| {
                let mut lengths = self.path_lengths.iter();
                lengths.find(|it| it.path.point == **point && it.path.direction == direction)
            };
            let lengths: Vec<Option<&PathLength>> = points.iter().map(of_point).collect();
            lengths.iter().any(Option::is_some).then(|| Section {
                name: Some(direction),
                rows: (0..self.bins_s.len())
                    .map(|at| {
                        let time = time_name(at);
                        let cells = lengths.iter().flat_map(|it| self.sway_cells(*it, &time));
                        (time.clone(), cells.collect())
                    })
                    .collect(),
            })
        });
        let bins = self.bins_s.iter().enumerate();
        let times: Vec<String> =
            bins.map(|(at, [from, to])| format!("{}: {from} to {to} s", time_name(at))).collect();
        let notes = vec![
            format!("Mean ± SEM, mm. {}.", times.join("; ")),
            format!(
                "d: Cohen's d of the condition against {control}. * differs from {control} at \
                 that time (by ranks: ANOVA-type statistic, p < {SIGNIFICANT} after Bonferroni's \
                 correction for all conditions and times)."
            ),
            "AP: anterior-posterior; ML: medial-lateral; SI: superior-inferior; APML, APSI, MLSI: \
             in the transverse, sagittal and coronal plane."
                .to_owned(),
        ];
        PaperTable {
            title: "Total path length (mm)".to_owned(),
            stub: vec!["direction", "time"],
            groups: groups.collect(),
            sections: sections.collect(),
            notes,
        }
    }

    /// The points of the body, in the order of the tables.
    #[must_use]
    pub fn points(&self) -> Vec<&str> {
        let mut points: Vec<&str> =
            self.path_lengths.iter().map(|it| it.path.point.as_str()).collect();
        points.dedup();
        points
    }

    /// The asterisk and letters of a cell of Table I.
    fn physiology_marks(&self, inference: &Inference, condition: &str, time: &str) -> String {
        let mut marks = String::new();
        let differs = inference.comparison([&self.conditions[0], condition], Some(time));
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

    fn sway_cells(&self, length: Option<&PathLength>, time: &str) -> Vec<Cell> {
        let unmarked = |text: String| Cell { text, marks: String::new() };
        let Some(PathLength { inference, .. }) = length else {
            return vec![unmarked(NONE.to_owned()); 2 * self.conditions.len() - 1];
        };
        let control = &self.conditions[0];
        let mut cells = vec![unmarked(mean(inference, control, time))];
        for condition in &self.conditions[1..] {
            let comparison = inference.comparison([control, condition], Some(time));
            let p = comparison.and_then(|it| Some(it.ranks.known()?.p_bonferroni));
            let marks = if p.is_some_and(|p| p < SIGNIFICANT) { "*" } else { "" };
            let d = comparison.and_then(|it| it.d.known());
            cells.push(Cell { text: mean(inference, condition, time), marks: marks.to_owned() });
            cells.push(unmarked(d.map_or_else(|| NONE.to_owned(), |d| format!("{d:.2}"))));
        }
        cells
    }
}

/// The letter of a time in Table I: `a` for the first; times after `z` have none.
fn letter(time: usize) -> char {
    u8::try_from(time)
        .ok()
        .and_then(|it| b'a'.checked_add(it))
        .filter(u8::is_ascii_lowercase)
        .map_or('?', char::from)
}

/// The mean and error of a cell, in the paper's format.
fn mean(inference: &Inference, condition: &str, time: &str) -> String {
    let cell = inference.cells.iter().find(|it| it.levels == [condition, time]);
    let description = cell.and_then(|it| it.normalised.known());
    description.map_or_else(|| NONE.to_owned(), |it| format!("{:.1} ± {:.1}", it.mean, it.sem))
}

#[cfg(test)]
mod tests {
    use plumbline_analysis::physiology::bins::Window;

    use super::*;
    use crate::manifest::Study;
    use crate::physiology::Quantity;
    use crate::sway::Path;
    use crate::values::TrialValues;
    use crate::verdict::Unusable;

    fn study(conditions: [&str; 2]) -> Study {
        Study {
            place: "study.toml".to_owned(),
            title: "The paper's".to_owned(),
            conditions: conditions.map(str::to_owned).into(),
            bins_s: vec![0.0..20.0, 20.0..40.0, 40.0..60.0],
            drop_incomplete: false,
            unusable: Unusable::default(),
            physiology: None,
            trials: Vec::new(),
        }
    }

    /// Two trials of each of the paper's participants under each condition, whose path lengths
    /// have the means and errors of its Table II.
    fn papers_sway() -> StudyFigures {
        let rows = paper::rows();
        let mut trials: Vec<TrialValues<Path>> = Vec::new();
        for participant in 0..paper::SUBJECTS {
            for condition in paper::CONDITIONS {
                for _ in 0..2 {
                    trials.push(TrialValues {
                        participant: format!("P{}", participant + 1),
                        condition: condition.to_owned(),
                        responses: Vec::new(),
                    });
                }
            }
        }
        for (point, first) in [("lower", 0), ("upper", 5)] {
            for (at, direction) in DIRECTIONS.into_iter().enumerate() {
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
                    let path = Path { point: point.to_owned(), direction };
                    it.responses.push((path, lengths.map(|value| Some(value + more)).collect()));
                }
            }
        }
        StudyFigures::of(&study(paper::CONDITIONS), &[], &trials, &[], Vec::new()).unwrap()
    }

    #[test]
    fn the_papers_table_2_is_shown_as_the_paper_has_it() {
        let figures = papers_sway();
        let table = figures.sway_table();
        let headings: Vec<(&str, usize)> =
            table.groups.iter().map(|it| (&*it.name, it.columns.len())).collect();
        assert_eq!(headings, [("Lower trunk", 3), ("Upper trunk", 3)]);
        assert_eq!(table.groups[0].columns, ["control", "hyperventilation", "d"]);
        let mut printed = paper::rows().into_iter();
        let mut compared = 0;
        for section in &table.sections {
            for (time, cells) in &section.rows {
                let (direction, numbers) = printed.next().unwrap();
                assert_eq!(section.name, Some(direction));
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
    fn an_asterisk_is_a_difference_by_ranks() {
        let figures = papers_sway();
        let asterisks = figures.path_lengths.iter().flat_map(|it| {
            let ranks = it.inference.comparisons.iter().filter(|it| it.factor == "condition");
            ranks.filter(|it| it.ranks.known().is_some_and(|it| it.p_bonferroni < 0.05))
        });
        let shown = figures.sway_table().text().matches(" *").count();
        assert_eq!(shown, asterisks.count() + 1, "and one in the note");
        // With these spreads a difference of d = 0.9 among fourteen people is significant, one of
        // 0.1 is not.
        let cells = &figures.sway_table().sections[0].rows;
        assert_eq!((&*cells[0].1[1].marks, &*cells[2].1[1].marks), ("*", ""));
    }

    /// Four participants; `cells` gives, by condition and time, each one's deviation from their own
    /// level.
    fn heart_rates(cells: [[f64; 4]; 6]) -> Vec<Cell> {
        let people = [("P1", 100.0), ("P2", 80.0), ("P3", 120.0), ("P4", 90.0)];
        let mut trials = Vec::new();
        for (at, condition) in ["control", "hypo"].into_iter().enumerate() {
            for (person, (participant, level)) in people.into_iter().enumerate() {
                let values = cells[3 * at..3 * at + 3].iter().map(|it| Some(level + it[person]));
                trials.push(TrialValues {
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
        assert_eq!((tables.len(), tables[0].notes.len(), tables[1].notes.len()), (2, 0, 2));
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
