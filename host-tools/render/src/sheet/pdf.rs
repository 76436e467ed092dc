//! Pages as a PDF at true scale.
//!
//! Written with pdf-writer: it is well maintained (Typst's PDFs come from it), has no `unsafe` and
//! needs no additional crate. krilla needs a newer Rust than ours, printpdf includes an HTML layout
//! engine, and svg2pdf a whole renderer. The fonts are three of PDF's standard fourteen, which
//! every viewer has; their text can be selected and copied.

use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str, TextStr};

use super::page::{Font, Page, Shape, Stroke};

const POINTS_PER_MM: f64 = 72.0 / 25.4;

const FONTS: [(Font, Name<'_>, Name<'_>); 3] = [
    (Font::Regular, Name(b"Regular"), Name(b"Helvetica")),
    (Font::Bold, Name(b"Bold"), Name(b"Helvetica-Bold")),
    (Font::Mono, Name(b"Mono"), Name(b"Courier")),
];

/// The file's bytes.
#[must_use]
pub fn document(pages: &[Page], title: &str) -> Vec<u8> {
    let mut free = Ref::new(1);
    let mut next = || free.bump();
    let [catalog, tree, info] = [next(), next(), next()];
    let fonts = FONTS.map(|(_, name, base)| (name, base, next()));
    let pages: Vec<(&Page, Ref, Ref)> = pages.iter().map(|page| (page, next(), next())).collect();

    let mut pdf = Pdf::new();
    let mut root = pdf.catalog(catalog);
    root.pages(tree);
    // Asks the viewer's print dialog for 100 %; not every viewer complies.
    root.viewer_preferences().pair(Name(b"PrintScaling"), Name(b"None"));
    root.finish();
    pdf.document_info(info).title(TextStr(title)).creator(TextStr("plumb target"));
    pdf.pages(tree)
        .kids(pages.iter().map(|(_, page, _)| *page))
        .count(pages.len().try_into().unwrap_or(i32::MAX));
    for (_, base, font) in fonts {
        pdf.type1_font(font).base_font(base).encoding_predefined(Name(b"WinAnsiEncoding"));
    }
    for (page, id, content) in pages {
        let [width, height] = page.size_mm.map(|side| (side * POINTS_PER_MM) as f32);
        let mut written = pdf.page(id);
        written.parent(tree).media_box(Rect::new(0.0, 0.0, width, height)).contents(content);
        let mut resources = written.resources();
        let mut named = resources.fonts();
        for (name, _, font) in fonts {
            named.pair(name, font);
        }
        named.finish();
        resources.finish();
        written.finish();
        pdf.stream(content, &drawn(page, height));
    }
    pdf.finish()
}

fn drawn(page: &Page, height_points: f32) -> Vec<u8> {
    let mut content = Content::new();
    // From millimetres, y down.
    let scale = POINTS_PER_MM as f32;
    content.transform([scale, 0.0, 0.0, -scale, 0.0, height_points]);
    for shape in &page.shapes {
        draw(shape, &mut content);
    }
    content.finish().to_vec()
}

fn draw(shape: &Shape, content: &mut Content) {
    let single = |[x, y]: [f64; 2]| (x as f32, y as f32);
    match shape {
        Shape::Filled(rectangle) => {
            let ((x, y), (width, height)) = (single(rectangle.corner), single(rectangle.size));
            content.rect(x, y, width, height).fill_nonzero();
        }
        Shape::Polygon(points) => {
            for (index, (x, y)) in points.iter().copied().map(single).enumerate() {
                if index == 0 {
                    content.move_to(x, y)
                } else {
                    content.line_to(x, y)
                };
            }
            content.close_path().fill_nonzero();
        }
        Shape::Line { ends, stroke } => {
            content.save_state().set_line_width(Stroke::WIDTH_MM as f32);
            content.set_stroke_gray(stroke.grey() as f32);
            if *stroke == Stroke::Cut {
                content.set_dash_pattern(Stroke::DASH_MM.map(|part| part as f32), 0.0);
            }
            let [(x0, y0), (x1, y1)] = ends.map(single);
            content.move_to(x0, y0).line_to(x1, y1).stroke().restore_state();
        }
        Shape::Text { start, size_mm, font, upwards, text } => {
            let (x, y) = single(*start);
            // Letters stand upright although y points down.
            let matrix =
                if *upwards { [0.0, -1.0, -1.0, 0.0, x, y] } else { [1.0, 0.0, 0.0, -1.0, x, y] };
            let named = FONTS.iter().find(|(one, ..)| one == font);
            let (_, name, _) = named.expect("all fonts are listed");
            // Latin-1 has the same codes in WinAnsi.
            let codes: Vec<u8> =
                text.chars().map(|letter| u8::try_from(letter).unwrap_or(b'?')).collect();
            content.begin_text().set_font(*name, *size_mm as f32).set_text_matrix(matrix);
            content.show(Str(&codes)).end_text();
        }
    }
}
