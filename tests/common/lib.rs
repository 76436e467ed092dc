//! What several tests of the whole share.

pub mod binary;
pub mod booth;
pub mod coloured;
pub mod keys;
pub mod lsl;
pub mod photographer;
pub mod scene;
