//! The documentation: README's example runs, the example draws its picture, every name has a type.

use std::fs;

use plumbline_test_support::root;

use crate::bench::{Bench, sources};
use crate::trials::write_all;

#[test]
fn the_example_of_readme_runs() {
    let Some(bench) = Bench::new() else { return };
    write_all(&bench);
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let (_, section) = readme.split_once("\n## From Python\n").unwrap();
    let (section, _) = section.split_once("\n## ").unwrap();
    let (_, example) = section.split_once("```python\n").unwrap();
    let (example, _) = example.split_once("```").unwrap();
    let script = bench.path("example.py");
    fs::write(&script, example).unwrap();
    let printed = bench.ran(bench.python_with(&script));
    assert!(printed.contains("path length"), "{printed}");
    assert!(bench.path("p01.c3d").exists());
}

#[test]
fn the_example_draws_a_picture() {
    let Some(bench) = Bench::new() else { return };
    write_all(&bench);
    let mut example = bench.python_with(&sources().join("examples/sway.py"));
    example.args(["trials", "sway.png"]);
    let printed = bench.ran(example);
    assert!(printed.contains("control") && printed.contains("foam"), "{printed}");
    assert!(fs::read(bench.path("sway.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn every_name_has_its_type_and_its_description() {
    let Some(bench) = Bench::new() else { return };
    bench.ran(bench.script("names.py"));
}
