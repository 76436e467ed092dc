//! Both ends of the link against each other, against a bad network, and against whoever would like
//! to be one of them.

extern crate std;

mod approach;
mod epochs;
mod hostile;
mod leaving;
mod reception;
mod restarts;
mod stream;
mod update;
mod vectors;
mod versions;
mod waiting;
mod world;
