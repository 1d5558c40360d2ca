//! Bytes of a file, gzip or not, and the names of `.hdr`/`.img` pairs.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use flate2::bufread::MultiGzDecoder;

use super::error::ReadVolumeError;

/// Deflate cannot make data more than 1032 times smaller (258 bytes from 2 bits), so a gzip file's size bounds what it
/// can unpack to.
const MAX_DEFLATE_RATIO: u64 = 1032;
const BUFFER: usize = 1 << 18;

/// A file read from front to back; gzip is recognised by its first two bytes.
pub(super) struct Source {
    path: PathBuf,
    stream: Stream,
    /// Unpacked bytes read so far.
    position: u64,
    /// The most bytes that can come out.
    capacity: u64,
}

enum Stream {
    Plain(BufReader<File>),
    Gzip(Box<MultiGzDecoder<BufReader<File>>>),
}

impl Source {
    pub(super) fn open(path: &Path) -> Result<Self, ReadVolumeError> {
        let io_error = |source| ReadVolumeError::Io { path: path.into(), source };
        // Before opening: opening a pipe would wait for its writer.
        let kind = std::fs::metadata(path).map_err(io_error)?;
        if !kind.is_file() {
            let found = if kind.is_dir() { "a folder" } else { "a pipe or device" };
            return Err(ReadVolumeError::NotAFile { path: path.into(), found });
        }
        let file = File::open(path).map_err(io_error)?;
        let length = file.metadata().map_err(io_error)?.len();
        let mut reader = BufReader::with_capacity(BUFFER, file);
        let gzip = reader.fill_buf().map_err(io_error)?.starts_with(&[0x1f, 0x8b]);
        let (stream, capacity) = if gzip {
            (Stream::Gzip(Box::new(MultiGzDecoder::new(reader))), length.saturating_mul(MAX_DEFLATE_RATIO))
        } else {
            (Stream::Plain(reader), length)
        };
        Ok(Self { path: path.into(), stream, position: 0, capacity })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn is_gzip(&self) -> bool {
        matches!(self.stream, Stream::Gzip(_))
    }

    /// Unpacked bytes read so far.
    pub(super) fn position(&self) -> u64 {
        self.position
    }

    /// The most bytes that can come out: the size of a plain file, a bound for a gzip file.
    pub(super) fn capacity(&self) -> u64 {
        self.capacity
    }

    /// Fills `buffer` as far as the file goes and returns how far that was.
    pub(super) fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ReadVolumeError> {
        let mut filled = 0;
        while filled < buffer.len() {
            let rest = &mut buffer[filled..];
            let result = match &mut self.stream {
                Stream::Plain(reader) => reader.read(rest),
                Stream::Gzip(reader) => reader.read(rest),
            };
            match result {
                Ok(0) => break,
                Ok(count) => {
                    filled += count;
                    self.position += count as u64;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(source) => return Err(self.failed(source)),
            }
        }
        Ok(filled)
    }

    /// Reads on to an offset from the start of the (unpacked) file; the position tells whether it was reached.
    pub(super) fn skip_to(&mut self, offset: u64) -> Result<(), ReadVolumeError> {
        let mut scratch = [0; 4096];
        while self.position < offset {
            let step = usize::try_from(offset - self.position).map_or(scratch.len(), |left| left.min(scratch.len()));
            if self.read(&mut scratch[..step])? < step {
                break;
            }
        }
        Ok(())
    }

    /// Reads a gzip stream to its end, which is where its checksum is; a plain file may have anything after its voxels.
    pub(super) fn finish(mut self) -> Result<(), ReadVolumeError> {
        if self.is_gzip() {
            let mut scratch = vec![0; BUFFER];
            while self.read(&mut scratch)? == scratch.len() {}
        }
        Ok(())
    }

    fn failed(&self, source: io::Error) -> ReadVolumeError {
        use io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
        let path = self.path.clone();
        match source.kind() {
            InvalidData | InvalidInput | UnexpectedEof if self.is_gzip() => {
                ReadVolumeError::Gzip { path, after: self.position, source }
            }
            _ => ReadVolumeError::Io { path, source },
        }
    }
}

/// What a file name promises, `.gz` and letter case aside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// `.hdr`: the header half of a pair.
    Header,
    /// `.img`: the voxel half of a pair.
    Image,
    /// Anything else.
    Other,
}

impl Part {
    pub(super) fn of(path: &Path) -> Self {
        let (stem, _) = without_extension(path, "gz");
        if without_extension(&stem, "hdr").1 {
            Self::Header
        } else if without_extension(&stem, "img").1 {
            Self::Image
        } else {
            Self::Other
        }
    }
}

/// The other half of a pair, packed like the given half if there is such a file, else the other way.
pub(super) fn other_half(path: &Path, extension: &str) -> Result<PathBuf, ReadVolumeError> {
    let (unpacked, gzip) = without_extension(path, "gz");
    let (stem, _) = without_extension(&unpacked, unpacked.extension().and_then(|e| e.to_str()).unwrap_or(""));
    let upper = unpacked.extension().is_some_and(|e| e.to_string_lossy().chars().all(|c| c.is_ascii_uppercase()));
    let cased = |text: &str| if upper { text.to_ascii_uppercase() } else { text.to_owned() };
    let plain = with_suffix(&stem, &cased(&format!(".{extension}")));
    let packed = [with_suffix(&plain, ".gz"), with_suffix(&plain, ".GZ")];
    let candidates = if gzip { [&packed[0], &packed[1], &plain] } else { [&plain, &packed[0], &packed[1]] };
    match candidates.iter().find(|candidate| candidate.is_file()) {
        Some(found) => Ok(found.to_path_buf()),
        None => Err(ReadVolumeError::MissingPart { path: path.into(), missing: plain }),
    }
}

/// The path without this extension (any letter case), and whether it had it.
fn without_extension(path: &Path, extension: &str) -> (PathBuf, bool) {
    let has = path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension));
    if has { (path.with_extension(""), true) } else { (path.to_path_buf(), false) }
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name: OsString = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_the_part() {
        for (name, part) in [
            ("a.hdr", Part::Header),
            ("a.HDR.gz", Part::Header),
            ("a.b.img", Part::Image),
            ("a.img.GZ", Part::Image),
            ("a.nii.gz", Part::Other),
            ("hdr", Part::Other),
        ] {
            assert_eq!(Part::of(Path::new(name)), part, "{name}");
        }
    }

    #[test]
    fn the_other_half_is_found_packed_or_not() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["a.v1.img", "b.img.gz", "c.img", "c.img.gz", "D.IMG"] {
            std::fs::write(at(name), b"").unwrap();
        }
        assert_eq!(other_half(&at("a.v1.hdr"), "img").unwrap(), at("a.v1.img"));
        assert_eq!(other_half(&at("a.v1.hdr.gz"), "img").unwrap(), at("a.v1.img"));
        assert_eq!(other_half(&at("b.hdr"), "img").unwrap(), at("b.img.gz"));
        assert_eq!(other_half(&at("c.hdr.gz"), "img").unwrap(), at("c.img.gz"));
        assert_eq!(other_half(&at("c.hdr"), "img").unwrap(), at("c.img"));
        assert_eq!(other_half(&at("D.HDR"), "img").unwrap(), at("D.IMG"));
        let missing = other_half(&at("e.hdr"), "img").unwrap_err().to_string();
        assert!(missing.contains("e.hdr") && missing.contains("e.img"), "{missing}");
    }
}
