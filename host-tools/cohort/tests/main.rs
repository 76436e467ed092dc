//! A cohort from trial folders.

mod adding;
mod interrupted;
mod many;
mod sessions;
mod support;
