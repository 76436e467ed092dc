//! Trials whose errors are known, against their budgets.

mod coverage;
mod monte_carlo;
mod spans;
mod world;
