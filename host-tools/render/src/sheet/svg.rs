//! Pages as SVG at true scale: one user unit is a millimetre.

use svg::Document;
use svg::node::element::{Line, Polygon, Rectangle, Text, Title};

use super::page::{Font, Page, Shape, Stroke};

/// The text of the SVG file.
#[must_use]
pub fn document(page: &Page, title: &str) -> String {
    let [width, height] = page.size_mm;
    let paper = Rectangle::new().set("width", width).set("height", height).set("fill", "white");
    let document = Document::new()
        .set("width", format!("{width}mm"))
        .set("height", format!("{height}mm"))
        .set("viewBox", (0, 0, width, height))
        .add(Title::new(title))
        .add(paper);
    page.shapes.iter().fold(document, drawn).to_string()
}

/// Rounded to a nanometre: anything finer is rounding noise.
fn rounded(value_mm: f64) -> f64 {
    (value_mm * 1e6).round() / 1e6
}

fn drawn(document: Document, shape: &Shape) -> Document {
    match shape {
        Shape::Filled(rectangle) => {
            let ([x, y], [width, height]) =
                (rectangle.corner.map(rounded), rectangle.size.map(rounded));
            document.add(
                Rectangle::new().set("x", x).set("y", y).set("width", width).set("height", height),
            )
        }
        Shape::Polygon(points) => {
            let points: Vec<f64> = points.iter().flatten().copied().map(rounded).collect();
            document.add(Polygon::new().set("points", points))
        }
        Shape::Line { ends, stroke } => {
            let [[x0, y0], [x1, y1]] = ends.map(|end| end.map(rounded));
            let grey = (stroke.grey() * 255.0).round() as u8;
            let mut line = Line::new().set("x1", x0).set("y1", y0).set("x2", x1).set("y2", y1);
            line = line
                .set("stroke", format!("#{grey:02x}{grey:02x}{grey:02x}"))
                .set("stroke-width", Stroke::WIDTH_MM);
            if *stroke == Stroke::Cut {
                line = line.set("stroke-dasharray", Stroke::DASH_MM.to_vec());
            }
            document.add(line)
        }
        Shape::Text { start, size_mm, font, upwards, text } => {
            let [x, y] = start.map(rounded);
            let (family, weight) = match font {
                Font::Regular => ("Helvetica, Arial, sans-serif", "normal"),
                Font::Bold => ("Helvetica, Arial, sans-serif", "bold"),
                Font::Mono => ("Courier, 'Courier New', monospace", "normal"),
            };
            let turn = if *upwards { " rotate(-90)" } else { "" };
            document.add(
                Text::new(text)
                    .set("transform", format!("translate({x} {y}){turn}"))
                    .set("font-family", family)
                    .set("font-weight", weight)
                    .set("font-size", rounded(*size_mm)),
            )
        }
    }
}
