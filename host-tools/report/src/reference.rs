//! A trial's figures beside the bands of a reference.

use maud::{Markup, html};
use plotters::style::RGBColor;
use plumbline_analysis::statistics::quantiles::{CONFIDENCE, Quantile};
use plumbline_files::counting::counted;
use plumbline_study::grid::digits;
use plumbline_study::reference::{Band, Comparison, PARTICIPANTS_ADVISED, Placed};

use crate::palette::{GAP, INK, ORANGE, SOFT, hex};

/// The picture of a figure, px.
const WIDTH_PX: f64 = 240.0;
const HEIGHT_PX: f64 = 38.0;

/// Free at either end, as a share of what is shown.
const MARGIN: f64 = 0.08;

/// The top and the bottom of the bands.
const BAND_PX: [f64; 2] = [4.0, 18.0];

/// Where the bars of the percentiles' uncertainty are, one below the other: they overlap.
const BAR_PX: f64 = 23.0;
const BARS_APART_PX: f64 = 3.0;

/// The section.
pub fn section(comparison: &Comparison) -> Markup {
    html! {
        section {
            h2 { "Beside a reference" }
            @if let Some(first) = comparison.placed.first() {
                (placed(&comparison.placed))
                p.method { (about(first, &comparison.placed)) }
            }
            @if !comparison.absent.is_empty() {
                ul.notes { @for reason in &comparison.absent { li { "Not shown: " (reason) "." } } }
            }
        }
    }
}

/// What the pictures show, and of whom.
fn about(first: &Placed, all: &[Placed]) -> Markup {
    let Band { condition, .. } = &first.band;
    let participants: Vec<usize> = all.iter().map(|it| it.band.participants).collect();
    let fewest = participants.iter().copied().min().unwrap_or(0);
    let most = participants.iter().copied().max().unwrap_or(0);
    let who = if fewest == most {
        counted(fewest, "participant")
    } else {
        format!("{fewest} to {most} participants")
    };
    let is_open = |it: &Quantile| it.low.is_none() || it.high.is_none();
    let has_open = all.iter().any(|it| it.percentiles.iter().any(is_open));
    html! {
        "The reference: " (who) " " (first.band.ages()) ", " (condition) ", one value for each. "
        "Light: from the 5th to the 95th percentile; dark: from the 25th to the 75th; line: the median; "
        "diamond: this trial. Bars below: where each percentile lies, from the 5th down to the 95th, with a \
         confidence of "
        (100.0 * CONFIDENCE) " %"
        @if has_open { "; none where there are too few participants for a bound" }
        ". "
        @if fewest < PARTICIPANTS_ADVISED {
            strong { (who) " are few: " (PARTICIPANTS_ADVISED) " are recommended. " }
        }
        "Percentiles after Harrell and Davis (1982), their confidence by order statistics. A place outside "
        "the band is no diagnosis: one of ten of these participants lies there."
    }
}

