//! The real `plumb`, as its users start it. One program: linking one for each file takes longer
//! than the tests in most of them.

mod aim;
mod bad_trials;
mod budget;
mod cohort;
mod common;
mod demo;
mod export;
mod expose;
mod figures;
mod keys;
mod link;
mod live_box;
mod manual;
mod pair;
mod pair_live;
mod physiology;
mod pictures;
mod prove;
mod prove_live;
mod recording;
mod report_in_browser;
mod secrets;
mod spoiled_study;
mod study;
mod update;
mod validate;
mod verdict;
