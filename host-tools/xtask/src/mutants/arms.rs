//! A source file with many of its mutants at once: each function has its own body and those of its mutants
//! as the arms of one `match`, and which one runs is chosen when the program starts. A function's number is
//! that of its first mutant.
//!
//! ```text
//! fn twice(x: u8) -> u8 {          fn twice(x: u8) -> u8 { match crate::the_mutant(7) {
//!     2 * x                        7 => { 2 + x }
//! }                                8 => { 2 / x }
//!                                  _ => { 2 * x }
//!                                  } }
//! ```

use std::ops::Range;

use anyhow::{Context, Result};

use super::list::{Mutant, Place, Span};

/// Most mutants of a crate that are compiled together.
pub const TOGETHER_MAX: usize = 16_384;

/// What is appended to a crate's root: the number of the mutant that runs, 0 for none. Where a file is named
/// for it, a function writes its number into that when it is first called; without a heap, on which some
/// tests keep an eye.
pub const CHOICE: &str = r#"
#[doc(hidden)]
pub fn the_mutant(function: u32) -> u32 {
    extern crate std as the_library;
    use the_library::{fs::File, io::Write, sync::OnceLock, sync::atomic::{AtomicBool, Ordering}};
    static REACHED: OnceLock<Option<File>> = OnceLock::new();
    static IS_REACHED: [AtomicBool; 16_384] = [const { AtomicBool::new(false) }; 16_384];
    static CHOSEN: OnceLock<u32> = OnceLock::new();
    let reached = REACHED.get_or_init(|| {
        the_library::env::var_os("PLUMBLINE_REACHED").map(|path| File::create(path).unwrap())
    });
    if let Some(mut file) = reached.as_ref() {
        if !IS_REACHED[function as usize].swap(true, Ordering::Relaxed) {
            file.write_all(&function.to_le_bytes()).unwrap();
        }
        return 0;
    }
    *CHOSEN.get_or_init(|| {
        the_library::env::var("PLUMBLINE_MUTANT").map_or(0, |text| text.parse().unwrap_or(0))
    })
}
"#;

/// The variable of the environment that says which mutant runs.
pub const MUTANT: &str = "PLUMBLINE_MUTANT";

/// The variable of the environment that names the file for the functions that are reached; no mutant runs
/// then.
pub const REACHED: &str = "PLUMBLINE_REACHED";

/// A function in a file that was made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Choice {
    /// Its lines from the first arm on, from 1.
    pub lines: Range<usize>,
    /// The lines of each mutant, by number.
    pub arms: Vec<(u32, Range<usize>)>,
}

impl Choice {
    /// The function's number.
    pub fn function(&self) -> u32 {
        self.arms[0].0
    }
}

/// The text of a file with all these mutants, which are [`is_chosen_at_start`], by number; and its functions
/// that have some.
pub fn with_all(source: &str, mutants: &[(u32, &Mutant)]) -> Result<(String, Vec<Choice>)> {
    let lines = Lines::of(source);
    let (mut text, mut choices, mut done) = (String::new(), Vec::new(), 0);
    for (outer, members) in by_function(mutants) {
        let function = lines.range(outer)?;
        let body = body(source, function.clone())
            .with_context(|| format!("{}: no body", members[0].1.name))?;
        text += &source[done..function.start];
        // What is always inlined would take its arms into each arm of its callers, and these into theirs.
        text +=
            &source[function.start..body.start].replace("#[inline(always)]", "#[inline(never)]");
        text += &format!("{{ match crate::the_mutant({}) {{\n", members[0].0);
        let (begin, mut arms) = (line_of_end(&text), Vec::new());
        for (number, mutant) in members {
            let changed = lines.range(mutant.span)?;
            let first = line_of_end(&text);
            text += &format!("{number} => ");
            for part in [
                &source[body.start..changed.start],
                " ",
                &mutant.replacement,
                " ",
                &source[changed.end..body.end],
            ] {
                text += part;
            }
            text += "\n";
            arms.push((number, first..line_of_end(&text)));
        }
        text += "_ => ";
        text += &source[body.clone()];
        text += "\n} }";
        choices.push(Choice { lines: begin..line_of_end(&text) + 1, arms });
        done = body.end;
    }
    text += &source[done..];
    Ok((text, choices))
}

