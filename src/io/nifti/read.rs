//! Header, then voxels, in one pass over the file.

use std::path::Path;

use super::AIR_HU;
use super::error::ReadVolumeError;
use super::header::{Header, NIFTI1_SIZE, NIFTI2_SIZE, NotAHeader, recognise};
use super::info::{ByteOrder, Datatype, NiftiVersion, Scaling, VolumeInfo};
use super::source::{Part, Source, other_half};
use super::{layout, orientation};
use crate::geometry::Grid;
use crate::volume::{CtVolume, LabelVolume};

/// Bytes converted at a time; a multiple of every voxel size.
const CHUNK: usize = 1 << 19;
/// Voxels to reserve for at most before a gzip stream has shown that it holds them.
const FIRST_RESERVE: usize = 1 << 22;

/// Reads the header alone. The size of a plain file is checked against it; the voxels of a gzip file are not looked at.
///
/// # Errors
/// [`ReadVolumeError`], everything but a broken gzip stream behind the header and a voxel that is no label.
pub fn read_info(path: &Path) -> Result<VolumeInfo, ReadVolumeError> {
    open(path).map(|(info, _)| info)
}

/// Reads a CT: any integer or float type, scaled by slope and intercept (in f64), as f32.
///
/// NaN and infinite voxels (and those beyond the range of f32) become [`AIR_HU`]; `replaced_voxels` of the info counts
/// them, and a program should warn when it is not 0.
///
/// # Errors
/// [`ReadVolumeError`]; no memory is reserved for sizes that the file cannot hold.
pub fn read_ct(path: &Path) -> Result<(CtVolume, VolumeInfo), ReadVolumeError> {
    let (mut info, source) = open(path)?;
    let (values, replaced) = match info.datatype {
        Datatype::U8 => ct::<u8>(&info, source),
        Datatype::I8 => ct::<i8>(&info, source),
        Datatype::U16 => ct::<u16>(&info, source),
        Datatype::I16 => ct::<i16>(&info, source),
        Datatype::U32 => ct::<u32>(&info, source),
        Datatype::I32 => ct::<i32>(&info, source),
        Datatype::U64 => ct::<u64>(&info, source),
        Datatype::I64 => ct::<i64>(&info, source),
        Datatype::F32 => ct::<f32>(&info, source),
        Datatype::F64 => ct::<f64>(&info, source),
    }?;
    info.replaced_voxels = replaced;
    Ok((CtVolume::from_vec(info.grid, values), info))
}

/// Reads a label map: whole numbers from 0 to 65 535, stored in any integer or float type.
///
/// Where slope and intercept apply, a value within their own f32 rounding of a whole number counts as it.
///
/// # Errors
/// [`ReadVolumeError`]; `NotALabel` gives the first voxel that is none (NaN included).
pub fn read_labels(path: &Path) -> Result<(LabelVolume, VolumeInfo), ReadVolumeError> {
    let (info, source) = open(path)?;
    let values = match info.datatype {
        Datatype::U8 => labels::<u8>(&info, source),
        Datatype::I8 => labels::<i8>(&info, source),
        Datatype::U16 => labels::<u16>(&info, source),
        Datatype::I16 => labels::<i16>(&info, source),
        Datatype::U32 => labels::<u32>(&info, source),
        Datatype::I32 => labels::<i32>(&info, source),
        Datatype::U64 => labels::<u64>(&info, source),
        Datatype::I64 => labels::<i64>(&info, source),
        Datatype::F32 => labels::<f32>(&info, source),
        Datatype::F64 => labels::<f64>(&info, source),
    }?;
    Ok((LabelVolume::from_vec(info.grid, values), info))
}

