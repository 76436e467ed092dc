//! TOML, with errors that name the field, the line and the remedy.

use serde::de::DeserializeOwned;

use crate::BadInput;

/// Parses a TOML text; errors name the field and its line.
///
/// `remedy` says what a correct file looks like.
///
/// # Errors
/// When it is not TOML, or not of this type.
pub fn from_toml<T: DeserializeOwned>(
    text: &str,
    place: &str,
    remedy: &str,
) -> Result<T, BadInput> {
    toml::from_str(text).map_err(|error| bad_toml(&error, text, place, remedy))
}

fn bad_toml(error: &toml::de::Error, text: &str, place: &str, remedy: &str) -> BadInput {
    let message = error.message().trim();
    // A fault may be found in the middle of a character.
    let ends_before = |offset: usize| text.bytes().take(offset).filter(|it| *it == b'\n').count();
    let number = error.span().map(|span| ends_before(span.start));
    let line = number.and_then(|number| text.lines().nth(number)).unwrap_or_default();
    // serde names the field in its own words; otherwise it is the key on the line.
    let key_on_line = line.split_once('=').map(|(key, _)| key.trim().to_owned());
    let in_backticks = message.split('`').nth(1).filter(|name| !name.is_empty());
    let named = ["missing field", "unknown field", "duplicate key", "duplicate field"];
    let is_named = named.iter().any(|start| message.starts_with(start));
    let field = in_backticks.map(str::to_owned).filter(|_| is_named).or(key_on_line);
    let mut place_in_file = field.unwrap_or_default();
    // A missing field has no line: its table may be the whole file.
    if let Some(number) = number.filter(|_| !message.starts_with("missing field")) {
        let separator = if place_in_file.is_empty() { "" } else { " " };
        place_in_file = format!("{place_in_file}{separator}(line {})", number + 1);
    }
    if let Some((value, unit)) = number_with_unit(line) {
        let found = format!("{value} {unit}, and a number has no unit here");
        let remedy = "write the number alone, in the unit that the field's name ends with";
        return BadInput::new(place, place_in_file, found, remedy);
    }
    let found = message.lines().next().unwrap_or("it is not TOML");
    BadInput::new(place, place_in_file, found, remedy)
}

/// The ends of the names of fields that hold numbers.
const UNITS: [&str; 9] = ["mm", "px", "s", "ms", "us", "hz", "deg", "rad", "percent"];

/// The number and the unit behind it, where a line has both. Other fields may hold texts: the
/// participant 12a only lacks quotation marks.
fn number_with_unit(line: &str) -> Option<(&str, &str)> {
    let (field, value) = line.split_once('=')?;
    field.trim().rsplit_once('_').filter(|(_, unit)| UNITS.contains(unit))?;
    let value = value.split('#').next().unwrap_or_default().trim();
    let end = value.find(|letter: char| !(letter.is_ascii_digit() || "+-.".contains(letter)))?;
    let (number, unit) = value.split_at(end);
    let unit = unit.trim();
    let is_unit = |letter: char| letter.is_alphabetic() || "%°²³/".contains(letter);
    (number.parse::<f64>().is_ok() && unit.chars().all(is_unit)).then_some((number, unit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "it is only read into")]
    struct Board {
        pitch_mm: f64,
    }

    fn error(text: &str) -> String {
        from_toml::<Board>(text, "targets.toml", "as README shows").unwrap_err().to_string()
    }

    #[test]
    fn a_number_with_a_unit_is_called_that() {
        for (value, shown) in [
            ("25 mm", "25 mm"),
            ("25mm", "25 mm"),
            // Not 2.5: the field has another unit.
            ("2.5 cm", "2.5 cm"),
            ("-2.5 °  # so", "-2.5 °"),
        ] {
            let wanted = format!(
                "targets.toml: pitch_mm (line 2): {shown}, and a number has no unit here; write \
                 the number alone, in the unit that the field's name ends with"
            );
            assert_eq!(error(&format!("\npitch_mm = {value}\n")), wanted);
        }
        for text in [
            "pitch_mm = \"25\"",
            "pitch_mm = mm",
            "pitch_mm = 1x5",
            "pitch_mm = 1-2 mm",
            "participant = 12a",
        ] {
            assert!(!error(text).contains("unit"), "{text}: {}", error(text));
        }
    }

    #[test]
    fn a_fault_within_a_character_is_named_by_its_line() {
        for text in ["a = 1\npitch_mm = ü", "ü\n", "pitch_mm = \"ü\u{0}\"", "\n\nü = 'ü\n"] {
            assert!(error(text).contains("(line "), "{}", error(text));
        }
    }
}
