//! The host side of Plumbline.
