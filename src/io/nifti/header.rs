//! The bytes of a NIfTI-1 or NIfTI-2 header as one struct. Nothing is judged here beyond "is this such a header?".
//!
//! Sources: the NIfTI-1 data format (nifti1.h, 2007) and NIfTI-2 (nifti2.h, 2011) of the NIfTI Data Format Working
//! Group. Both versions hold the same fields at other offsets and widths; the wider ones are kept.

use super::info::{ByteOrder, NiftiVersion};

/// Bytes of a NIfTI-1 header without extensions.
pub(super) const NIFTI1_SIZE: usize = 348;
/// Bytes of a NIfTI-2 header without extensions.
pub(super) const NIFTI2_SIZE: usize = 540;

/// The fields that matter, as stored.
#[derive(Debug, Clone)]
pub(super) struct Header {
    pub(super) version: NiftiVersion,
    pub(super) order: ByteOrder,
    /// Header and voxels in one file (magic `n+1`, `n+2`), not a pair (`ni1`, `ni2`).
    pub(super) single_file: bool,
    pub(super) dim: [i64; 8],
    pub(super) datatype: i16,
    pub(super) bitpix: i16,
    pub(super) pixdim: [f64; 8],
    /// f32 in NIfTI-1, i64 in NIfTI-2; f64 holds every offset below 2^53 exactly.
    pub(super) vox_offset: f64,
    pub(super) slope: f64,
    pub(super) intercept: f64,
    pub(super) xyzt_units: i32,
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    pub(super) quaternion: [f64; 3],
    pub(super) qoffset: [f64; 3],
    pub(super) srow: [[f64; 4]; 3],
    pub(super) description: String,
}

/// Why bytes are not a header.
#[derive(Debug, PartialEq)]
pub(super) enum NotAHeader {
    /// Fewer bytes than the version needs.
    Short { expected: usize },
    /// Something else: what it looks like.
    Foreign(String),
}

/// Version and byte order by `sizeof_hdr`, which is 348 or 540 in one of the two orders.
pub(super) fn recognise(bytes: &[u8]) -> Option<(NiftiVersion, ByteOrder)> {
    let first: [u8; 4] = bytes.get(..4)?.try_into().ok()?;
    for (order, size) in [(ByteOrder::Little, i32::from_le_bytes(first)), (ByteOrder::Big, i32::from_be_bytes(first))] {
        match usize::try_from(size) {
            Ok(NIFTI1_SIZE) => return Some((NiftiVersion::One, order)),
            Ok(NIFTI2_SIZE) => return Some((NiftiVersion::Two, order)),
            _ => {}
        }
    }
    None
}

impl Header {
    /// Reads the fields from the first bytes of a file; bytes after the header are ignored.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, NotAHeader> {
        let Some((version, order)) = recognise(bytes) else {
            return if bytes.len() < 4 {
                Err(NotAHeader::Short { expected: NIFTI1_SIZE })
            } else {
                Err(NotAHeader::Foreign(describe(bytes)))
            };
        };
        let expected = match version {
            NiftiVersion::One => NIFTI1_SIZE,
            NiftiVersion::Two => NIFTI2_SIZE,
        };
        let Some(bytes) = bytes.get(..expected) else { return Err(NotAHeader::Short { expected }) };
        let single_file = match (version, magic(bytes, version)) {
            (NiftiVersion::One, [b'n', b'+', b'1', 0, ..]) | (NiftiVersion::Two, b"n+2\0\r\n\x1a\n") => true,
            (NiftiVersion::One, [b'n', b'i', b'1', 0, ..]) | (NiftiVersion::Two, b"ni2\0\r\n\x1a\n") => false,
            (NiftiVersion::One, [0, 0, 0, 0]) => {
                return Err(NotAHeader::Foreign("an ANALYZE 7.5 header (no magic, no orientation)".into()));
            }
            (_, other) => {
                return Err(NotAHeader::Foreign(format!(
                    "{version} sizeof_hdr but magic \"{}\"",
                    other.escape_ascii()
                )));
            }
        };
        let fields = Fields { bytes, order };
        Ok(match version {
            NiftiVersion::One => fields.version_1(single_file),
            NiftiVersion::Two => fields.version_2(single_file),
        })
    }
}

fn magic(bytes: &[u8], version: NiftiVersion) -> &[u8] {
    match version {
        NiftiVersion::One => &bytes[344..348],
        NiftiVersion::Two => &bytes[4..12],
    }
}

/// A name for content that is not NIfTI: the formats people confuse with it, or the bytes themselves.
fn describe(bytes: &[u8]) -> String {
    let starts = |prefix: &[u8]| bytes.starts_with(prefix);
    if bytes.get(128..132) == Some(b"DICM") {
        "a DICOM file".into()
    } else if starts(b"NRRD000") {
        "an NRRD file".into()
    } else if starts(b"ObjectType") || starts(b"NDims") {
        "a MetaImage file".into()
    } else if starts(b"\x93NUMPY") {
        "a NumPy file".into()
    } else if starts(b"PK\x03\x04") {
        "a zip archive".into()
    } else {
        format!("bytes \"{}\"", bytes[..bytes.len().min(8)].escape_ascii())
    }
}

