//! The tests of the whole. One program: linking one for each file takes longer than most of them.

mod bad_input;
mod calibration;
mod camera_formats;
mod covered_targets;
mod first_trial;
mod held_boards;
mod moved_camera;
mod photographs;
mod photographs_grid;
mod precision;
mod printed_targets;
mod readout;
mod rendered_person;
mod rolling_shutter;
mod stumble;