/// The checked header and the file that holds the voxels, not yet moved to the first of them.
fn open(path: &Path) -> Result<(VolumeInfo, Source), ReadVolumeError> {
    let header_path = match Part::of(path) {
        Part::Image => other_half(path, "hdr")?,
        Part::Header | Part::Other => path.to_path_buf(),
    };
    let mut source = Source::open(&header_path)?;
    let header = read_header(&mut source)?;
    // The half that was named stays; only the other one is searched.
    let source = match (header.single_file, Part::of(path)) {
        (true, _) => source,
        (false, Part::Image) => Source::open(path)?,
        (false, Part::Header | Part::Other) => Source::open(&other_half(&header_path, "img")?)?,
    };

    let shape = layout::shape(&header, &header_path)?;
    let datatype = layout::datatype(&header, &header_path)?;
    let scaling = layout::scaling(&header, &header_path)?;
    let unit = layout::unit(&header, &header_path)?;
    let (affine, affine_source) = orientation::affine(&header, shape, unit, &header_path)?;
    let bytes = layout::byte_count(shape, datatype, &header_path)?;
    let offset = layout::vox_offset(&header, source.path(), source.capacity())?;
    let info = VolumeInfo {
        header_path,
        data_path: source.path().to_path_buf(),
        version: header.version,
        byte_order: header.order,
        gzip: source.is_gzip(),
        datatype,
        grid: Grid { shape, affine },
        affine_source,
        scaling,
        unit,
        offset,
        description: header.description,
        replaced_voxels: 0,
    };
    if offset.saturating_add(bytes) > source.capacity() {
        return Err(truncated(&info, source.capacity()));
    }
    Ok((info, source))
}

fn read_header(source: &mut Source) -> Result<Header, ReadVolumeError> {
    let mut bytes = [0; NIFTI2_SIZE];
    let mut filled = source.read(&mut bytes[..NIFTI1_SIZE])?;
    if filled == NIFTI1_SIZE && matches!(recognise(&bytes), Some((NiftiVersion::Two, _))) {
        filled += source.read(&mut bytes[NIFTI1_SIZE..])?;
    }
    let path = source.path();
    Header::parse(&bytes[..filled]).map_err(|error| match error {
        NotAHeader::Short { expected } => {
            ReadVolumeError::ShortHeader { path: path.into(), found: filled as u64, expected: expected as u64 }
        }
        NotAHeader::Foreign(found) => ReadVolumeError::NotNifti { path: path.into(), found },
    })
}

fn truncated(info: &VolumeInfo, found: u64) -> ReadVolumeError {
    let bytes = info.shape().len() as u64 * info.datatype.size() as u64;
    ReadVolumeError::Truncated {
        path: info.data_path.clone(),
        found,
        expected: info.offset.saturating_add(bytes),
        shape: info.shape(),
        datatype: info.datatype,
        offset: info.offset,
    }
}

/// A number as NIfTI stores it.
trait Stored: Copy {
    const SIZE: usize;
    /// From exactly `SIZE` little-endian bytes.
    fn from_le(bytes: &[u8]) -> Self;
    fn to_f32(self) -> f32;
    fn to_f64(self) -> f64;
    fn to_label(self) -> Option<u16>;
}

macro_rules! stored {
    ($to_label:expr; $($number:ty),*) => {$(
        impl Stored for $number {
            const SIZE: usize = size_of::<Self>();

            #[inline(always)]
            fn from_le(bytes: &[u8]) -> Self {
                let mut raw = [0; size_of::<Self>()];
                raw.copy_from_slice(bytes);
                Self::from_le_bytes(raw)
            }

            #[inline(always)]
            fn to_f32(self) -> f32 {
                self as f32
            }

            #[inline(always)]
            fn to_f64(self) -> f64 {
                self as f64
            }

            #[inline(always)]
            fn to_label(self) -> Option<u16> {
                $to_label(self)
            }
        }
    )*};
}

stored!(|value: u8| Some(value.into()); u8);
stored!(Some; u16);
stored!(|value| u16::try_from(value).ok(); i8, i16, u32, i32, u64, i64);
stored!(|value| whole_number(Stored::to_f64(value), 0.0); f32, f64);

/// The label that `value` is, give or take `tolerance`.
fn whole_number(value: f64, tolerance: f64) -> Option<u16> {
    let label = value.round();
    // NaN fails both comparisons.
    ((value - label).abs() <= tolerance && (0.0..=65_535.0).contains(&label)).then_some(label as u16)
}

