//! What several tests share.

pub mod browser;
pub mod finished;
pub mod trial;
