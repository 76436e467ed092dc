//! Which box a configuration is for.

use plumbline_files::BadInput;

use crate::box_settings;
/// Checks that a configuration is for the box that is to get it: both by name and serial
/// number. A box that was never named may get any.
///
/// # Errors
/// When it is another's, unless `force`.
pub fn refuse_another_box(
    place: &str,
    (device, serial_number): (&str, &str),
    (new_device, new_serial_number): (&str, &str),
    force: bool,
) -> Result<(), BadInput> {
    let same = (device, serial_number) == (new_device, new_serial_number);
    if same || force || box_settings::is_unnamed(device, serial_number) {
        return Ok(());
    }
    Err(BadInput::whole(
        place,
        format!(
            "this is the box {device:?} ({serial_number}), and the configuration is for \
             {new_device:?} ({new_serial_number})"
        ),
        "check which box this is, and device and serial_number in the box file; --force \
         renames it",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_same_box_or_a_nameless_one_takes_a_configuration() {
        let new = ("ward 3", "PL-0001");
        let refused = |old, force| refuse_another_box("UDP", old, new, force).err();
        assert_eq!(refused(new, false), None);
        assert_eq!(refused(("plumbline", "0"), false), None);
        for old in [("ward 4", "PL-0001"), ("ward 3", "PL-0002"), ("plumbline", "1")] {
            let text = refused(old, false).unwrap().to_string();
            assert!(text.contains(old.0) && text.contains(old.1), "{text}");
            assert!(text.contains("\"ward 3\" (PL-0001)") && text.contains("--force"), "{text}");
            assert_eq!(refused(old, true), None);
        }
    }
}
