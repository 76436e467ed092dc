//! A configuration that a host sends: assembled from its parts, checked as at a start, and
//! stored.

use heapless::Vec;
use plumbline::config::{BLOB_BYTES_MAX, Config};
use plumbline::packet::{Document, Part, Refusal, ReplyOutcome};
use plumbline::seal::ListenerId;

use crate::config_store::ConfigStore;
use crate::equipment::Equipment;
use crate::logger;

/// The parts received so far, and where the configuration will be stored.
#[derive(Debug)]
pub struct Provisioning {
    store: Option<ConfigStore>,
    /// Whose parts they are: those of two hosts are not mixed.
    sender: Option<ListenerId>,
    /// Without gaps, from the first byte.
    received: Vec<u8, BLOB_BYTES_MAX>,
}

impl Provisioning {
    /// Nothing has been received yet. Without a store every configuration is refused.
    #[must_use]
    pub fn new(store: Option<ConfigStore>) -> Self {
        Self { store, sender: None, received: Vec::new() }
    }

    /// Takes a part of a configuration. A part that leaves a gap is ignored: the host is told
    /// where the gap is, and sends from there again. The first part takes the place of what another
    /// host has sent.
    pub fn take(&mut self, sender: ListenerId, part: &Part) {
        let offset = part.offset as usize;
        if offset > 0 && self.sender != Some(sender) {
            return;
        }
        self.sender = Some(sender);
        if part.document != Document::Config || offset > self.received.len() {
            return;
        }
        self.received.truncate(offset);
        // Fails if the whole is too long for a configuration; `keep` then refuses it.
        let _ = self.received.extend_from_slice(&part.bytes);
    }

    /// Stores what was received, if it is complete and a box can run with it.
    pub fn keep(&mut self, sender: ListenerId, bytes: u32, crc: u32) -> ReplyOutcome {
        let Some(store) = &self.store else {
            return refused(Refusal::NotSupported, "this program has nowhere to keep it");
        };
        let bytes = bytes as usize;
        if bytes > BLOB_BYTES_MAX {
            return refused(
                Refusal::Unusable,
                format_args!("{bytes} bytes; this box takes at most {BLOB_BYTES_MAX}"),
            );
        }
        if self.sender != Some(sender) {
            return refused(Refusal::Incomplete { from: 0 }, "");
        }
        if self.received.len() < bytes {
            return refused(Refusal::Incomplete { from: self.received.len() as u32 }, "");
        }
        let blob = &self.received[..bytes];
        let config = match Config::decode(blob) {
            Ok(config) if config.crc() == crc => config,
            Ok(_) => {
                // These are the parts of another configuration, sent earlier.
                self.received.clear();
                return refused(Refusal::Incomplete { from: 0 }, "");
            }
            Err(error) => {
                let outcome = refused(Refusal::Unusable, error);
                self.received.clear();
                return outcome;
            }
        };
        if let Err(error) = Equipment::of(&config) {
            return refused(Refusal::Unusable, format_args!("{error:#}"));
        }
        if let Err(error) = store.store(blob) {
            log::error!("configuration {crc:08x} is not stored: {error:#}");
            return refused(Refusal::NotStored, format_args!("{error:#}"));
        }
        log::info!("configuration {crc:08x} is stored; it takes effect at the next start");
        ReplyOutcome::Stored { crc }
    }
}

/// A refusal with as much of its reason as there is room for.
pub fn refused(refusal: Refusal, reason: impl std::fmt::Display) -> ReplyOutcome {
    ReplyOutcome::Refused { refusal, reason: logger::cut(reason) }
}

#[cfg(test)]
mod tests {
    use plumbline::packet::PART_BYTES_MAX;

    use super::*;
    use crate::test_config::config;
    use crate::test_listeners::listened_to;

