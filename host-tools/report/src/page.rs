//! The page that every report is: one file, readable offline, by day, by night and on paper.

use maud::{DOCTYPE, Markup, PreEscaped, html};
use plotters::style::RGBColor;
use plumbline_study::grid::Annotated;

use crate::palette::{dark_style, hex};

/// Its look, but for the colours of the plots.
const STYLE: &str = include_str!("style.css");

/// A page.
pub fn page(title: &str, subtitle: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) " – Plumbline" }
                style { (PreEscaped(STYLE)) (PreEscaped(dark_style())) }
            }
            body {
                header {
                    h1 { (title) }
                    p.subtitle { (subtitle) }
                }
                main { (body) }
                footer { "Made by plumb " (env!("CARGO_PKG_VERSION")) ", all lengths in millimetres." }
            }
        }
    };
    page.into_string()
}

/// The page that stands where a report could not be made.
pub fn not_made(place: &str, found: &str, remedy: &str) -> String {
    let body = html! {
        p { strong { (place) ": " } (found) }
        p { (remedy) }
    };
    page("No report", "It could not be made.", &body)
}

/// A plot with what it shows, in words too.
pub fn figure(svg: &str, caption: &str) -> Markup {
    html! {
        figure role="img" aria-label=(caption) {
            div.plot { (PreEscaped(svg)) }
            figcaption { (caption) }
        }
    }
}

/// Which colour is which, in all plots.
pub fn key(entries: &[(RGBColor, String)]) -> Markup {
    html! {
        p.key {
            @for (colour, name) in entries {
                span {
                    svg viewBox="0 0 22 6" aria-hidden="true" {
                        rect width="22" height="6" fill=(hex(*colour)) {}
                    }
                    (name)
                }
            }
        }
    }
}

/// A table: a header, rows of which the first cell is a name, and what it says.
pub fn table(caption: &str, header: &[String], rows: &[Vec<String>]) -> Markup {
    html! {
        div.table {
            // Beside the table, which is scrolled where it is wider than the page.
            p.caption { (caption) }
            div.wide {
                table aria-label=(caption) {
                    thead { tr { @for cell in header { th scope="col" { (cell) } } } }
                    tbody {
                        @for row in rows {
                            tr {
                                @for (at, cell) in row.iter().enumerate() {
                                    @if at == 0 { th scope="row" { (cell) } } @else { td { (cell) } }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// A table with the reasons for what is absent below it.
pub fn annotated(caption: &str, it: &Annotated) -> Markup {
    html! {
        (table(caption, &it.grid.header, &it.grid.rows))
        @if !it.notes.is_empty() {
            ul.notes { @for note in &it.notes { li { (note) } } }
        }
    }
}

/// Names and what they are.
pub fn facts(facts: &[(impl AsRef<str>, String)]) -> Markup {
    html! {
        dl.facts {
            @for (name, value) in facts {
                div { dt { (name.as_ref()) } dd { (value) } }
            }
        }
    }
}

/// What a reader has to know before anything else.
pub fn warnings(warnings: &[String]) -> Markup {
    html! {
        @if !warnings.is_empty() {
            section.warnings {
                h2 { "To be noted" }
                ul { @for warning in warnings { li { (warning) } } }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::palette::ON_DARK_PAPER;

    #[test]
    fn plots_lie_on_the_paper_of_their_page() {
        let papers = STYLE.lines().filter_map(|line| line.trim().strip_prefix("--paper: "));
        let papers: Vec<String> = papers.map(str::to_uppercase).collect();
        let dark = format!("{};", hex(ON_DARK_PAPER));
        assert_eq!(papers, ["#FFFFFF;", &dark, "#FFFFFF;"]);
    }
}
