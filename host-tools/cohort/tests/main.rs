//! A cohort from trial folders.

mod adding;
mod interrupted;
mod many;
mod sessions;
mod statistics;
mod support;