    fn parts(blob: &[u8]) -> impl Iterator<Item = Part> + '_ {
        blob.chunks(PART_BYTES_MAX).enumerate().map(|(index, bytes)| Part {
            document: Document::Config,
            offset: (index * PART_BYTES_MAX) as u32,
            bytes: bytes.iter().copied().collect(),
        })
    }

    fn blob(config: &Config) -> std::vec::Vec<u8> {
        config.encode(&mut [0; BLOB_BYTES_MAX]).unwrap().to_vec()
    }

    fn refusal(outcome: ReplyOutcome) -> (Refusal, std::string::String) {
        match outcome {
            ReplyOutcome::Refused { refusal, reason } => (refusal, reason.as_str().into()),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn parts_may_take_several_attempts() {
        let (_, [host, _]) = listened_to();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("config.plb");
        let mut provisioning = Provisioning::new(Some(ConfigStore::file(&path)));
        let blob = blob(&config());
        let (bytes, crc) = (blob.len() as u32, config().crc());
        // The second part is lost, and so the third leaves a gap.
        for part in parts(&blob).enumerate().filter(|(index, _)| *index != 1) {
            provisioning.take(host, &part.1);
        }
        let incomplete = Refusal::Incomplete { from: PART_BYTES_MAX as u32 };
        assert_eq!(refusal(provisioning.keep(host, bytes, crc)).0, incomplete);
        parts(&blob).skip(1).for_each(|part| provisioning.take(host, &part));
        assert_eq!(provisioning.keep(host, bytes, crc), ReplyOutcome::Stored { crc });
        // The reply was lost: the host asks again.
        assert_eq!(provisioning.keep(host, bytes, crc), ReplyOutcome::Stored { crc });
        assert_eq!(std::fs::read(&path).unwrap(), blob);
    }

    #[test]
    fn what_a_box_cannot_run_with_is_refused_by_its_field() {
        let (_, [host, _]) = listened_to();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("config.plb");
        let mut provisioning = Provisioning::new(Some(ConfigStore::file(&path)));
        let mut without_camera = config();
        without_camera.capture = None;
        let mut without_link = config();
        without_link.links.udp = None;
        let mut damaged = blob(&config());
        damaged[20] ^= 1;
        let cases = [
            (blob(&without_camera), without_camera.crc(), "capture: "),
            (blob(&without_link), without_link.crc(), "links: "),
            (damaged, config().crc(), "checksum"),
        ];
        for (blob, crc, words) in cases {
            parts(&blob).for_each(|part| provisioning.take(host, &part));
            let (why, reason) = refusal(provisioning.keep(host, blob.len() as u32, crc));
            assert!(why == Refusal::Unusable && reason.contains(words), "{reason}");
        }
        let too_long = BLOB_BYTES_MAX as u32 + 1;
        assert_eq!(refusal(provisioning.keep(host, too_long, 0)).0, Refusal::Unusable);
        assert!(!path.exists());
        // Parts received earlier are not mistaken for the configuration announced now.
        let blob = blob(&config());
        parts(&blob).for_each(|part| provisioning.take(host, &part));
        let (why, _) = refusal(provisioning.keep(host, blob.len() as u32, 7));
        assert_eq!(why, Refusal::Incomplete { from: 0 });
    }

    #[test]
    fn without_a_place_for_it_nothing_is_kept() {
        let (_, [host, _]) = listened_to();
        let mut provisioning = Provisioning::new(None);
        assert_eq!(refusal(provisioning.keep(host, 0, 0)).0, Refusal::NotSupported);
    }

    #[test]
    fn the_parts_of_two_hosts_are_not_mixed() {
        let (_, [one, other]) = listened_to();
        let folder = tempfile::tempdir().unwrap();
        let store = ConfigStore::file(&folder.path().join("config.plb"));
        let mut provisioning = Provisioning::new(Some(store));
        let blob = blob(&config());
        let (bytes, crc) = (blob.len() as u32, config().crc());
        let stored = ReplyOutcome::Stored { crc };
        for (index, part) in parts(&blob).enumerate() {
            provisioning.take(one, &part);
            if index > 0 {
                let bytes = [7; 9].into_iter().collect();
                provisioning.take(other, &Part { bytes, ..part });
            }
        }
        let incomplete = Refusal::Incomplete { from: 0 };
        assert_eq!(refusal(provisioning.keep(other, bytes, crc)).0, incomplete);
        assert_eq!(provisioning.keep(one, bytes, crc), stored);
        parts(&blob).for_each(|part| provisioning.take(other, &part));
        assert_eq!(refusal(provisioning.keep(one, bytes, crc)).0, incomplete);
        assert_eq!(provisioning.keep(other, bytes, crc), stored);
    }
}
