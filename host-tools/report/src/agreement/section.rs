//! How well a trial agrees with motion capture, as a part of its report.

use maud::{Markup, html};
use plumbline_files::BadInput;

use super::{Validation, plot, print};
use crate::page::{annotated, facts, figure};

/// The section of a trial that was compared with a reference.
///
/// # Errors
/// When a plot cannot be drawn.
pub(crate) fn section(validation: &Validation) -> Result<Markup, BadInput> {
    let mut known = Vec::new();
    for pair in &validation.pairs {
        known.push(("reference", pair.reference.clone()));
        known.push(("point", format!("{} trunk", pair.point.word())));
        known.push(("clocks", pair.alignment()));
        known.push(("compared", format!("{} samples over {:.1} s", pair.samples, pair.length_s)));
    }
    let mut plots = Vec::new();
    for axis in &validation.axes {
        let [differences, regression] = plot::of_axis(validation, axis)?;
        let axis = axis.axis;
        plots.push((
            figure(&differences, &format!("{axis}, Bland-Altman: bias and 95 % limits of agreement, with their 95 % confidence intervals as bands")),
            figure(&regression, &format!("{axis}, camera over reference, with the regression line")),
        ));
    }
    Ok(html! {
        section {
            h2 { "Agreement with motion capture" }
            (facts(&known))
            (annotated("Camera less reference, with 95 % confidence intervals", &print::table(validation)))
            @for (differences, regression) in &plots { div.pair { (differences) (regression) } }
            p.method {
                "The reference was brought to the camera's clock and, by linear interpolation, to "
                "its times; nothing was interpolated over gaps. "
                @if validation.origins_aligned {
                    "The means of both were taken off: the bias is 0 by construction. "
                }
                "Limits of agreement: bias ± 1.96 SD (Bland and Altman 1999), their intervals "
                "after Carkeet (2015). Proportional error: the slope of the differences over the "
                "means. Intervals go by the effective number of samples: samples of a movement "
                "taken many times per second are not independent. Unfiltered positions."
            }
        }
    })
}
