//! Counts heap allocations, so that "none after the first frame" is
//! measured and not just promised.
//!
//! The program's `main.rs` makes [`CountingAllocator`] its global allocator.
//! The count covers every thread of the process; only work that is known to need
//! memory, and runs [`apart`], has a count of its own.

// A global allocator is an unsafe trait by nature; this one only counts and
// forwards every call unchanged, so it is as sound as the system's.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering};

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

thread_local! {
    /// What the work that this thread runs apart has allocated. Neither making it nor dropping it
    /// allocates.
    static APART: Cell<Option<Allocated>> = const { Cell::new(None) };
}

/// What some work has allocated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Allocated {
    /// Allocations and re-allocations.
    pub count: u64,
    /// Their sizes, added up: at least as much as was in use at any time.
    pub bytes: usize,
}

/// The system's allocator, with a counter in front of it.
pub struct CountingAllocator;

// SAFETY: every method passes its arguments on to `System` unchanged, which
// upholds the contract of `GlobalAlloc`.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: the caller's promises are the ones that `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        // SAFETY: as above.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(block, layout) }
    }
}

fn count(bytes: usize) {
    match APART.get() {
        Some(before) => APART.set(Some(Allocated {
            count: before.count + 1,
            bytes: before.bytes.saturating_add(bytes),
        })),
        None => {
            ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// Allocations and re-allocations of the whole process so far, without those that were counted
/// [`apart`]; stays 0 where [`CountingAllocator`] is not the global allocator.
#[must_use]
pub fn allocations() -> u64 {
    ALLOCATIONS.load(Ordering::Relaxed)
}

/// Runs work that is known to allocate on this thread; returns its result and what it allocated,
/// which [`allocations`] leaves out.
pub fn apart<T>(work: impl FnOnce() -> T) -> (T, Allocated) {
    let around = APART.replace(Some(Allocated::default()));
    let result = work();
    (result, APART.replace(around).unwrap_or_default())
}
