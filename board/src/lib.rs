//! The Linux side of the Plumbline box.
