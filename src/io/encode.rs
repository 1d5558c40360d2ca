//! Many like records to bytes: chunks are encoded side by side, and written in order while the next ones are encoded.

use std::io::{self, Write};
use std::ops::Range;

use rayon::prelude::*;

/// Records that one task encodes; fixed, so that the work is divided the same way at any number of threads.
const CHUNK: usize = 16_384;
/// Chunks that are encoded while as many before them are written. With 50 to 100 bytes per record that is some 20 MB, whatever the mesh.
const BATCH: usize = 8;

/// Writes records `0..count`: `encode` appends the bytes of a range of them.
///
/// The bytes are those of `encode(0..count)`, provided that a record's bytes do not depend on the range it is in.
///
/// # Errors
/// Those of `out`.
pub(super) fn write_records(
    out: &mut (dyn Write + Send),
    count: usize,
    encode: &(dyn Fn(Range<usize>, &mut Vec<u8>) + Sync),
) -> io::Result<()> {
    let buffers = || vec![Vec::<u8>::new(); BATCH.min(count.div_ceil(CHUNK))];
    let (mut ready, mut next) = (buffers(), buffers());
    let mut write = |ready: &[Vec<u8>]| ready.iter().try_for_each(|bytes| out.write_all(bytes));
    for first in (0..count).step_by(BATCH * CHUNK) {
        let encode_next = || {
            next.par_iter_mut().enumerate().for_each(|(chunk, bytes)| {
                let start = (first + chunk * CHUNK).min(count);
                bytes.clear();
                encode(start..(start + CHUNK).min(count), bytes);
            });
        };
        let (written, ()) = rayon::join(|| write(&ready), encode_next);
        written?;
        std::mem::swap(&mut ready, &mut next);
    }
    write(&ready)
}

/// Appends numbers, least significant byte first.
pub(super) fn push_f32<const N: usize>(bytes: &mut Vec<u8>, values: [f32; N]) {
    bytes.extend_from_slice(values.map(f32::to_le_bytes).as_flattened());
}

/// Appends numbers as the shortest text that reads back exactly, a blank before each.
pub(super) fn push_numbers<const N: usize>(text: &mut Vec<u8>, values: [f32; N]) {
    let mut digits = zmij::Buffer::new();
    for value in values {
        text.push(b' ');
        text.extend_from_slice(digits.format(value).as_bytes());
    }
}

/// Appends a whole number as text.
pub(super) fn push_integer(text: &mut Vec<u8>, value: u64) {
    text.extend_from_slice(itoa::Buffer::new().format(value).as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_written_in_order_whatever_their_number() {
        for count in [0, 1, CHUNK, CHUNK + 1, 2 * BATCH * CHUNK + 7] {
            let encode = |range: Range<usize>, bytes: &mut Vec<u8>| range.for_each(|n| push_f32(bytes, [n as f32]));
            let (mut found, mut expected) = (Vec::new(), Vec::new());
            write_records(&mut found, count, &encode).unwrap();
            encode(0..count, &mut expected);
            assert!(found == expected, "{count} records");
        }
    }

    /// Takes so many bytes, then is full.
    struct Full(usize);

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let left = self.0.checked_sub(bytes.len()).ok_or(io::ErrorKind::StorageFull)?;
            self.0 = left;
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_full_disk_is_told_wherever_it_fills_up() {
        let count = 2 * BATCH * CHUNK + 7;
        let encode = |range: Range<usize>, bytes: &mut Vec<u8>| range.for_each(|n| push_f32(bytes, [n as f32]));
        write_records(&mut Full(4 * count), count, &encode).unwrap();
        for room in [0, 4 * CHUNK, 4 * BATCH * CHUNK, 4 * count - 1] {
            let found = write_records(&mut Full(room), count, &encode).unwrap_err().kind();
            assert_eq!(found, io::ErrorKind::StorageFull, "{room} bytes");
        }
    }
}
