//! The allocation counter counts, on which "no allocation after the first frame" rests.

use plumbline_board::allocation::{CountingAllocator, allocations};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn allocations_are_counted() {
    let before = allocations();
    let boxed = std::hint::black_box(Box::new(7));
    let zeroed = std::hint::black_box(vec![0_u8; 100]);
    let mut grown = std::hint::black_box(Vec::<u8>::with_capacity(1));
    grown.extend_from_slice(&[1; 50]);
    // Box, zeroed, with_capacity, and its growth; the test harness may add its own.
    assert!(allocations() - before >= 4);
    drop((boxed, zeroed, grown));
}
