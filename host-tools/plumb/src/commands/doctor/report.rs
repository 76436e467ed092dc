//! The checks, for people.

use std::io::Write as _;

use anstyle::{AnsiColor, Style};
use plumbline_bedside::doctor::{Check, SCALE, Verdict};

/// The word of a verdict, and its look on a terminal.
fn look(verdict: Verdict) -> (&'static str, Style) {
    match verdict {
        Verdict::Good => ("ok", AnsiColor::Green.on_default()),
        Verdict::Warn => ("warn", AnsiColor::Yellow.on_default()),
        Verdict::Fail => ("FAIL", AnsiColor::Red.on_default().bold()),
        Verdict::Skipped => ("skip", Style::new().dimmed()),
    }
}

/// Prints each check in a line, and how many of each verdict there are.
pub fn print(checks: &[Check]) {
    // Colours are left out where standard output is not a terminal. A closed pipe has seen enough.
    let _ = anstream::stdout().write_all(text(checks).as_bytes());
}

/// Prints on standard error what is amiss or could not be looked at, and how many checks there were.
pub fn print_amiss(checks: &[Check]) {
    let _ = anstream::stderr().write_all(amiss(checks).as_bytes());
}

/// The same as a text without colours.
pub fn amiss_in_words(checks: &[Check]) -> String {
    anstream::adapter::strip_str(&amiss(checks)).to_string()
}

fn text(checks: &[Check]) -> String {
    lines(checks) + &counts(checks)
}

fn amiss(checks: &[Check]) -> String {
    // That lengths are true is known from a person alone, who should see that it is remembered.
    let is_said = |check: &&Check| check.verdict != Verdict::Good || check.subject == SCALE;
    let said: Vec<_> = checks.iter().filter(is_said).cloned().collect();
    format!("{}the box is checked: {}", lines(&said), counts(checks))
}

fn lines(checks: &[Check]) -> String {
    let width = checks.iter().map(|check| check.subject.chars().count()).max().unwrap_or(0);
    let line = |check: &Check| {
        let (word, style) = look(check.verdict);
        let to_do =
            if check.remedy.is_empty() { String::new() } else { format!("; {}", check.remedy) };
        format!("{style}{word:4}{style:#}  {:width$}  {}{to_do}\n", check.subject, check.seen)
    };
    checks.iter().map(line).collect()
}

fn counts(checks: &[Check]) -> String {
    let count = |verdict| checks.iter().filter(|check| check.verdict == verdict).count();
    format!(
        "{} ok, {} warned, {} failed, {} skipped\n",
        count(Verdict::Good),
        count(Verdict::Warn),
        count(Verdict::Fail),
        count(Verdict::Skipped)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_check_is_a_line_that_says_what_to_do() {
        let checks = [
            Check::good("link", "312 packets"),
            Check::warn("scene", "not measured", "run `plumb scene --store`"),
            Check::fail("lumbar depth", "+-0.6 mm (at most 0.1)", "go nearer"),
            Check::skipped("light", "no view came"),
            Check::good("scale", "compared"),
        ];
        let plain = anstream::adapter::strip_str(&text(&checks)).to_string();
        let expected = "ok    link          312 packets
warn  scene         not measured; run `plumb scene --store`
FAIL  lumbar depth  +-0.6 mm (at most 0.1); go nearer
skip  light         no view came
ok    scale         compared
2 ok, 1 warned, 1 failed, 1 skipped
";
        assert_eq!(plain, expected);
        let plain = anstream::adapter::strip_str(&amiss(&checks)).to_string();
        let expected = "warn  scene         not measured; run `plumb scene --store`
FAIL  lumbar depth  +-0.6 mm (at most 0.1); go nearer
skip  light         no view came
ok    scale         compared
the box is checked: 2 ok, 1 warned, 1 failed, 1 skipped
";
        assert_eq!(plain, expected);
        assert!(text(&checks).contains("\u{1b}[1m\u{1b}[31mFAIL\u{1b}[0m"), "{:?}", text(&checks));
    }
}
