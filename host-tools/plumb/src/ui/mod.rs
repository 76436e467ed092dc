//! What several subcommands show: charts and their colours, annotated frames, a spinner, the
//! words for a target that is not found, a progress bar, the page of every report; results on standard
//! output, and pictures in files; and how a long run ends.

pub mod draw;
pub mod drawing;
pub mod missing;
pub mod page;
pub mod palette;
pub mod png;
pub mod progress;
pub mod stdout;
pub mod stop;
pub mod waiting;