/// Numbers at byte offsets of a complete header.
struct Fields<'a> {
    bytes: &'a [u8],
    order: ByteOrder,
}

impl Fields<'_> {
    fn raw<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut raw = [0; N];
        raw.copy_from_slice(&self.bytes[at..at + N]);
        if self.order == ByteOrder::Big {
            raw.reverse();
        }
        raw
    }

    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.raw(at))
    }

    fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.raw(at))
    }

    fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.raw(at))
    }

    fn f32(&self, at: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.raw(at)))
    }

    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.raw(at))
    }

    /// Text up to the first NUL, control characters dropped.
    fn text(&self, at: usize, length: usize) -> String {
        let field = &self.bytes[at..at + length];
        let end = field.iter().position(|b| *b == 0).unwrap_or(length);
        String::from_utf8_lossy(&field[..end]).chars().filter(|c| !c.is_control()).collect::<String>().trim().to_owned()
    }

    fn version_1(&self, single_file: bool) -> Header {
        let f32s = |at: usize, index: usize| self.f32(at + 4 * index);
        Header {
            version: NiftiVersion::One,
            order: self.order,
            single_file,
            dim: std::array::from_fn(|i| i64::from(self.i16(40 + 2 * i))),
            datatype: self.i16(70),
            bitpix: self.i16(72),
            pixdim: std::array::from_fn(|i| f32s(76, i)),
            vox_offset: self.f32(108),
            slope: self.f32(112),
            intercept: self.f32(116),
            xyzt_units: i32::from(self.bytes[123]),
            qform_code: i32::from(self.i16(252)),
            sform_code: i32::from(self.i16(254)),
            quaternion: std::array::from_fn(|i| f32s(256, i)),
            qoffset: std::array::from_fn(|i| f32s(268, i)),
            srow: std::array::from_fn(|row| std::array::from_fn(|column| f32s(280, 4 * row + column))),
            description: self.text(148, 80),
        }
    }

    fn version_2(&self, single_file: bool) -> Header {
        let f64s = |at: usize, index: usize| self.f64(at + 8 * index);
        Header {
            version: NiftiVersion::Two,
            order: self.order,
            single_file,
            dim: std::array::from_fn(|i| self.i64(16 + 8 * i)),
            datatype: self.i16(12),
            bitpix: self.i16(14),
            pixdim: std::array::from_fn(|i| f64s(104, i)),
            vox_offset: self.i64(168) as f64,
            slope: self.f64(176),
            intercept: self.f64(184),
            xyzt_units: self.i32(500),
            qform_code: self.i32(344),
            sform_code: self.i32(348),
            quaternion: std::array::from_fn(|i| f64s(352, i)),
            qoffset: std::array::from_fn(|i| f64s(376, i)),
            srow: std::array::from_fn(|row| std::array::from_fn(|column| f64s(400, 4 * row + column))),
            description: self.text(240, 80),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn version_and_order_come_from_the_first_four_bytes() {
        assert_eq!(recognise(&348i32.to_be_bytes()), Some((NiftiVersion::One, ByteOrder::Big)));
        assert_eq!(recognise(&540i32.to_le_bytes()), Some((NiftiVersion::Two, ByteOrder::Little)));
        assert_eq!(recognise(&349i32.to_le_bytes()), None);
        assert_eq!(recognise(&[92, 1, 0]), None);
    }

    #[test]
    fn foreign_content_is_named() {
        let found = |bytes: &[u8]| match Header::parse(bytes) {
            Err(NotAHeader::Foreign(found)) => found,
            other => panic!("{other:?}"),
        };
        assert!(found(b"NRRD0005\ntype: short\n").contains("NRRD"));
        let mut dicom = vec![0; 200];
        dicom[128..132].copy_from_slice(b"DICM");
        assert!(found(&dicom).contains("DICOM"));
        let mut analyze = vec![0; NIFTI1_SIZE];
        analyze[..4].copy_from_slice(&348i32.to_le_bytes());
        assert!(found(&analyze).contains("ANALYZE"));
        analyze[344..348].copy_from_slice(b"n+3\0");
        assert!(found(&analyze).contains("n+3"), "{}", found(&analyze));
        assert_eq!(Header::parse(&[]).unwrap_err(), NotAHeader::Short { expected: NIFTI1_SIZE });
        assert_eq!(Header::parse(&540i32.to_be_bytes()).unwrap_err(), NotAHeader::Short { expected: NIFTI2_SIZE });
    }
}
