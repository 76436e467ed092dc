//! For the unit tests of packages that include this file.

pub use plumbline_test_support::serial_lines as can_be_opened;
