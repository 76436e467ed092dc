//! The pages that targets and boards are printed on, at true scale.
//!
//! ```text
//! targets ─▶ print ─▶ layout: which sheet, and where ─▶ page: shapes in mm ─▶ pdf, svg
//!                       └─▶ tiles: what is larger than a sheet
//! ```

mod layout;
mod legend;
mod page;
pub mod pdf;
mod piece;
mod print;
pub mod svg;
mod tiles;

pub use layout::sheets;
pub use page::{Page, Paper, is_printable};
pub use print::Print;
