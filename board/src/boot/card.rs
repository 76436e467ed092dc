//! What a box keeps on its card besides the configuration itself: where the configuration and the key
//! are stored, and what the last start has left there.

use anyhow::Result;
use plumbline::config::FILE_NAME;
use plumbline::seal::Key;

use super::restart;
use crate::config_store::ConfigStore;
use crate::key_store::{self, KeyStore};
use crate::machine::read_only_partition::ReadOnlyPartition;

/// The card, or that there is none.
#[derive(Debug)]
pub struct Card {
    /// Where a configuration is stored.
    pub config_store: Option<ConfigStore>,
    /// Where a key is stored.
    pub key_store: Option<KeyStore>,
    /// The box's key: `None` if it has none, or why it cannot be used.
    pub key: Result<Option<Key>>,
    /// Whether the last restart was in good order.
    pub is_marked: bool,
}

impl Card {
    /// Reads the card, and finishes what a power cut has interrupted.
    pub fn read(partition: Option<&ReadOnlyPartition>) -> Self {
        let is_marked = partition.is_some_and(restart::take_mark);
        let config_store = partition.map(|it| ConfigStore::on_partition(it, FILE_NAME));
        let key_store = partition.map(KeyStore::on_partition);
        if let Some(store) = &config_store
            && let Err(error) = store.complete()
        {
            log::warn!(
                "the configuration that was being stored is used, but its journal remains: {error:#}"
            );
        }
        if let Some(store) = &key_store
            && let Err(error) = store.complete()
        {
            log::warn!("the key that was being stored is used, but its journal remains: {error:#}");
        }
        let key = key_store.as_ref().map_or(Ok(None), KeyStore::read);
        key_store::report(&key);
        Self { config_store, key_store, key, is_marked }
    }

    /// The key, if it can be used.
    pub fn usable_key(&self) -> Option<&Key> {
        self.key.as_ref().ok().and_then(Option::as_ref)
    }
}
