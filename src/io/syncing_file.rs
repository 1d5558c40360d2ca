//! A file that goes to the disk while it is being written.
//!
//! Its bytes are asked for on the disk at the end in any case. Left until then, the time the disk takes would come on top of the
//! time it takes to make them.

use std::fs::File;
use std::io::{self, Write};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};

/// Bytes after which the new part of a file is sent to the disk. Large enough that asking does not count; smaller files need no thread.
const PART: usize = 4 << 20;

/// See the module.
#[derive(Debug)]
pub struct SyncingFile {
    file: File,
    /// Bytes since the last part.
    waiting: usize,
    syncing: Option<Syncing>,
}

/// A thread that syncs the file whenever it is asked to, until nobody can ask any more.
#[derive(Debug)]
struct Syncing {
    ask: SyncSender<()>,
    thread: JoinHandle<io::Result<()>>,
}

impl SyncingFile {
    pub(super) fn new(file: File) -> Self {
        Self { file, waiting: 0, syncing: None }
    }

    /// Waits until everything is on the disk.
    ///
    /// # Errors
    /// What the operating system said now or before.
    pub(super) fn finish(self) -> io::Result<()> {
        if let Some(Syncing { ask, thread }) = self.syncing {
            drop(ask);
            thread.join().expect("syncing does not panic")?;
        }
        self.file.sync_all()
    }

    /// Asks for what there is so far to be synced. Where that cannot be done, there is more to do at the end.
    fn sync_behind(&mut self) {
        if self.syncing.is_none() {
            self.syncing = self.file.try_clone().and_then(Syncing::start).ok();
        }
        // Refused while two parts are on their way already, and after an error, which `finish` tells.
        if self.syncing.as_ref().is_some_and(|syncing| syncing.ask.try_send(()).is_ok()) {
            self.waiting = 0;
        }
    }
}

impl Syncing {
    fn start(file: File) -> io::Result<Self> {
        let (ask, asked) = sync_channel(1);
        let thread = Builder::new()
            .name("yawara-sync".to_owned())
            .spawn(move || asked.into_iter().try_for_each(|()| file.sync_data()))?;
        Ok(Self { ask, thread })
    }
}

impl Write for SyncingFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.waiting += written;
        if self.waiting >= PART {
            self.sync_behind();
        }
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_arrive_in_order_whatever_their_size() {
        for length in [1, PART - 1, PART, 3 * PART + 5] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("f");
            let mut file = SyncingFile::new(File::create(&path).unwrap());
            let bytes: Vec<u8> = (0..length).map(|n| (n % 251) as u8).collect();
            bytes.chunks(1 << 19).for_each(|part| file.write_all(part).unwrap());
            assert_eq!(file.syncing.is_some(), length >= PART, "{length} bytes");
            file.finish().unwrap();
            assert!(std::fs::read(&path).unwrap() == bytes, "{length} bytes");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_the_disk_said_meanwhile_is_told_at_the_end() {
        // Takes every byte, and can not be synced.
        let mut file = SyncingFile::new(File::options().write(true).open("/dev/null").unwrap());
        (0..64).for_each(|_| file.write_all(&[0; 1 << 20]).unwrap());
        assert_eq!(file.finish().unwrap_err().kind(), io::ErrorKind::InvalidInput);
    }
}
