//! Arrays in Zarr version 3: `zarr.json` beside one file per chunk, chunked along the first axis only.

use std::fs;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::codec;
use super::error::{ReadRunError, WriteRunError};
use crate::io::atomic;

/// Rows of the last chunk of a growing array are rewritten with every append: this many at most.
pub(super) const GROWING_ROWS: usize = 8192;

/// A number that an array can hold.
pub(super) trait Number: bytemuck::Pod + Default + Send + Sync {
    /// Its Zarr name.
    const NAME: &'static str;
}

macro_rules! numbers {
    ($($t:ty: $name:literal),*) => { $(impl Number for $t { const NAME: &'static str = $name; })* };
}
numbers!(u8: "uint8", u16: "uint16", u32: "uint32", u64: "uint64", i32: "int32", f32: "float32", f64: "float64");

/// A file to be written: its path and its bytes.
pub(super) type Pending = (PathBuf, Vec<u8>);

/// Writes files together, each whole or not at all, and makes their names durable.
pub(super) fn write_all(files: &[Pending]) -> Result<(), WriteRunError> {
    atomic::write_files(files).map_err(|(path, error)| WriteRunError::io(&path, error))
}

/// `zarr.json` of a group.
pub(super) fn group(folder: &Path, attributes: Value) -> Pending {
    let json = json!({ "zarr_format": 3, "node_type": "group", "attributes": attributes });
    (folder.join("zarr.json"), pretty(&json))
}

/// JSON as people read it, with a newline at the end.
pub(super) fn pretty(json: &impl serde::Serialize) -> Vec<u8> {
    let mut bytes = serde_json::to_vec_pretty(json).expect("plain data");
    bytes.push(b'\n');
    bytes
}

/// Where an array is and what it looks like, but for the number of its rows.
#[derive(Debug, Clone)]
pub(super) struct Spec<T> {
    folder: PathBuf,
    /// Lengths of the axes after the first.
    row: Vec<usize>,
    rows_per_chunk: usize,
    dimensions: Vec<&'static str>,
    attributes: Map<String, Value>,
    number: PhantomData<T>,
}

impl<T: Number> Spec<T> {
    /// An array of rows of shape `row`, in chunks of `rows_per_chunk` or as many as fit.
    pub(super) fn new(folder: PathBuf, row: &[usize], rows_per_chunk: usize, dimensions: &[&'static str]) -> Self {
        let row_bytes = row.iter().product::<usize>() * size_of::<T>();
        let rows_per_chunk = rows_per_chunk.clamp(1, (codec::MOST_BYTES / row_bytes.max(1)).max(1));
        let (row, dimensions) = (row.to_vec(), dimensions.to_vec());
        Self { folder, row, rows_per_chunk, dimensions, attributes: Map::new(), number: PhantomData }
    }

    /// Notes the unit of the values.
    pub(super) fn unit(mut self, unit: &str) -> Self {
        self.attributes.insert("unit".into(), unit.into());
        self
    }

    /// Notes what the values mean.
    pub(super) fn about(mut self, description: &str) -> Self {
        self.attributes.insert("description".into(), description.into());
        self
    }

    fn row_len(&self) -> usize {
        self.row.iter().product()
    }

    fn chunk_path(&self, chunk: usize) -> PathBuf {
        let zeros = ".0".repeat(self.row.len());
        self.folder.join(format!("c.{chunk}{zeros}"))
    }

    fn with_rows(&self, rows: usize) -> Vec<usize> {
        [&[rows], &self.row[..]].concat()
    }

    /// `zarr.json` for the given number of rows.
    pub(super) fn metadata(&self, rows: usize) -> Pending {
        let json = json!({
            "zarr_format": 3,
            "node_type": "array",
            "shape": self.with_rows(rows),
            "data_type": T::NAME,
            "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": self.with_rows(self.rows_per_chunk) } },
            "chunk_key_encoding": { "name": "default", "configuration": { "separator": "." } },
            "fill_value": 0,
            "codecs": codecs::<T>(),
            "attributes": self.attributes,
            "dimension_names": self.dimensions,
        });
        (self.folder.join("zarr.json"), pretty(&json))
    }

    /// One chunk; rows that are not given are zero.
    pub(super) fn chunk(&self, chunk: usize, values: &[T]) -> Pending {
        let full = self.rows_per_chunk * self.row_len();
        let packed = if values.len() == full {
            codec::pack(bytemuck::cast_slice(values), size_of::<T>())
        } else {
            let mut padded = values.to_vec();
            padded.resize(full, T::default());
            codec::pack(bytemuck::cast_slice(&padded), size_of::<T>())
        };
        (self.chunk_path(chunk), packed)
    }

    /// All chunks and the metadata of a finished array.
    pub(super) fn whole(&self, values: &[T]) -> Vec<Pending> {
        let chunks = values.chunks(self.rows_per_chunk * self.row_len()).enumerate();
        let mut files: Vec<Pending> = chunks.map(|(number, values)| self.chunk(number, values)).collect();
        files.push(self.metadata(values.len() / self.row_len()));
        files
    }

    /// Name of the unit, if there is one.
    pub(super) fn unit_name(&self) -> Option<&str> {
        self.attributes.get("unit").and_then(Value::as_str)
    }

    /// Lengths of the axes after the first.
    pub(super) fn row(&self) -> &[usize] {
        &self.row
    }

    /// Opens an array: where it is, and how many rows it has.
    pub(super) fn open(folder: PathBuf) -> Result<(Self, usize), ReadRunError> {
        let path = folder.join("zarr.json");
        let json: Value = read_json(&path)?;
        let bad = |message: String| ReadRunError::BadJson { path: path.clone(), message };
        let expect = |key: &str, expected: Value| match &json[key] {
            found if *found == expected => Ok(()),
            found => Err(bad(format!("{key} is {found}, expected {expected}"))),
        };
        expect("node_type", "array".into())?;
        expect("data_type", T::NAME.into())?;
        expect("codecs", codecs::<T>())?;
        expect("chunk_key_encoding", json!({ "name": "default", "configuration": { "separator": "." } }))?;
        let lengths = |value: &Value, key: &str| -> Result<Vec<usize>, ReadRunError> {
            let all: Option<Vec<usize>> = value
                .as_array()
                .filter(|a| (1..=8).contains(&a.len()))
                .and_then(|a| a.iter().map(|v| v.as_u64().and_then(|v| usize::try_from(v).ok())).collect());
            all.ok_or_else(|| bad(format!("{key} is {value}, expected a list of lengths")))
        };
        let shape = lengths(&json["shape"], "shape")?;
        let chunk = lengths(&json["chunk_grid"]["configuration"]["chunk_shape"], "chunk_shape")?;
        if chunk.len() != shape.len() || chunk[1..] != shape[1..] || chunk[0] == 0 {
            return Err(bad(format!("chunks of {chunk:?} do not fit an array of {shape:?}")));
        }
        let bytes = chunk.iter().try_fold(size_of::<T>(), |product, &n| product.checked_mul(n));
        if bytes.is_none_or(|b| b == 0 || b > codec::MOST_BYTES) {
            return Err(bad(format!("a chunk of {chunk:?} is empty or larger than {} bytes", codec::MOST_BYTES)));
        }
        let attributes = json["attributes"].as_object().cloned().unwrap_or_default();
        let row = shape[1..].to_vec();
        Ok((
            Self { folder, row, rows_per_chunk: chunk[0], dimensions: Vec::new(), attributes, number: PhantomData },
            shape[0],
        ))
    }

    /// Reads one chunk, padding included.
    pub(super) fn read_chunk(&self, chunk: usize) -> Result<Vec<T>, ReadRunError> {
        let path = self.chunk_path(chunk);
        let damaged = |message: String| ReadRunError::Damaged { path: path.clone(), message };
        let file = fs::read(&path).map_err(|source| match source.kind() {
            std::io::ErrorKind::NotFound => damaged("the file is missing".into()),
            _ => ReadRunError::Io { path: path.clone(), source },
        })?;
        let expected = self.rows_per_chunk * self.row_len() * size_of::<T>();
        let bytes = codec::unpack(&file, expected, size_of::<T>()).map_err(damaged)?;
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }

    /// Reads the first `rows` rows, chunk by chunk.
    pub(super) fn read(&self, rows: usize) -> Result<Vec<T>, ReadRunError> {
        let mut values = Vec::new();
        for chunk in 0..rows.div_ceil(self.rows_per_chunk) {
            values.extend(self.read_chunk(chunk)?);
        }
        values.truncate(rows * self.row_len());
        Ok(values)
    }

    /// The folder of the array.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }
}

fn codecs<T: Number>() -> Value {
    let shuffle = if size_of::<T>() > 1 { "shuffle" } else { "noshuffle" };
    json!([
        { "name": "bytes", "configuration": { "endian": "little" } },
        { "name": "blosc", "configuration": {
            "cname": "zstd", "clevel": codec::LEVEL, "shuffle": shuffle, "typesize": size_of::<T>(), "blocksize": 0
        } },
        { "name": "crc32c" },
    ])
}

/// Reads and parses a JSON file of the run.
pub(super) fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, ReadRunError> {
    let bytes = fs::read(path).map_err(|source| ReadRunError::Io { path: path.to_path_buf(), source })?;
    serde_json::from_slice(&bytes)
        .map_err(|error| ReadRunError::BadJson { path: path.to_path_buf(), message: error.to_string() })
}

/// An array that grows: only its last chunk is kept in memory, and rewritten whole with each append.
#[derive(Debug)]
pub(super) struct Growing<T> {
    spec: Spec<T>,
    rows: usize,
    tail: Vec<T>,
}

impl<T: Number> Growing<T> {
    /// An array without rows.
    pub(super) fn new(spec: Spec<T>) -> Self {
        Self { spec, rows: 0, tail: Vec::new() }
    }

    /// Number of rows appended.
    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// The array's description.
    pub(super) fn spec(&self) -> &Spec<T> {
        &self.spec
    }

    /// Appends whole rows; returns the chunks to write.
    pub(super) fn append(&mut self, mut values: &[T]) -> Vec<Pending> {
        let mut files = Vec::new();
        let full = self.spec.rows_per_chunk * self.spec.row_len();
        while !values.is_empty() {
            let (now, later) = values.split_at(values.len().min(full - self.tail.len()));
            self.tail.extend(now);
            files.push(self.spec.chunk(self.rows / self.spec.rows_per_chunk, &self.tail));
            self.rows += now.len() / self.spec.row_len();
            if self.tail.len() == full {
                self.tail.clear();
            }
            values = later;
        }
        files
    }

    /// `zarr.json` with the present number of rows.
    pub(super) fn metadata(&self) -> Pending {
        self.spec.metadata(self.rows)
    }
}
