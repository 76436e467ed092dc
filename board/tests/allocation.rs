//! The allocation counter counts, on which "no allocation after the first frame" rests.
//!
//! One test, because the count is that of the whole process, and of the test runner too.

use std::hint::black_box;

use plumbline_board::allocation::{Allocated, CountingAllocator, allocations, apart};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn allocations_are_counted_and_those_apart_by_themselves() {
    let before = allocations();
    let boxed = black_box(Box::new(7));
    let zeroed = black_box(vec![0_u8; 100]);
    let mut grown = black_box(Vec::<u8>::with_capacity(1));
    grown.extend_from_slice(&[1; 50]);
    // Box, zeroed, with_capacity, and its growth; the test runner may add its own.
    assert!(allocations() - before >= 4);
    drop((boxed, zeroed, grown));

    let ((_, inside), outside) = apart(|| {
        let outer = black_box(Box::new(1));
        let inner = apart(|| black_box(vec![0_u8; 10]));
        drop(outer);
        inner
    });
    assert_eq!(inside, Allocated { count: 1, bytes: 10 });
    assert_eq!(outside, Allocated { count: 1, bytes: 4 });
    // The runner's thread allocates now and then, not each time.
    let is_left_out = || {
        let before = allocations();
        drop(apart(|| black_box(Box::new(7))));
        allocations() == before
    };
    assert!((0..100).any(|_| is_left_out()), "what is apart is counted with the rest");

    let before = allocations();
    let boxed = black_box(Box::new(7));
    assert!(allocations() > before, "counting goes on");
    drop(boxed);
}
