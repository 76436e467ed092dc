//! What several tests share.

pub mod browser;
pub mod finished;
pub mod keys;
pub mod trial;
