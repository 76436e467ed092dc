//! The computer that the program runs on: its clocks, its watchdog, its power supply, its
//! temperature, the priority of the measurement, and its settings partition.
//!
//! Each is asked of the kernel and does without what a computer lacks: that is logged, or its
//! value is `None`, and the box measures all the same.

pub mod clock;
pub mod power;
pub mod read_only_partition;
pub mod realtime;
pub mod temperature;
pub mod watchdog;
