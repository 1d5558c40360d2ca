//! The bytes of a document: its JSON, its buffer, and the numbers of its accessors.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use gltf_json::accessor::{ComponentType, Type};
use gltf_json::validation::Checked;
use gltf_json::{Accessor, Index, Root};

use crate::io::gltf::container::{Container, file_beside};
use crate::io::gltf::{CHUNK_BIN, CHUNK_JSON, FORMAT, MAGIC, VERSION};
use crate::io::mesh_error::ReadMeshError;

/// See the module.
pub(super) struct Source {
    path: PathBuf,
    /// Holds the buffer: the GLB itself, or the file beside the JSON.
    file: File,
    /// First byte of the buffer in its file, and how many.
    buffer: (u64, u64),
}

impl Source {
    /// Opens a document and reads its JSON.
    pub(super) fn open(path: &Path) -> Result<(Self, Root), ReadMeshError> {
        match Container::of(path) {
            Container::Glb => open_glb(path),
            Container::Separate => open_separate(path),
        }
    }

    /// Bytes of the buffer: what everything read from it is bounded by.
    pub(super) fn bytes(&self) -> u64 {
        self.buffer.1
    }

    pub(super) fn malformed(&self, what: impl Into<String>) -> ReadMeshError {
        ReadMeshError::malformed(&self.path, FORMAT, what)
    }

    pub(super) fn unsupported(&self, what: impl Into<String>, advice: &'static str) -> ReadMeshError {
        ReadMeshError::Unsupported { path: self.path.clone(), what: what.into(), advice }
    }

    /// Reads the numbers of an accessor, `N` per element: floats, or integers as the shares they stand for when normalised.
    pub(super) fn numbers<const N: usize>(
        &mut self,
        root: &Root,
        index: Index<Accessor>,
        type_: Type,
    ) -> Result<Vec<[f32; N]>, ReadMeshError> {
        let Elements { component, normalized, bytes, stride, count } = self.elements(root, index, type_, N)?;
        let share = |value: f32, most: f32| if normalized { (value / most).max(-1.0) } else { value };
        let number = |at: usize| match component {
            ComponentType::F32 => f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]),
            ComponentType::I8 => share(f32::from(bytes[at] as i8), 127.0),
            ComponentType::U8 => share(f32::from(bytes[at]), 255.0),
            ComponentType::I16 => share(f32::from(i16::from_le_bytes([bytes[at], bytes[at + 1]])), 32_767.0),
            ComponentType::U16 => share(f32::from(u16::from_le_bytes([bytes[at], bytes[at + 1]])), 65_535.0),
            ComponentType::U32 => u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]) as f32,
        };
        let size = component.size();
        Ok((0..count).map(|element| std::array::from_fn(|part| number(element * stride + size * part))).collect())
    }

    /// Reads the unsigned integers of an accessor.
    pub(super) fn integers(&mut self, root: &Root, index: Index<Accessor>) -> Result<Vec<u32>, ReadMeshError> {
        let Elements { component, bytes, stride, count, .. } = self.elements(root, index, Type::Scalar, 1)?;
        let starts = (0..count).map(|element| element * stride);
        match component {
            ComponentType::U8 => Ok(starts.map(|at| u32::from(bytes[at])).collect()),
            ComponentType::U16 => {
                Ok(starts.map(|at| u32::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]))).collect())
            }
            ComponentType::U32 => Ok(starts
                .map(|at| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]))
                .collect()),
            _ => Err(self.malformed(format!("accessor {} holds {component:?}, not unsigned integers", index.value()))),
        }
    }

    /// The bytes of an accessor, checked against its view and the buffer.
    fn elements(
        &mut self,
        root: &Root,
        index: Index<Accessor>,
        type_: Type,
        parts: usize,
    ) -> Result<Elements, ReadMeshError> {
        let name = format!("accessor {}", index.value());
        let Some(accessor) = root.get(index) else {
            return Err(self.malformed(format!("{name} does not exist")));
        };
        let (Checked::Valid(component), Checked::Valid(found)) = (accessor.component_type, accessor.type_) else {
            return Err(self.malformed(format!("{name} has an unknown type")));
        };
        if found != type_ {
            return Err(self.malformed(format!("{name} holds {found:?}, not {type_:?}")));
        }
        let Some(view) = accessor.buffer_view.filter(|_| accessor.sparse.is_none()) else {
            return Err(self.unsupported(format!("{name} without plain data (sparse)"), "export plain accessors"));
        };
        let Some(view) = root.get(view) else {
            return Err(self.malformed(format!("{name} points to a view that does not exist")));
        };
        if view.buffer.value() != 0 {
            return Err(
                self.unsupported(format!("{name} in a second buffer"), "export one GLB that holds its own data")
            );
        }
        let (component, normalized) = (component.0, accessor.normalized);
        let size = (component.size() * parts) as u64;
        let stride = view.byte_stride.map_or(size, |stride| stride.0 as u64);
        let count = accessor.count.0;
        let start = accessor.byte_offset.map_or(0, |offset| offset.0);
        let span = count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
        let inside = span.and_then(|span| span.checked_add(start)).is_some_and(|end| end <= view.byte_length.0);
        let view_start = view.byte_offset.map_or(0, |offset| offset.0);
        let view_inside = view_start.checked_add(view.byte_length.0).is_some_and(|end| end <= self.buffer.1);
        let (true, true, Some(span)) = (inside && stride >= size, view_inside, span) else {
            return Err(self.malformed(format!(
                "{name} ({count} elements of {size} bytes, {stride} apart) reaches outside the {} bytes of the buffer",
                self.buffer.1
            )));
        };
        let mut bytes = vec![0; span as usize];
        let at = SeekFrom::Start(self.buffer.0 + view_start + start);
        let read = self.file.seek(at).and_then(|_| self.file.read_exact(&mut bytes));
        read.map_err(ReadMeshError::io(&self.path))?;
        Ok(Elements { component, normalized, bytes, stride: stride as usize, count: count as usize })
    }
}