fn placed(all: &[Placed]) -> Markup {
    let header = ["figure", "this trial", "5th", "median", "95th", ""];
    html! {
        div.table {
            p.caption { "Figures of this trial among those of the reference" }
            div.wide {
                table aria-label="Figures of this trial among those of the reference" {
                    thead {
                        tr {
                            @for cell in header { th scope="col" { (cell) } }
                            th scope="col" style="text-align: left" { "where it lies" }
                        }
                    }
                    tbody {
                        @for it in all {
                            tr {
                                th scope="row" { (name(it)) }
                                td { (digits(it.value)) }
                                @for at in [0, 2, 4] { td { (digits(it.percentiles[at].value)) } }
                                td { (picture(it)) }
                                td style="text-align: left; white-space: normal" { (it.words()) }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn name(it: &Placed) -> String {
    let what = &it.band.what;
    let unit = if it.band.unit.is_empty() { String::new() } else { format!(" ({})", it.band.unit) };
    format!("{} trunk, {} {}{unit}", what.trunk, what.figure, what.direction)
}

/// The band, and the trial's mark over it.
fn picture(it: &Placed) -> Markup {
    let all = it.percentiles.iter();
    let bounds = all.clone().flat_map(|it| [Some(it.value), it.low, it.high]).flatten();
    let shown = bounds.chain([it.value]);
    let (low, high) = shown
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), it| (low.min(it), high.max(it)));
    // Of a figure that is the same in everybody, all is in the middle.
    let span = if high > low { high - low } else { 1.0 };
    let x = |value: f64| {
        let share = (value - low) / span;
        WIDTH_PX * (MARGIN + (1.0 - 2.0 * MARGIN) * share)
    };
    let band = |from: usize, to: usize, colour: RGBColor| {
        let (left, right) = (x(it.percentiles[from].value), x(it.percentiles[to].value));
        let [top, bottom] = BAND_PX;
        html! {
            rect x=(px(left)) y=(px(top)) width=(px((right - left).max(1.0))) height=(px(bottom - top))
                fill=(hex(colour)) {}
        }
    };
    let line = |from: (f64, f64), to: (f64, f64), width: f64| {
        html! {
            line x1=(px(from.0)) y1=(px(from.1)) x2=(px(to.0)) y2=(px(to.1)) stroke=(hex(INK))
                stroke-width=(px(width)) {}
        }
    };
    let median = x(it.percentiles[2].value);
    let (mark, middle) = (x(it.value), f64::midpoint(BAND_PX[0], BAND_PX[1]));
    let points = [(0.0, -8.0), (6.0, 0.0), (0.0, 8.0), (-6.0, 0.0)]
        .map(|(dx, dy)| format!("{},{}", px(mark + dx), px(middle + dy)))
        .join(" ");
    let words = format!("{}: {} {}", name(it), digits(it.value), it.words());
    html! {
        svg viewBox=(format!("0 0 {WIDTH_PX} {HEIGHT_PX}")) width=(WIDTH_PX) height=(HEIGHT_PX) role="img"
            aria-label=(words) {
            (band(0, 4, GAP))
            (band(1, 3, SOFT))
            (line((median, BAND_PX[0]), (median, BAND_PX[1]), 2.0))
            @for (at, it) in (0..).zip(all) {
                @if let Some((low, high)) = it.low.zip(it.high) {
                    @let y = BAR_PX + BARS_APART_PX * f64::from(at);
                    (line((x(low), y), (x(high), y), 1.0))
                    (line((x(it.value), y - 1.5), (x(it.value), y + 1.5), 2.0))
                }
            }
            polygon points=(points) fill=(hex(ORANGE)) stroke=(hex(plotters::style::WHITE)) stroke-width="1" {}
        }
    }
}

fn px(value: f64) -> String {
    format!("{value:.1}")
}

#[cfg(test)]
mod tests {
    use plumbline_study::fixture::band;

    use super::*;

    fn placed_at(value: f64, participants: u32) -> Placed {
        let values: Vec<f64> = (1..=participants).map(f64::from).collect();
        let band = band(values);
        let percentiles = band.percentiles.unwrap();
        Placed { band, percentiles, value }
    }

    #[test]
    fn a_trial_is_seen_and_said_and_few_participants_are_said() {
        let of = |it: Placed| {
            section(&Comparison { placed: vec![it], absent: vec!["no age".to_owned()] })
                .into_string()
        };
        let page = of(placed_at(70.0, 200));
        for part in [
            "lower trunk, RMS AP (mm)",
            "between the 25th and the 50th percentile",
            "200 participants aged 40 to below 60, calm, one value for each",
            "Not shown: no age.",
            "<polygon",
        ] {
            assert!(page.contains(part), "no {part}: {page}");
        }
        assert!(!page.contains("are few") && !page.contains("too few"), "{page}");
        let page = of(placed_at(99.0, 30));
        for part in [
            "30 participants are few: 120",
            "above the 95th percentile",
            "none where there are too few",
        ] {
            assert!(page.contains(part), "no {part}: {page}");
        }
        // What lies far outside is still within the picture.
        let page = of(placed_at(1e6, 200));
        assert!(page.contains("points=\"220.8,3.0"), "{page}");
    }
}
