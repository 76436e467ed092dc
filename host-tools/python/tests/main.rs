//! The Python package: every number against the program `plumb`, bit for bit, from the same files.
//!
//! The package is the extension that cargo has built, beside its Python files, in a folder of its own.
//! Each test starts a script of this folder, which checks with `assert`.

mod bench;
mod cluster;
mod documented;
mod languages;
mod live;
mod tracking;
mod trials;
