//! Figures and statistics against other people's numbers and programs. One program: linking one
//! for each file takes longer than the tests.

mod bds;
mod common;
mod hostile_values;
mod nparld;
mod oracles;
mod physiology;
mod physiology_oracles;
mod published;
mod sway;
mod sway_oracles;
