//! Figures and statistics compared with other people's results and programs. All in one test
//! program: linking one for each file takes longer than the tests.

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
