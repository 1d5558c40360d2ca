//! A run written by a thread of its own, while stepping goes on.
//!
//! Packing a frame and waiting for the disk can take longer than computing it. What is handed over is written in order, so that the
//! files are those of [`RunWriter`] itself. At most [`WAITING`] jobs wait, then the caller does: memory does not grow however
//! slow the disk is.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};

use super::error::WriteRunError;
use super::manifest::Status;
use super::writer::{FrameData, RunWriter, check_finite};
use crate::cut::CutSheet;
use crate::lattice::SeveredSpring;

/// Jobs that may wait for the disk; a frame is one of them.
const WAITING: usize = 4;

/// Hands what a run leaves behind to a thread that writes it.
#[derive(Debug)]
pub struct BackgroundWriter {
    path: PathBuf,
    /// `None` once the thread has been waited for.
    worker: Option<Worker>,
    frames: usize,
    /// As they were last handed over: shared, for most frames cut nothing.
    severed: Arc<Vec<SeveredSpring>>,
    /// Vertices and quads of the sheet that was last handed over.
    sheet: (usize, usize),
}

#[derive(Debug)]
struct Worker {
    jobs: SyncSender<Job>,
    thread: JoinHandle<Result<RunWriter, WriteRunError>>,
}

/// What is to be written next.
enum Job {
    Frame { time_s: f64, step: u64, displacements_mm: Vec<[f32; 3]>, severed: Arc<Vec<SeveredSpring>> },
    Cuts(CutSheet),
    Series { name: String, unit: &'static str, values: Vec<f64> },
    Log(String),
}

impl BackgroundWriter {
    /// Goes on with a run.
    ///
    /// # Errors
    /// If the system has no thread left.
    pub fn new(writer: RunWriter) -> Result<Self, WriteRunError> {
        let (path, frames) = (writer.path().to_path_buf(), writer.frames());
        let (jobs, waiting) = sync_channel(WAITING);
        let thread = Builder::new()
            .name("run writer".to_owned())
            .spawn(move || write(writer, &waiting))
            .map_err(|error| WriteRunError::io(&path, error))?;
        let worker = Some(Worker { jobs, thread });
        Ok(Self { path, worker, frames, severed: Arc::default(), sheet: (0, 0) })
    }

    /// Adds a frame; see [`RunWriter::push_frame`].
    ///
    /// # Errors
    /// If it is not finite; it counts for nothing then. If something handed over before could not be written.
    pub fn push_frame(
        &mut self,
        (time_s, step): (f64, u64),
        displacements_mm: Vec<[f32; 3]>,
        severed: &[SeveredSpring],
    ) -> Result<(), WriteRunError> {
        check_finite(self.frames, &displacements_mm)?;
        if (severed.len(), severed.last()) != (self.severed.len(), self.severed.last()) {
            self.severed = Arc::new(severed.to_vec());
        }
        let severed = Arc::clone(&self.severed);
        self.frames += 1;
        self.hand_over(Job::Frame { time_s, step, displacements_mm, severed })
    }

    /// Adds what a sheet has gained since it was last given; see [`RunWriter::push_cuts`].
    ///
    /// # Errors
    /// If something handed over before could not be written.
    pub fn push_cuts(&mut self, sheet: &CutSheet) -> Result<(), WriteRunError> {
        let size = (sheet.vertices.len(), sheet.quads.len());
        if size == self.sheet {
            return Ok(());
        }
        self.sheet = size;
        self.hand_over(Job::Cuts(sheet.clone()))
    }

    /// Appends values to a named series; see [`RunWriter::push_series`].
    ///
    /// # Errors
    /// If something handed over before could not be written.
    pub fn push_series(&mut self, name: String, unit: &'static str, values: Vec<f64>) -> Result<(), WriteRunError> {
        self.hand_over(Job::Series { name, unit, values })
    }

    /// Appends a line to `log.txt`.
    ///
    /// # Errors
    /// If something handed over before could not be written.
    pub fn log(&mut self, line: &str) -> Result<(), WriteRunError> {
        self.hand_over(Job::Log(line.to_owned()))
    }

    /// Waits until all is written, and ends the run.
    ///
    /// # Errors
    /// If it cannot be written, or could not before.
    pub fn finish(mut self, status: Status) -> Result<(), WriteRunError> {
        match self.wait() {
            Some(writer) => writer?.finish(status),
            None => Err(WriteRunError::GivenUp { path: self.path.clone() }),
        }
    }

    /// What the thread could not write is told once; after that nothing is.
    fn hand_over(&mut self, job: Job) -> Result<(), WriteRunError> {
        let Some(worker) = &self.worker else { return Ok(()) };
        match worker.jobs.send(job) {
            Ok(()) => Ok(()),
            Err(_) => self.wait().map_or(Ok(()), |writer| writer.map(drop)),
        }
    }

    /// What came of the thread; `None` when that was told already.
    fn wait(&mut self) -> Option<Result<RunWriter, WriteRunError>> {
        let Worker { jobs, thread } = self.worker.take()?;
        drop(jobs);
        Some(thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    }
}

/// A run that is given up keeps the frames it was handed.
impl Drop for BackgroundWriter {
    fn drop(&mut self) {
        if let Some(Worker { jobs, thread }) = self.worker.take() {
            drop(jobs);
            // Nobody is left to hear of an error; the frames committed before are safe.
            let _ = thread.join();
        }
    }
}

/// Writes jobs in order until there are no more, or one fails.
fn write(mut writer: RunWriter, jobs: &Receiver<Job>) -> Result<RunWriter, WriteRunError> {
    for job in jobs {
        match job {
            Job::Frame { time_s, step, displacements_mm, severed } => {
                writer.push_frame(FrameData {
                    time_s,
                    step,
                    displacements_mm: &displacements_mm,
                    severed: &severed,
                })?;
            }
            Job::Cuts(sheet) => writer.push_cuts(&sheet)?,
            Job::Series { name, unit, values } => writer.push_series(&name, unit, &values)?,
            Job::Log(line) => writer.log(&line)?,
        }
    }
    Ok(writer)
}