fn ct<T: Stored>(info: &VolumeInfo, source: Source) -> Result<(Vec<f32>, u64), ReadVolumeError> {
    let mut replaced = 0;
    let values = decode(info, source, |bytes, values: &mut Vec<f32>| {
        let start = values.len();
        let stored = bytes.chunks_exact(T::SIZE).map(T::from_le);
        match info.scaling {
            None => values.extend(stored.map(T::to_f32)),
            Some(Scaling { slope, intercept }) => {
                values.extend(stored.map(|value| (value.to_f64() * slope + intercept) as f32));
            }
        }
        for value in values[start..].iter_mut().filter(|value| !value.is_finite()) {
            *value = AIR_HU;
            replaced += 1;
        }
        Ok(())
    })?;
    Ok((values, replaced))
}

fn labels<T: Stored>(info: &VolumeInfo, source: Source) -> Result<Vec<u16>, ReadVolumeError> {
    let scaled = |value: T| match info.scaling {
        None => value.to_f64(),
        Some(Scaling { slope, intercept }) => value.to_f64() * slope + intercept,
    };
    let label = |value: T| match info.scaling {
        None => value.to_label(),
        Some(Scaling { slope, intercept }) => {
            // Slope and intercept are f32 in the file: 1/255 times 255 is 1.00000006.
            let rounding = f64::from(f32::EPSILON) * ((value.to_f64() * slope).abs() + intercept.abs());
            whole_number(scaled(value), rounding.min(0.01))
        }
    };
    decode(info, source, |bytes, values: &mut Vec<u16>| {
        let start = values.len();
        let stored = || bytes.chunks_exact(T::SIZE).map(T::from_le);
        let mut all_labels = true;
        values.extend(stored().map(|value| {
            let label = label(value);
            all_labels &= label.is_some();
            label.unwrap_or(0)
        }));
        if all_labels {
            return Ok(());
        }
        match stored().enumerate().find(|(_, value)| label(*value).is_none()) {
            Some((index, value)) => Err(ReadVolumeError::NotALabel {
                path: info.data_path.clone(),
                voxel: info.shape().ijk(start + index),
                found: scaled(value),
            }),
            None => Ok(()),
        }
    })
}

/// Calls `append` with little-endian bytes of whole voxels, chunk by chunk, until every voxel of the grid is there.
fn decode<V>(
    info: &VolumeInfo,
    mut source: Source,
    mut append: impl FnMut(&[u8], &mut Vec<V>) -> Result<(), ReadVolumeError>,
) -> Result<Vec<V>, ReadVolumeError> {
    let size = info.datatype.size();
    let count = info.shape().len();
    // A plain file was measured, so all can be reserved; what a gzip stream holds is known only when it has come out.
    let mut values = Vec::new();
    reserve(&mut values, if info.gzip { count.min(FIRST_RESERVE) } else { count }, info)?;
    let mut buffer = vec![0; CHUNK.min(count * size)];
    source.skip_to(info.offset)?;
    while values.len() < count {
        let chunk = &mut buffer[..CHUNK.min((count - values.len()) * size)];
        if source.read(chunk)? < chunk.len() {
            return Err(truncated(info, source.position()));
        }
        if info.byte_order == ByteOrder::Big && size > 1 {
            chunk.chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
        let more = chunk.len() / size;
        if values.capacity() - values.len() < more {
            // Double, but never beyond what is needed.
            let room = values.len().max(more).min(count - values.len());
            reserve(&mut values, room, info)?;
        }
        append(chunk, &mut values)?;
    }
    source.finish()?;
    Ok(values)
}

fn reserve<V>(values: &mut Vec<V>, more: usize, info: &VolumeInfo) -> Result<(), ReadVolumeError> {
    values.try_reserve_exact(more).map_err(|_| ReadVolumeError::TooLarge {
        path: info.header_path.clone(),
        shape: info.shape(),
        bytes: info.shape().len() as u64 * size_of::<V>() as u64,
    })
}
