//! A cohort from trial folders.

mod adding;
mod interrupted;
mod many;
mod removing;
mod sessions;
mod statistics;
mod support;
