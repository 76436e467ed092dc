//! A rendered person with known truth.

mod normal;
pub mod render;
