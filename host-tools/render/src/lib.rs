//! Images with known ground truth, and printed sheets.
//!
//! | module | what it draws |
//! |---|---|
//! | [`simulate`] | frames of a swaying person with both targets, through a lens, onto a sensor |
//! | [`sheet`] | the pages that targets and boards are printed on, as PDF and SVG |

pub mod sheet;
pub mod simulate;
