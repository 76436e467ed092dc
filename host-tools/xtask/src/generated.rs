//! Parts of documents that are written by tasks: the lines between `<!-- name -->` and `<!-- /name
//! -->`.

use std::fs;

use anyhow::{Context, Result};

use crate::command::root;

/// The location of such a part.
pub struct Part<'a> {
    /// The document's path, relative to the root.
    pub document: &'a str,
    /// The name in the markers.
    pub name: &'a str,
}

impl Part<'_> {
    /// The current text of the part.
    pub fn read(&self) -> Result<String> {
        let [_, part, _] =
            split(&self.text()?, self.name).with_context(|| self.document.to_owned())?;
        Ok(part)
    }

    /// Replaces the part with `text`.
    pub fn write(&self, text: &str) -> Result<()> {
        let [before, _, after] =
            split(&self.text()?, self.name).with_context(|| self.document.to_owned())?;
        fs::write(root().join(self.document), format!("{before}{text}{after}"))
            .with_context(|| self.document.to_owned())?;
        println!("written to {}", self.document);
        Ok(())
    }

    fn text(&self) -> Result<String> {
        fs::read_to_string(root().join(self.document)).with_context(|| self.document.to_owned())
    }
}

/// The text before the part with the opening marker, the part, and the text from the closing marker
/// on.
fn split(text: &str, name: &str) -> Result<[String; 3]> {
    let [begin, end] = [format!("<!-- {name} -->\n"), format!("\n<!-- /{name} -->")];
    let place = text.find(&begin).map(|place| place + begin.len());
    let parts = place.and_then(|place| {
        let (before, rest) = text.split_at(place);
        let (part, after) = rest.split_at(rest.find(&end)?);
        Some([before, part, after].map(str::to_owned))
    });
    parts.with_context(|| format!("there is no <!-- {name} --> ... <!-- /{name} -->"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_between_the_markers_is_the_part() {
        let text = "before\n<!-- bench -->\nold\nlines\n<!-- /bench -->\nafter\n";
        let [before, part, after] = split(text, "bench").unwrap();
        assert_eq!(part, "old\nlines");
        let changed = format!("{before}new{after}");
        assert_eq!(changed, "before\n<!-- bench -->\nnew\n<!-- /bench -->\nafter\n");
        let error = split("no markers", "bench").unwrap_err().to_string();
        assert!(error.contains("<!-- /bench -->"), "{error}");
    }
}
