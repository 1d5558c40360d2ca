//! What each thread keeps from step to step, so that a step reserves no memory.

use std::sync::{Mutex, MutexGuard};

use super::effects::fibres::FibreScratch;
use super::effects::inner_springs::InnerScratch;
use super::springs::Scratch;
use super::volume::CellScratch;

/// Buffers of one thread.
pub(super) struct Worker {
    pub(super) scratch: Box<Scratch>,
    /// Made by the first block that has cells with a volume term.
    pub(super) cells: Option<Box<CellScratch>>,
    /// Made by the first block with fibres.
    pub(super) fibres: Option<Box<FibreScratch>>,
    /// Made by the first block with springs that relax, yield or tear.
    pub(super) inner: Option<Box<InnerScratch>>,
}

impl Default for Worker {
    fn default() -> Self {
        Self { scratch: Scratch::new(), cells: None, fibres: None, inner: None }
    }
}

/// One [`Worker`] per thread; a lock is held for one block and never waited for.
#[derive(Default)]
pub(super) struct Workers(Vec<Mutex<Worker>>);

impl Workers {
    /// As many as the present pool has threads.
    pub(super) fn prepare(&mut self) {
        let threads = rayon::current_num_threads();
        if self.0.len() < threads {
            self.0.resize_with(threads, Mutex::default);
        }
    }

    /// Those of this thread.
    pub(super) fn own(&self) -> MutexGuard<'_, Worker> {
        let thread = rayon::current_thread_index().unwrap_or(0);
        // What a thread that panicked left behind is written before it is read.
        self.0[thread].lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

/// Buffers are not copied.
impl Clone for Workers {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl std::fmt::Debug for Workers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} workers", self.0.len())
    }
}
