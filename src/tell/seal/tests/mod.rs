//! Both ends of the link against each other, against a bad network, and against whoever would like
//! to be one of them.

extern crate std;

mod approach;
mod box_end;
mod channel;
mod epochs;
mod host_end;
mod hostile;
mod key;
mod leaving;
mod pairing;
mod reception;
mod restarts;
mod stream;
mod update;
mod vectors;
mod versions;
mod waiting;
mod wire;
mod world;
