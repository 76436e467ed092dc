//! Settings of a box, as pages give and get them: the fields of box.toml, or its text.

use plumbline::config::Config;
use plumbline_bedside::box_settings::{self, BoxSettings};
use plumbline_bedside::setup::{self, Places};
use plumbline_files::BadInput;
use plumbline_files::targets::{self, Targets};
use serde::Deserialize as _;
use serde_json::Value;

use crate::wire::{SettingsChoice, SettingsView};

/// Their name in messages.
pub const PLACE: &str = "the box's settings";

/// Any size of frames that a camera can have: settings do not depend on it.
const ANY_SIZE_PX: [u16; 2] = [640, 480];

/// The settings that are meant.
///
/// # Errors
/// When a field is missing, unknown or of another type.
pub fn chosen(choice: &SettingsChoice) -> Result<BoxSettings, BadInput> {
    match choice {
        SettingsChoice::Text(text) => box_settings::parse(text, PLACE),
        SettingsChoice::Fields(fields) => {
            let text = toml_of(fields)?;
            box_settings::parse(&text, PLACE).map_err(|mut error| {
                // Whoever has filled in fields sees no lines.
                if let Some((field, _)) = error.field.split_once(" (line ") {
                    error.field = field.to_owned();
                }
                error
            })
        }
    }
}

/// The text of a file with these fields.
fn toml_of(fields: &Value) -> Result<String, BadInput> {
    let bad = |found: String| {
        BadInput::whole(PLACE, found, "send the fields of box.toml, and numbers as numbers")
    };
    let table = toml::Table::deserialize(given(fields)).map_err(|error| bad(error.to_string()))?;
    toml::to_string(&table).map_err(|error| bad(error.to_string()))
}

/// The fields that are given: `null` stands for one that is not.
fn given(fields: &Value) -> Value {
    match fields {
        Value::Object(fields) => {
            let fields = fields.iter().filter(|(_, value)| !value.is_null());
            Value::Object(fields.map(|(name, value)| (name.clone(), given(value))).collect())
        }
        other => other.clone(),
    }
}

/// Settings, as a page has them.
#[must_use]
pub fn view(settings: &BoxSettings) -> SettingsView {
    let text = settings.to_toml();
    // As the file has them: numbers with the digits that were given.
    let fields = toml::from_str(&text).unwrap_or_default();
    SettingsView { text, fields }
}

/// Checks settings as a box will, whatever it measures.
///
/// # Errors
/// The first fault.
pub fn check(settings: &BoxSettings) -> Result<(), BadInput> {
    let board = targets::check(&[targets::standard_board()], PLACE)?;
    first_config(settings, ANY_SIZE_PX, board, &Places::all(PLACE)).map(|_| ())
}

/// The first configuration of a box, whose camera is not calibrated: as `plumb provision
/// --uncalibrated` makes it.
///
/// # Errors
/// When it cannot be used.
pub fn first_config(
    settings: &BoxSettings,
    [width_px, height_px]: [u16; 2],
    targets: Targets,
    places: &Places,
) -> Result<Config, BadInput> {
    let mut config = setup::uncalibrated(width_px, height_px, targets, places)?;
    settings.apply(&mut config, &places.settings)?;
    setup::configured(&config, places)?;
    setup::check_for_box(&config, places)?;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn fields() -> Value {
        let settings = box_settings::parse(box_settings::NEW_BOX, "").unwrap();
        view(&settings).fields
    }

    #[test]
    fn fields_and_text_say_the_same() {
        let mut fields = fields();
        fields["capture"]["rate_hz"] = json!(59.94);
        fields["capture"]["gain"] = Value::Null;
        fields["trigger"] = json!({ "chip": "pinctrl-bcm2711", "line": 17, "edge": "both" });
        let settings = chosen(&SettingsChoice::Fields(fields)).unwrap();
        check(&settings).unwrap();
        let seen = view(&settings);
        assert_eq!(seen.fields["capture"]["rate_hz"], json!(59.94));
        assert_eq!(seen.fields["trigger"]["edge"], "both");
        assert_eq!(chosen(&SettingsChoice::Text(seen.text)).unwrap(), settings);
    }

    #[test]
    fn a_fault_is_told_with_its_field_and_a_remedy() {
        for (table, field, value, words) in [
            ("capture", "rate_hz", json!("sixty"), "rate_hz"),
            ("capture", "rate_hz", Value::Null, "rate_hz"),
            ("capture", "pixel_format", json!("rgb"), "pixel_format"),
            ("links", "udp", json!("here"), "links.udp"),
            ("links", "udp", Value::Null, "links"),
            ("machine", "watchdog_s", json!(-1), "watchdog_s"),
            ("trigger", "chip", json!(""), "trigger.chip"),
        ] {
            let mut fields = fields();
            fields[table][field] = value;
            let checked = chosen(&SettingsChoice::Fields(fields)).and_then(|it| check(&it));
            let error = checked.unwrap_err();
            assert_eq!((&*error.place, &*error.field), (PLACE, words), "{error}");
            assert!(!error.remedy.is_empty(), "{error}");
        }
        let none = chosen(&SettingsChoice::Fields(json!([1]))).unwrap_err();
        assert!(none.to_string().contains("fields of box.toml"), "{none}");
    }
}