/// The number of the line that begins or goes on after a text, from 1.
fn line_of_end(text: &str) -> usize {
    text.matches('\n').count() + 1
}

/// The text of a file with this mutant and nothing else.
pub fn with_one(source: &str, mutant: &Mutant) -> Result<String> {
    let changed = Lines::of(source).range(mutant.span)?;
    let (before, after) = (&source[..changed.start], &source[changed.end..]);
    Ok(format!("{before} {} {after}", mutant.replacement))
}

/// Whether a mutant can be an arm. What is computed while compiling cannot ask which one runs, lengths in
/// the signature among it, and the arms of a function that returns `impl Trait` would have different types.
pub fn is_chosen_at_start(source: &str, mutant: &Mutant) -> bool {
    let Some(function) = &mutant.function else { return false };
    let signature = || {
        let lines = Lines::of(source);
        let function = lines.range(function.span).ok()?;
        let body = body(source, function.clone())?;
        let is_in_body = body.start <= lines.range(mutant.span).ok()?.start;
        is_in_body.then(|| &source[function.start..body.start])
    };
    let is_const = |text: &str| {
        let code: String = text.lines().filter(|line| !line.trim().starts_with("//")).collect();
        code.split_whitespace().any(|word| word == "const")
    };
    !function.return_type.contains("impl ") && signature().is_some_and(|it| !is_const(it))
}

/// The mutants of each function; those of a function within another belong to the outer one.
fn by_function<'a>(mutants: &[(u32, &'a Mutant)]) -> Vec<(Span, Vec<(u32, &'a Mutant)>)> {
    let span_of = |mutant: &Mutant| mutant.function.as_ref().map_or(mutant.span, |it| it.span);
    let mut sorted = mutants.to_vec();
    // An outer function begins first or, which cannot be, ends last.
    sorted.sort_by_key(|(number, mutant)| (span_of(mutant).start, *number));
    let mut functions: Vec<(Span, Vec<(u32, &Mutant)>)> = Vec::new();
    for (number, mutant) in sorted {
        let span = span_of(mutant);
        match functions.last_mut() {
            Some((outer, members)) if outer.holds(&span) => members.push((number, mutant)),
            _ => functions.push((span, vec![(number, mutant)])),
        }
    }
    functions
}

/// Where a function's body is, with its braces: from the first brace that is neither in a comment nor a
/// string nor in other brackets.
fn body(source: &str, function: Range<usize>) -> Option<Range<usize>> {
    let bytes = source.as_bytes();
    let (mut at, mut depth) = (function.start, 0);
    while at < function.end {
        match bytes[at] {
            b'/' if bytes.get(at + 1) == Some(&b'/') => {
                at += source[at..function.end].find('\n')?;
            }
            b'"' => {
                at += 1;
                while at < function.end && bytes[at] != b'"' {
                    at += if bytes[at] == b'\\' { 2 } else { 1 };
                }
            }
            b'(' | b'[' => depth += 1,
            b')' | b']' => depth -= 1,
            b'{' if depth == 0 => return Some(at..function.end),
            _ => {}
        }
        at += 1;
    }
    None
}

/// Where each line of a text begins.
struct Lines<'a> {
    text: &'a str,
    starts: Vec<usize>,
}

impl<'a> Lines<'a> {
    fn of(text: &'a str) -> Self {
        let after = text.match_indices('\n').map(|(at, _)| at + 1);
        Self { text, starts: [0].into_iter().chain(after).collect() }
    }

    fn range(&self, span: Span) -> Result<Range<usize>> {
        let range = self.offset(span.start)?..self.offset(span.end)?;
        anyhow::ensure!(range.start <= range.end, "a span that ends before it begins");
        Ok(range)
    }

    fn offset(&self, place: Place) -> Result<usize> {
        let outside = || format!("line {} has no column {}", place.line, place.column);
        let start = place.line.checked_sub(1).and_then(|line| self.starts.get(line));
        let start = *start.with_context(outside)?;
        let line = &self.text[start..];
        let mut ends = line.char_indices().map(|(at, _)| at).chain([line.len()]);
        let column = place.column.checked_sub(1).with_context(outside)?;
        Ok(start + ends.nth(column).with_context(outside)?)
    }
}

