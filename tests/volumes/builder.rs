//! A second, independent writer of NIfTI files: any version, byte order and type, right or wrong on purpose.
//!
//! Offsets and widths are those of nifti1.h and nifti2.h.

use std::io::Write;

/// Everything a header can say, and the voxels as numbers.
#[derive(Debug, Clone)]
pub(crate) struct Nifti {
    pub(crate) two: bool,
    pub(crate) big: bool,
    pub(crate) single: bool,
    pub(crate) dim: [i64; 8],
    pub(crate) datatype: i16,
    pub(crate) bitpix: i16,
    pub(crate) pixdim: [f64; 8],
    pub(crate) vox_offset: f64,
    pub(crate) slope: f64,
    pub(crate) inter: f64,
    pub(crate) units: u8,
    pub(crate) qform_code: i16,
    pub(crate) sform_code: i16,
    pub(crate) quatern: [f64; 3],
    pub(crate) qoffset: [f64; 3],
    pub(crate) srow: [[f64; 4]; 3],
    pub(crate) values: Vec<f64>,
}

/// Code and bits of every type, in the order the tests walk through them.
pub(crate) const TYPES: [(i16, i16); 10] =
    [(2, 8), (4, 16), (8, 32), (16, 32), (64, 64), (256, 8), (512, 16), (768, 32), (1024, 64), (1280, 64)];

impl Nifti {
    /// A sound little-endian NIfTI-1 file: values 0, 1, 2, ... as int16, spacing 1 x 2 x 3 mm, sform only.
    pub(crate) fn new(shape: [i64; 3]) -> Self {
        let [nx, ny, nz] = shape;
        Self {
            two: false,
            big: false,
            single: true,
            dim: [3, nx, ny, nz, 1, 1, 1, 1],
            datatype: 4,
            bitpix: 16,
            pixdim: [1.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0],
            vox_offset: 352.0,
            slope: 1.0,
            inter: 0.0,
            units: 2,
            qform_code: 0,
            sform_code: 1,
            quatern: [0.0; 3],
            qoffset: [0.0; 3],
            srow: [[1.0, 0.0, 0.0, -10.0], [0.0, 2.0, 0.0, 20.0], [0.0, 0.0, 3.0, 30.0]],
            values: (0..nx * ny * nz).map(|n| n as f64).collect(),
        }
    }

    /// The same as NIfTI-2.
    pub(crate) fn two(self) -> Self {
        Self { two: true, vox_offset: if self.single { 544.0 } else { 0.0 }, ..self }
    }

    /// The same with another type.
    pub(crate) fn typed(self, (datatype, bitpix): (i16, i16)) -> Self {
        Self { datatype, bitpix, ..self }
    }

    /// The bytes of one voxel.
    fn voxel(&self, value: f64) -> Vec<u8> {
        let mut bytes = match self.datatype {
            2 => (value as u8).to_le_bytes().to_vec(),
            4 => (value as i16).to_le_bytes().to_vec(),
            8 => (value as i32).to_le_bytes().to_vec(),
            16 => (value as f32).to_le_bytes().to_vec(),
            64 => value.to_le_bytes().to_vec(),
            256 => (value as i8).to_le_bytes().to_vec(),
            512 => (value as u16).to_le_bytes().to_vec(),
            768 => (value as u32).to_le_bytes().to_vec(),
            1024 => (value as i64).to_le_bytes().to_vec(),
            1280 => (value as u64).to_le_bytes().to_vec(),
            _ => vec![0; usize::try_from(self.bitpix).unwrap() / 8],
        };
        if self.big {
            bytes.reverse();
        }
        bytes
    }

    /// The voxels: what follows the header, or the `.img` of a pair.
    pub(crate) fn body(&self) -> Vec<u8> {
        self.values.iter().flat_map(|value| self.voxel(*value)).collect()
    }

    /// 348 or 540 bytes.
    pub(crate) fn header(&self) -> Vec<u8> {
        let mut out = Fields { bytes: vec![0; if self.two { 540 } else { 348 }], big: self.big };
        if self.two {
            out.put(0, 540i32.to_le_bytes());
            out.raw(4, if self.single { b"n+2\0\r\n\x1a\n" } else { b"ni2\0\r\n\x1a\n" });
            out.put(12, self.datatype.to_le_bytes());
            out.put(14, self.bitpix.to_le_bytes());
            (0..8).for_each(|i| out.put(16 + 8 * i, self.dim[i].to_le_bytes()));
            (0..8).for_each(|i| out.put(104 + 8 * i, self.pixdim[i].to_le_bytes()));
            out.put(168, (self.vox_offset as i64).to_le_bytes());
            out.put(176, self.slope.to_le_bytes());
            out.put(184, self.inter.to_le_bytes());
            out.put(344, i32::from(self.qform_code).to_le_bytes());
            out.put(348, i32::from(self.sform_code).to_le_bytes());
            (0..3).for_each(|i| out.put(352 + 8 * i, self.quatern[i].to_le_bytes()));
            (0..3).for_each(|i| out.put(376 + 8 * i, self.qoffset[i].to_le_bytes()));
            (0..12).for_each(|i| out.put(400 + 8 * i, self.srow[i / 4][i % 4].to_le_bytes()));
            out.put(500, i32::from(self.units).to_le_bytes());
        } else {
            out.put(0, 348i32.to_le_bytes());
            (0..8).for_each(|i| out.put(40 + 2 * i, (self.dim[i] as i16).to_le_bytes()));
            out.put(70, self.datatype.to_le_bytes());
            out.put(72, self.bitpix.to_le_bytes());
            (0..8).for_each(|i| out.put(76 + 4 * i, (self.pixdim[i] as f32).to_le_bytes()));
            out.put(108, (self.vox_offset as f32).to_le_bytes());
            out.put(112, (self.slope as f32).to_le_bytes());
            out.put(116, (self.inter as f32).to_le_bytes());
            out.raw(123, &[self.units]);
            out.put(252, self.qform_code.to_le_bytes());
            out.put(254, self.sform_code.to_le_bytes());
            (0..3).for_each(|i| out.put(256 + 4 * i, (self.quatern[i] as f32).to_le_bytes()));
            (0..3).for_each(|i| out.put(268 + 4 * i, (self.qoffset[i] as f32).to_le_bytes()));
            (0..12).for_each(|i| out.put(280 + 4 * i, (self.srow[i / 4][i % 4] as f32).to_le_bytes()));
            out.raw(344, if self.single { b"n+1\0" } else { b"ni1\0" });
        }
        out.bytes
    }

    /// Header and voxels in one file, zeros in between up to the first voxel (a sane `vox_offset` only).
    pub(crate) fn file(&self) -> Vec<u8> {
        let mut bytes = self.header();
        let minimum = bytes.len() + 4;
        let offset = self.vox_offset as usize;
        bytes.resize(if (minimum..minimum + 4096).contains(&offset) { offset } else { minimum }, 0);
        bytes.extend(self.body());
        bytes
    }
}

/// One gzip member.
pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

struct Fields {
    bytes: Vec<u8>,
    big: bool,
}

impl Fields {
    /// A number, given little-endian.
    fn put<const N: usize>(&mut self, at: usize, mut number: [u8; N]) {
        if self.big {
            number.reverse();
        }
        self.raw(at, &number);
    }

    fn raw(&mut self, at: usize, bytes: &[u8]) {
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
    }
}
