//! `plumb keys list`: the boxes whose keys are known here.

use comfy_table::{Table, presets};
use jiff::Timestamp;
use jiff::tz::TimeZone;
use plumbline_bedside::keys::{KnownBox, Store};
use plumbline_files::BadInput;

use crate::ui::stdout;

/// Lists the boxes, and what is wrong with files that cannot be used. Shows no key.
pub fn run(store: &Store) -> Result<(), BadInput> {
    let boxes = store.all()?;
    for refused in &boxes.refused {
        eprintln!("warning: {refused}");
    }
    if boxes.known.is_empty() && !boxes.refused.is_empty() {
        return Ok(());
    }
    if boxes.known.is_empty() {
        let folder = store.folder().display();
        eprintln!(
            "no key of a box is known here ({folder}): make one with `plumb provision --new-key`, \
             or bring one from another computer with `plumb keys import`"
        );
        return Ok(());
    }
    stdout::print(&table(&boxes.known, &TimeZone::system()))
}

fn table(boxes: &[KnownBox], zone: &TimeZone) -> String {
    let mut table = Table::new();
    table.load_style(presets::UTF8_BORDERS_ONLY);
    table.set_header(["name", "serial number", "key", "made or imported", "last heard at"]);
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
    let local =
        |time: Timestamp| time.to_zoned(zone.clone()).strftime("%Y-%m-%d %H:%M").to_string();
    for known in boxes {
        table.add_row([
            or_dash(known.name.clone()),
            or_dash(known.serial_number.clone()),
            known.key.id().to_string(),
            local(known.made),
            or_dash(known.address.map(|address| address.to_string())),
        ]);
    }
    format!("{table}\n")
}

#[cfg(test)]
mod tests {
    use plumbline::seal::Key;

    use super::*;

    #[test]
    fn a_list_has_everything_but_the_key() {
        let key = Key::new([0x5a; 32]).unwrap();
        let mut known = KnownBox::new(key.clone(), Some("ward 3".into()), None);
        known.made = "2026-11-24T09:30:10Z".parse().unwrap();
        known.address = Some("192.168.1.30:4210".parse().unwrap());
        let text = table(&[known], &TimeZone::UTC);
        for part in
            ["ward 3", " - ", &key.id().to_string(), "2026-11-24 09:30", "192.168.1.30:4210"]
        {
            assert!(text.contains(part), "{text}");
        }
        assert!(!text.to_uppercase().contains("5A5A"), "{text}");
    }
}
