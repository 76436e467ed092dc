//! Who a box is on its links, and what it says of itself in clear.

use std::fmt::Write as _;

use anyhow::Result;
use plumbline::config::Config;
use plumbline::packet::{ResetReason, Start};
use plumbline::seal::{BoxState, Key, WAITING_TEXT_BYTES_MAX};

use crate::key_store::KeyStore;
use crate::logger::Cut;

/// Who a box is.
#[derive(Debug)]
pub struct Identity {
    /// The number of this start.
    pub start: Start,
    /// Its name and its serial number, for people; empty where they are not known.
    pub name: String,
    /// Its key: `None` if it has none, or why it cannot be used.
    pub key: Result<Option<Key>>,
    /// Where a key is stored that comes over the cable.
    pub store: Option<KeyStore>,
    /// Why the box started.
    pub reset_reason: ResetReason,
    /// How often it has started; without that nothing is sent on a line without a way back.
    pub start_count: Option<u32>,
    /// Why nothing is tracked, if so.
    pub refusal: Option<String>,
}

impl Identity {
    /// The name of a box with this configuration.
    #[must_use]
    pub fn name_of(config: &Config) -> String {
        match (config.device.as_str(), config.serial_number.as_str()) {
            (device, "") => device.into(),
            (device, number) => format!("{device} ({number})"),
        }
    }
}

/// What an announcement says besides the key.
#[derive(Debug, Clone)]
pub(super) struct Description {
    pub(super) state: BoxState,
    /// Why it waits; nothing is said of a box with a key.
    pub(super) text: heapless::String<WAITING_TEXT_BYTES_MAX>,
}

impl Description {
    pub(super) fn of(identity: &Identity) -> Self {
        let Identity { name, key, refusal, .. } = identity;
        let mut text = Cut::<WAITING_TEXT_BYTES_MAX>::default();
        let name = if name.is_empty() { "a box" } else { name };
        // Writing never fails; what does not fit is left out.
        let state = match key {
            Ok(Some(_)) if refusal.is_some() => BoxState::Refusing,
            Ok(Some(_)) => BoxState::Ready,
            Ok(None) => {
                let _ = write!(text, "{name} has no key");
                BoxState::Unpaired
            }
            Err(error) => {
                let _ = write!(text, "{name}: its key cannot be used: {error:#}");
                BoxState::KeyUnreadable
            }
        };
        if let Some(refusal) = refusal {
            let _ = write!(text, "; {refusal}");
        }
        Self { state, text: text.text }
    }

    /// The same box, once it has a key.
    pub(super) fn paired(&self, is_refusing: bool) -> Self {
        let state = if is_refusing { BoxState::Refusing } else { BoxState::Ready };
        Self { state, text: heapless::String::new() }
    }
}

#[cfg(test)]
mod tests {
    use anyhow::anyhow;

    use super::*;

    fn described(key: Result<Option<Key>>, refusal: Option<&str>) -> (BoxState, String) {
        let identity = Identity {
            start: Start::MIN,
            name: "ward 3 (PL-0001)".into(),
            key,
            store: None,
            reset_reason: ResetReason::Unknown,
            start_count: None,
            refusal: refusal.map(str::to_owned),
        };
        let Description { state, text } = Description::of(&identity);
        (state, text.as_str().into())
    }

    #[test]
    fn a_box_says_who_it_is_and_why_it_waits() {
        let key = || Ok(Some(Key::new([7; 32]).unwrap()));
        assert_eq!(described(key(), None).0, BoxState::Ready);
        assert_eq!(described(key(), Some("no config.plb")).0, BoxState::Refusing);
        let unpaired = described(Ok(None), Some("no config.plb"));
        assert_eq!(unpaired.0, BoxState::Unpaired);
        assert_eq!(unpaired.1, "ward 3 (PL-0001) has no key; no config.plb");
        let unreadable = described(Err(anyhow!("box.key is not a key")), None);
        assert_eq!(unreadable.0, BoxState::KeyUnreadable);
        let words = "ward 3 (PL-0001): its key cannot be used: box.key is not a key";
        assert_eq!(unreadable.1, words);
        assert_eq!(described(Ok(None), Some(&"\u{e4}".repeat(200))).1.len(), 159);
    }
}
