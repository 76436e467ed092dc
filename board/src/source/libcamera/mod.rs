//! Cameras on a ribbon cable, through libcamera.
//!
//! ```text
//!    libcamera's thread                     the loop
//!   completed request ──▶ Inbox ──▶ Newest, two at most ──▶ frame
//!          ▲                             │ older                │ done with
//!          └─────────────────────────────┴──────────────────────┘ queued again
//! ```
//!
//! Buffers are mapped once and used where they lie; only luma between chroma
//! (YUYV) is copied. The formats are R8, R10 and R16 (unpacked), YUYV, and NV12
//! or YUV420. Each opening starts libcamera anew, so that it looks for cameras
//! afresh whether or not anything tells it that one was plugged in; there can be
//! one open camera per process.
//!
//! The sensor's time stamp is when its first row was exposed, says libcamera;
//! pipelines that take it from a CSI receiver mark the start of the first row's
//! read-out, which is that row's exposure time later.
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
