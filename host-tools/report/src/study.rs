//! The report of a study.

use maud::{Markup, html};
use plumbline_files::BadInput;
use plumbline_study::figures::StudyFigures;
use plumbline_study::inference::COMPARED;
use plumbline_study::measures::MEASURES;
use plumbline_study::sway::SwayFigure;
use plumbline_study::tables::{PaperTable, titled};
use plumbline_trial::points::point_name;

use crate::page::{annotated, facts, figure, page, warnings};
use crate::plots::{self, Scale};

/// The page of a study.
///
/// # Errors
/// When a plot cannot be drawn.
pub fn report(figures: &StudyFigures) -> Result<String, BadInput> {
    let known = [
        ("participants", figures.participants_text()),
        ("conditions", figures.conditions.join(", ")),
    ];
    let parts = figures.parts();
    let plots = plots(figures)?;
    let body = html! {
        (facts(&known))
        (warnings(&figures.warnings))
        section {
            h2 { "By condition and time" }
            @for table in parts.iter().flat_map(|it| &it.tables) { (paper_table(table)) }
            p.method {
                "Means and SEM are without the differences between participants (Cousineau 2005, "
                "Morey 2008); d is the difference of two such means over the root of their mean "
                "variance."
            }
            @for line in figures.not_compared_lines() { p.method { (line) } }
        }
        @for plot in &plots { (plot) }
        section {
            h2 { "Effects" }
            @for part in &parts {
                (annotated(&format!("{}: effects on each response", part.title), &part.effects))
                @if let Some(adjusted) = &part.adjusted { p.method { (adjusted) } }
            }
            p.method {
                "ANOVA-type statistic: Brunner, Domhof and Langer (2002), by ranks, for data that "
                "are not normal. F: repeated-measures analysis of variance, corrected after "
                "Greenhouse and Geisser (1959) where it has more than one degree of freedom; "
                "Mauchly's test of sphericity; Shapiro and Wilk's of the residuals."
            }
        }
        section {
            h2 { "Comparisons of conditions" }
            @for part in &parts {
                (annotated(&format!("{}: each condition against the first", part.title), &part.comparisons))
            }
            p.method { (COMPARED) }
        }
    };
    let participants = figures.participants.join(", ");
    Ok(page(&figures.title, &format!("Participants {participants}"), &body))
}

/// Means and errors of every response.
fn plots(figures: &StudyFigures) -> Result<Vec<Markup>, BadInput> {
    let mut sections = Vec::new();
    let mut section = |title: &str, charts: Vec<Markup>| {
        if !charts.is_empty() {
            sections.push(html! {
                section {
                    h2 { (title) }
                    div.row { @for chart in &charts { (chart) } }
                }
            });
        }
    };
    let mut charts = Vec::new();
    for it in &figures.physiology {
        let (name, unit) = it.quantity.name_and_unit();
        let svg = plots::means(
            &it.response.inference,
            name,
            &format!("{name} ({unit})"),
            Scale::OfTheData,
        )?;
        charts.extend(svg.map(|svg| figure(&svg, &format!("{name}: mean ± SEM"))));
    }
    section("Physiology", charts);
    for measure in MEASURES.iter().filter(|it| it.is_by_time()) {
        for point in figures.points() {
            let mut charts = Vec::new();
            let own = figures.sway.iter().filter(|it| it.figure.point == point);
            for it in own.filter(|it| it.figure.figure == measure.name) {
                let SwayFigure { figure: name, unit, direction, .. } = &it.figure;
                let axis = format!("{name} ({unit})");
                let svg = plots::means(&it.response.inference, direction, &axis, Scale::FromZero)?;
                let caption = format!("{}, {direction}: {name}, mean ± SEM", point_name(point));
                charts.extend(svg.map(|svg| figure(&svg, &caption)));
            }
            section(&format!("{}: {}", titled(measure.name), point_name(point)), charts);
        }
    }
    Ok(sections)
}

/// In the paper's layout: groups of columns, and a rule after each section of rows.
fn paper_table(table: &PaperTable) -> Markup {
    html! {
        div.table {
            p.caption { (table.title) }
            div.wide {
                table.paper aria-label=(table.title) {
                thead {
                    tr {
                        @for name in &table.stub { th scope="col" rowspan="2" { (name) } }
                        @for group in &table.groups {
                            th.group scope="colgroup" colspan=(group.columns.len()) { (group.name) }
                        }
                    }
                    tr {
                        @for column in table.groups.iter().flat_map(|group| &group.columns) {
                            th scope="col" { (column) }
                        }
                    }
                }
                @for section in &table.sections {
                    tbody {
                        @for (at, (name, cells)) in section.rows.iter().enumerate() {
                            tr {
                                @if let Some(section_name) = &section.name && at == 0 {
                                    th scope="rowgroup" rowspan=(section.rows.len()) { (section_name) }
                                }
                                th scope="row" { (name) }
                                @for cell in cells { td { (cell.text) sup { (cell.marks) } } }
                            }
                        }
                    }
                }
                }
            }
        }
        @if !table.notes.is_empty() {
            ul.notes { @for note in &table.notes { li { (note) } } }
        }
    }
}
