//! How a chunk's bytes are packed: byte shuffle and zstd in a Blosc 1 frame, then a CRC-32C.
//!
//! Of the codecs that every Zarr version 3 reader knows, Blosc is the one that shuffles: the first bytes of all numbers,
//! then the second bytes, and so on, which lets zstd find the equal exponents of neighbouring numbers. A frame is a header
//! of 16 bytes, the offset of each block, and per block its packed length and bytes (c-blosc, "README_CHUNK_FORMAT").
//! Blocks are packed in parallel; the bytes do not depend on the number of threads.

use rayon::prelude::*;

#[cfg(target_endian = "big")]
compile_error!("the run directory is written in the machine's own byte order, which must be little endian");

/// Level of zstd: higher ones cost several times the time for a few per cent.
pub(super) const LEVEL: i32 = 1;
/// Bytes per block, a multiple of every number's size.
const BLOCK: usize = 1 << 20;
/// Most bytes of a chunk before packing, below the format's signed 32 bits.
pub(super) const MOST_BYTES: usize = (1 << 31) - (1 << 21);

const HEADER: usize = 16;
const FORMAT_VERSION: u8 = 2;
const ZSTD_VERSION: u8 = 1;
const SHUFFLED: u8 = 0x01;
/// Each block is one stream, not one per byte of a number.
const WHOLE_BLOCKS: u8 = 0x10;
const ZSTD: u8 = 4 << 5;

/// Packs the bytes of numbers of `size` bytes each.
///
/// # Panics
/// If there are more than [`MOST_BYTES`] (the callers choose chunks that fit), or zstd runs out of memory.
pub(super) fn pack(bytes: &[u8], size: usize) -> Vec<u8> {
    assert!(bytes.len() <= MOST_BYTES);
    let blocks: Vec<Vec<u8>> = bytes
        .par_chunks(BLOCK)
        .map(|block| {
            let shuffled = shuffle(block, size);
            let packed = zstd::bulk::compress(&shuffled, LEVEL).expect("zstd packs any bytes");
            // A stream as long as its block is taken as it is.
            if packed.len() < block.len() { packed } else { shuffled }
        })
        .collect();
    let table = HEADER + 4 * blocks.len();
    let total = table + blocks.iter().map(|b| 4 + b.len()).sum::<usize>();
    let mut frame = Vec::with_capacity(total + 4);
    let flags = ZSTD | WHOLE_BLOCKS | if size > 1 { SHUFFLED } else { 0 };
    frame.extend([FORMAT_VERSION, ZSTD_VERSION, flags, size as u8]);
    frame.extend((bytes.len() as u32).to_le_bytes());
    frame.extend((bytes.len().min(BLOCK) as u32).to_le_bytes());
    frame.extend((total as u32).to_le_bytes());
    let mut start = table;
    for block in &blocks {
        frame.extend((start as u32).to_le_bytes());
        start += 4 + block.len();
    }
    for block in &blocks {
        frame.extend((block.len() as u32).to_le_bytes());
        frame.extend(block);
    }
    frame.extend(crc32c::crc32c(&frame).to_le_bytes());
    frame
}