#[cfg(test)]
mod tests {
    use super::super::list::Function;
    use super::*;

    const SOURCE: &str = "\
/// Twice {µ}.
#[must_use = \"{\"]
#[inline(always)]
fn twice(x: [u8; { 1 }]) -> u8 {
    fn one() -> u8 { 1 }
    2 * x[0] * one()
}

const fn three() -> u8 { 1 + 2 }
";

    /// The mutant that replaces the text after these words, in the function from this to that line.
    fn mutant(
        before: &str,
        text: &str,
        replacement: &str,
        function: Option<(usize, usize)>,
    ) -> Mutant {
        let at = SOURCE.find(&format!("{before}{text}")).unwrap() + before.len();
        let place = |at: usize| {
            let line = SOURCE[..at].matches('\n').count() + 1;
            let column = SOURCE[..at].lines().last().unwrap().chars().count() + 1;
            Place { line, column }
        };
        let span = |(first, last): (usize, usize)| Span {
            start: Place { line: first, column: 1 },
            end: Place { line: last, column: SOURCE.lines().nth(last - 1).unwrap().len() + 1 },
        };
        Mutant {
            name: text.to_owned(),
            package: String::new(),
            file: String::new(),
            function: function.map(|it| Function { return_type: "-> u8".into(), span: span(it) }),
            replacement: replacement.to_owned(),
            span: Span { start: place(at), end: place(at + text.len()) },
        }
    }

    #[test]
    fn a_function_gets_an_arm_for_each_of_its_mutants() {
        let times = mutant("2 ", "*", "+", Some((1, 7)));
        let mut inner = mutant("{ ", "1 }\n", "0 }\n", Some((5, 5)));
        inner.span.end = Place { line: 5, column: inner.span.start.column + 1 };
        inner.replacement = "0".into();
        let (text, choices) = with_all(SOURCE, &[(7, &times), (8, &inner)]).unwrap();
        let expected = "\
/// Twice {µ}.
#[must_use = \"{\"]
#[inline(never)]
fn twice(x: [u8; { 1 }]) -> u8 { match crate::the_mutant(7) {
7 => {
    fn one() -> u8 { 1 }
    2  +  x[0] * one()
}
8 => {
    fn one() -> u8 {  0  }
    2 * x[0] * one()
}
_ => {
    fn one() -> u8 { 1 }
    2 * x[0] * one()
}
} }

const fn three() -> u8 { 1 + 2 }
";
        assert_eq!(text, expected);
        assert_eq!(choices, [Choice { lines: 5..18, arms: vec![(7, 5..9), (8, 9..13)] }]);
    }

    #[test]
    fn what_is_computed_while_compiling_is_changed_alone() {
        let three = mutant("1 ", "+", "-", Some((9, 9)));
        assert!(!is_chosen_at_start(SOURCE, &three));
        let text = with_one(SOURCE, &three).unwrap();
        assert!(text.ends_with("const fn three() -> u8 { 1  -  2 }\n"), "{text}");
        let twice = mutant("2 ", "*", "+", Some((1, 7)));
        assert!(is_chosen_at_start(SOURCE, &twice));
        assert!(!is_chosen_at_start(SOURCE, &mutant("2 ", "*", "+", None)));
        let length = mutant("[u8; { ", "1", "2", Some((1, 7)));
        assert!(!is_chosen_at_start(SOURCE, &length));
        let mut opaque = twice;
        opaque.function.as_mut().unwrap().return_type = "-> impl Iterator".into();
        assert!(!is_chosen_at_start(SOURCE, &opaque));
    }

    #[test]
    fn each_function_of_a_batch_has_its_place_among_those_that_are_reached() {
        let places = format!("static IS_REACHED: [AtomicBool; {TOGETHER_MAX}]");
        assert!(CHOICE.replace('_', "").contains(&places.replace('_', "")));
        assert!([MUTANT, REACHED].iter().all(|it| CHOICE.contains(&format!("\"{it}\""))));
    }

    #[test]
    fn a_place_outside_the_file_is_an_error() {
        let mut beyond = mutant("2 ", "*", "+", None);
        beyond.span.end = Place { line: 100, column: 1 };
        assert!(with_one(SOURCE, &beyond).unwrap_err().to_string().contains("line 100"));
    }
}
