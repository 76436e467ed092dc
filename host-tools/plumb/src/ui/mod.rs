//! What several subcommands show: a spinner, a progress bar; results on standard output, and pictures
//! in files; and how a long run ends.

pub mod password;
pub mod png;
pub mod progress;
pub mod stdout;
pub mod stop;
pub mod waiting;
