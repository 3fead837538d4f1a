//! The system's allocator, and the number of its allocations.
#![allow(unsafe_code, reason = "the trait of an allocator is unsafe; every call goes to the system's")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The allocator of these tests.
pub(crate) struct Counting;

static COUNT: AtomicUsize = AtomicUsize::new(0);

impl Counting {
    /// Number of allocations so far. A reallocation is one too.
    pub(crate) fn count() -> usize {
        COUNT.load(Ordering::Relaxed)
    }
}

// SAFETY: what the caller promises is what the system's allocator requires
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::Relaxed);
        unsafe { System.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        unsafe { System.dealloc(old, layout) }
    }
}
