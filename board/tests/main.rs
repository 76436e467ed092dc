//! The box's real program, as it is started on a box.

mod attacked;
mod cable;
mod common;
mod faults;
mod links;
mod replay;
mod sealed;
mod set_up;