/// The elements of an accessor: `count` of them, `stride` bytes apart.
struct Elements {
    component: ComponentType,
    normalized: bool,
    bytes: Vec<u8>,
    stride: usize,
    count: usize,
}

fn open_glb(path: &Path) -> Result<(Source, Root), ReadMeshError> {
    let io = ReadMeshError::io(path);
    let malformed = |what: String| ReadMeshError::malformed(path, FORMAT, what);
    let mut file = File::open(path).map_err(&io)?;
    let length = file.metadata().map_err(&io)?.len();
    let mut words = |at: u64, what: &str| -> Result<[u32; 5], ReadMeshError> {
        let mut bytes = [0; 20];
        if length < at + 20 {
            return Err(malformed(format!("{what} ends at byte {}, the file has {length}", at + 20)));
        }
        file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut bytes)).map_err(&io)?;
        Ok([0, 4, 8, 12, 16].map(|at| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])))
    };
    let [magic, version, total, json_length, json_type] = words(0, "the header")?;
    if magic != MAGIC || version != VERSION {
        return Err(malformed(format!(
            "it begins with {magic:#x}, version {version}; GLB is {MAGIC:#x}, version {VERSION}"
        )));
    }
    if u64::from(total) > length {
        return Err(malformed(format!("its header says {total} bytes, the file has {length}")));
    }
    let json_end = 20 + u64::from(json_length);
    if json_type != CHUNK_JSON || json_end > u64::from(total) {
        return Err(malformed(format!(
            "the first chunk (type {json_type:#x}, {json_length} bytes) is no JSON chunk inside it"
        )));
    }
    let mut binary = (json_end, 0);
    if u64::from(total) >= json_end + 8 {
        // The two words of the chunk's header are the last of these five.
        let [.., bin_length, bin_type] = words(json_end - 12, "the binary chunk's header")?;
        let start = json_end + 8;
        if bin_type == CHUNK_BIN {
            if start + u64::from(bin_length) > u64::from(total) {
                return Err(malformed(format!("the binary chunk of {bin_length} bytes ends after the file")));
            }
            binary = (start, u64::from(bin_length));
        }
    }
    let mut json = vec![0; json_length as usize];
    file.seek(SeekFrom::Start(20)).and_then(|_| file.read_exact(&mut json)).map_err(&io)?;
    let root = Root::from_slice(&json).map_err(|error| malformed(format!("its JSON: {error}")))?;
    if root.buffers.first().is_some_and(|buffer| buffer.uri.is_some()) {
        let (path, what) = (path.to_path_buf(), "a GLB whose data is in another file".to_owned());
        return Err(ReadMeshError::Unsupported { path, what, advice: "export one GLB that holds its own data" });
    }
    Ok((Source { path: path.to_path_buf(), file, buffer: binary }, root))
}

fn open_separate(path: &Path) -> Result<(Source, Root), ReadMeshError> {
    let malformed = |what: String| ReadMeshError::malformed(path, FORMAT, what);
    let json = std::fs::read(path).map_err(ReadMeshError::io(path))?;
    let root = Root::from_slice(&json).map_err(|error| malformed(format!("its JSON: {error}")))?;
    let Some(buffer) = root.buffers.first() else { return Err(malformed("it has no buffer".to_owned())) };
    let name = buffer.uri.as_deref().and_then(file_beside);
    let Some(name) = name else {
        let what = "a buffer that is no file of the same folder".to_owned();
        return Err(ReadMeshError::Unsupported { path: path.to_path_buf(), what, advice: "export one GLB" });
    };
    let beside = path.with_file_name(name);
    let file = File::open(&beside).map_err(ReadMeshError::io(&beside))?;
    let (found, length) = (file.metadata().map_err(ReadMeshError::io(&beside))?.len(), buffer.byte_length.0);
    if found < length {
        return Err(malformed(format!("its buffer has {length} bytes, {} has {found}", beside.display())));
    }
    Ok((Source { path: path.to_path_buf(), file, buffer: (0, length) }, root))
}
