//! What the page is made of.

use std::path::{Path, PathBuf};

use plumbline_test_support::root;

use crate::stage::{Stage, nothing_is_asked};

#[test]
fn what_is_drawn_is_what_came_and_what_is_typed_is_read() {
    let Some(stage) = Stage::new() else { return };
    let desk = stage.desk();
    stage.browse("drawings.py", &[&desk.url], nothing_is_asked);
}

/// By which a text would become markup or a program.
const FORBIDDEN: [&str; 8] = [
    "innerHTML",
    "outerHTML",
    "insertAdjacentHTML",
    "document.write",
    "eval(",
    "new Function",
    "http://",
    "https://",
];

/// The namespace of a drawing, which nobody asks for.
const NAMESPACE: &str = "http://www.w3.org/2000/svg";

/// Besides what others have written, which is vendored as it is.
#[test]
fn no_text_becomes_markup_and_no_other_host_is_named() {
    let page = root().join("host-tools/desk/page");
    let files = files_below(&page);
    assert!(files.len() > 20, "{files:?}");
    for file in files.iter().filter(|it| !it.starts_with(page.join("vendor"))) {
        let text = std::fs::read_to_string(file).unwrap().replace(NAMESPACE, "");
        for word in FORBIDDEN {
            assert!(!text.contains(word), "{word} in {}", file.display());
        }
        assert!(text.lines().count() < 500, "{} holds more than one idea", file.display());
    }
}

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|it| it.unwrap().path());
    entries.flat_map(|it| if it.is_dir() { files_below(&it) } else { vec![it] }).collect()
}
