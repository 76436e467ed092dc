//! Cameras on a ribbon cable, through libcamera.
//!
//! ```text
//!    libcamera's thread                     the loop
//!   completed request ──▶ Inbox ──▶ Newest, two at most ──▶ frame
//!          ▲                             │ older                │ done with
//!          └─────────────────────────────┴──────────────────────┘ queued again
//! ```
//!
//! Buffers are mapped once and read in place; only luma between chroma (YUYV) and
//! green (RGB) are copied. The formats are R8, R10 and R16 (unpacked), YUYV, NV12 or
//! YUV420, and RGB888 or BGR888.
//! Each opening restarts libcamera, so that it searches for cameras again whether
//! or not it was notified that one was plugged in; there can be one open camera per
//! process.
//!
//! Once the first frame has been handed out nothing here uses Rust's heap, nor
//! does the `libcamera` crate on the calls made here; the C++ library behind it
//! has its own allocator and uses it for every frame.

mod inbox;
mod layout;
mod stamp;

#[cfg(feature = "libcamera")]
mod device;
#[cfg(feature = "libcamera")]
mod mapping;
#[cfg(feature = "libcamera")]
mod setup;

#[cfg(feature = "libcamera")]
pub use device::Libcamera;
