//! The host side of Plumbline.

pub mod simulate;