/// Unpacks what [`pack`] made of `expected` bytes; the message says what is wrong.
pub(super) fn unpack(file: &[u8], expected: usize, size: usize) -> Result<Vec<u8>, String> {
    let Some((frame, checksum)) = file.split_last_chunk::<4>().filter(|(frame, _)| frame.len() >= HEADER) else {
        return Err(format!("{} bytes are too few for a chunk", file.len()));
    };
    let (found, stored) = (crc32c::crc32c(frame), u32::from_le_bytes(*checksum));
    if found != stored {
        return Err(format!("its CRC-32C is {found:08x}, the file says {stored:08x}"));
    }
    let word = |at: usize| -> Result<usize, String> {
        let bytes = frame.get(at..at + 4).ok_or_else(|| format!("it ends before byte {}", at + 4))?;
        Ok(u32::from_le_bytes(bytes.try_into().expect("four bytes")) as usize)
    };
    let flags = ZSTD | WHOLE_BLOCKS | if size > 1 { SHUFFLED } else { 0 };
    if frame[..4] != [FORMAT_VERSION, ZSTD_VERSION, flags, size as u8] {
        return Err(format!("its header {:02x?} is not of a Blosc frame as this program writes them", &frame[..4]));
    }
    if [word(4)?, word(8)?, word(12)?] != [expected, expected.min(BLOCK), frame.len()] {
        return Err(format!("it holds {} bytes in {}, expected {expected} in {}", word(4)?, word(12)?, frame.len()));
    }
    // A block takes at least 8 bytes of the file, so the file's own size bounds what is reserved below.
    let blocks = expected.div_ceil(BLOCK);
    word(HEADER + (4 * blocks).saturating_sub(4))?;
    let mut bytes = vec![0; expected];
    bytes.par_chunks_mut(BLOCK).enumerate().try_for_each(|(number, block)| {
        let start = word(HEADER + 4 * number)?;
        let length = word(start)?;
        let packed = frame.get(start + 4..start + 4 + length).ok_or_else(|| format!("block {number} is cut off"))?;
        let shuffled = if length == block.len() {
            packed.to_vec()
        } else {
            zstd::bulk::decompress(packed, block.len()).map_err(|e| format!("block {number}: {e}"))?
        };
        if shuffled.len() != block.len() {
            return Err(format!("block {number} holds {} bytes, expected {}", shuffled.len(), block.len()));
        }
        unshuffle(&shuffled, size, block);
        Ok(())
    })?;
    Ok(bytes)
}

fn shuffle(block: &[u8], size: usize) -> Vec<u8> {
    let count = block.len() / size;
    let mut out = vec![0; block.len()];
    for (byte, plane) in out.chunks_exact_mut(count.max(1)).enumerate().take(size) {
        for (to, number) in plane.iter_mut().zip(block.chunks_exact(size)) {
            *to = number[byte];
        }
    }
    out
}

fn unshuffle(shuffled: &[u8], size: usize, block: &mut [u8]) {
    let count = block.len() / size;
    for (byte, plane) in shuffled.chunks_exact(count.max(1)).enumerate().take(size) {
        for (number, from) in block.chunks_exact_mut(size).zip(plane) {
            number[byte] = *from;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(count: usize) -> Vec<u8> {
        (0..count as u32).flat_map(|n| (n as f32 * 0.37).sin().to_le_bytes()).collect()
    }

    #[test]
    fn packing_is_lossless_for_every_size_and_length() {
        for count in [1, 7, 262_144, 262_145, 700_001] {
            let bytes = bytes(count);
            for size in [1, 2, 4] {
                assert_eq!(unpack(&pack(&bytes, size), bytes.len(), size).unwrap(), bytes, "{count} x {size}");
            }
        }
        // Noise does not shrink, and is kept as it is.
        let noise: Vec<u8> =
            (0..5000_u64).map(|n| (n.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 56) as u8 ^ n as u8).collect();
        assert_eq!(unpack(&pack(&noise, 8), noise.len(), 8).unwrap(), noise);
    }

    #[test]
    fn any_flipped_bit_and_any_cut_is_noticed() {
        let bytes = bytes(300);
        let packed = pack(&bytes, 4);
        for at in 0..packed.len() {
            let mut flipped = packed.clone();
            flipped[at] ^= 1 << (at % 8);
            assert!(unpack(&flipped, bytes.len(), 4).is_err(), "byte {at}");
            assert!(unpack(&packed[..at], bytes.len(), 4).is_err(), "cut at {at}");
        }
        assert!(unpack(&packed, bytes.len() + 4, 4).unwrap_err().contains("1204"));
        assert!(unpack(&packed, bytes.len(), 8).is_err());
    }

    #[test]
    fn a_hostile_frame_with_a_right_checksum_is_refused_not_believed() {
        let bytes = bytes(300);
        let packed = pack(&bytes, 4);
        for at in 0..packed.len() - 4 {
            for value in [0x00, 0x7f, 0xff] {
                let mut forged = packed[..packed.len() - 4].to_vec();
                forged[at] = value;
                let crc = crc32c::crc32c(&forged).to_le_bytes();
                forged.extend(crc);
                // Right, wrong content, or an error, but never a panic or a huge allocation.
                let _ = unpack(&forged, bytes.len(), 4).map(|b| assert_eq!(b.len(), bytes.len()));
            }
        }
    }
}
