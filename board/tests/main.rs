//! The box's real program, as it is started on a box.

mod common;
mod faults;
mod links;
mod replay;
mod set_up;
