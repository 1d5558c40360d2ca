//! A VTK XML file under construction: arrays are declared first, with what writes them, and then written once.

use std::io::{self, BufWriter, Write};
use std::ops::Range;
use std::path::Path;

use super::escape;
use crate::io::atomic;
use crate::io::encode::{push_f32, write_records};
use crate::io::syncing_file::SyncingFile;

/// Where an array belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Section {
    PointData,
    CellData,
    Points,
    /// `Polys` of a surface, `Cells` of a lattice.
    Cells,
}

type Out = BufWriter<SyncingFile>;
type Encoder<'a> = Box<dyn Fn(&mut Out) -> io::Result<()> + 'a>;

/// One array, and what writes its bytes.
struct Array<'a> {
    section: Section,
    name: String,
    kind: &'static str,
    components: usize,
    bytes: u64,
    write: Encoder<'a>,
}

/// What a file holds. Nothing is copied: arrays are encoded when the file is written.
pub(super) struct AppendedFile<'a> {
    /// `PolyData` or `UnstructuredGrid`.
    kind: &'static str,
    /// The element that holds the cells: `Polys` or `Cells`.
    cells: &'static str,
    /// Attributes of the piece.
    counts: String,
    field: String,
    /// Names of the attributes that viewers show first: `Scalars="..." Normals="..."`.
    active: String,
    arrays: Vec<Array<'a>>,
}

impl<'a> AppendedFile<'a> {
    pub(super) fn new(kind: &'static str, cells: &'static str, counts: String) -> Self {
        Self { kind, cells, counts, field: String::new(), active: String::new(), arrays: Vec::new() }
    }

    /// What viewers show first.
    pub(super) fn active(&mut self, what: &str, name: &str) {
        self.active.push_str(&format!(" {what}=\"{name}\""));
    }

    /// Adds field data: texts.
    pub(super) fn texts<'t>(&mut self, name: &str, texts: impl IntoIterator<Item = &'t str>) {
        let texts: Vec<&str> = texts.into_iter().collect();
        // Character codes, each text ended by a zero.
        let codes: Vec<String> =
            texts.iter().flat_map(|text| text.bytes().chain([0])).map(|byte| byte.to_string()).collect();
        self.field.push_str(&format!(
            "<Array type=\"String\" Name=\"{name}\" NumberOfTuples=\"{}\" format=\"ascii\">{}</Array>\n",
            texts.len(),
            codes.join(" ")
        ));
    }

    /// Adds field data: the time [s], by the name under which ParaView looks for it.
    pub(super) fn time(&mut self, time: f64) {
        self.field.push_str(&format!(
            "<DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">{time}</DataArray>\n"
        ));
    }

    /// Adds an array that takes `bytes` bytes in all; `encode` appends those of a range of its `records`.
    #[expect(clippy::too_many_arguments, reason = "one call per kind of number, all in this file")]
    fn array(
        &mut self,
        section: Section,
        name: &str,
        kind: &'static str,
        components: usize,
        bytes: u64,
        records: usize,
        encode: impl Fn(Range<usize>, &mut Vec<u8>) + Sync + 'a,
    ) {
        let write: Encoder<'a> = Box::new(move |out| write_records(out, records, &encode));
        self.arrays.push(Array { section, name: name.to_owned(), kind, components, bytes, write });
    }

    /// Adds tuples of floats.
    pub(super) fn floats<const N: usize>(
        &mut self,
        section: Section,
        name: &str,
        count: usize,
        tuple: impl Fn(usize) -> [f32; N] + Sync + 'a,
    ) {
        let encode = move |range: Range<usize>, bytes: &mut Vec<u8>| range.for_each(|at| push_f32(bytes, tuple(at)));
        self.array(section, name, "Float32", N, (4 * N * count) as u64, count, encode);
    }

    /// Adds tuples of bytes.
    pub(super) fn bytes<const N: usize>(
        &mut self,
        section: Section,
        name: &str,
        count: usize,
        tuple: impl Fn(usize) -> [u8; N] + Sync + 'a,
    ) {
        let encode =
            move |range: Range<usize>, bytes: &mut Vec<u8>| range.for_each(|at| bytes.extend_from_slice(&tuple(at)));
        self.array(section, name, "UInt8", N, (N * count) as u64, count, encode);
    }

    /// Adds 16-bit numbers.
    pub(super) fn words(
        &mut self,
        section: Section,
        name: &str,
        count: usize,
        word: impl Fn(usize) -> u16 + Sync + 'a,
    ) {
        let encode = move |range: Range<usize>, bytes: &mut Vec<u8>| {
            range.for_each(|at| bytes.extend_from_slice(&word(at).to_le_bytes()));
        };
        self.array(section, name, "UInt16", 1, (2 * count) as u64, count, encode);
    }

    /// Adds a byte for each of `count` cells, appended by `push` for each of `records`.
    pub(super) fn cell_bytes(
        &mut self,
        name: &str,
        count: usize,
        records: usize,
        push: impl Fn(usize, &mut dyn FnMut(u8)) + Sync + 'a,
    ) {
        let encode = move |range: Range<usize>, bytes: &mut Vec<u8>| {
            let mut add = |byte: u8| bytes.push(byte);
            range.for_each(|at| push(at, &mut add));
        };
        self.array(Section::CellData, name, "UInt8", 1, count as u64, records, encode);
    }

    /// Adds a float for each of `count` cells, appended by `push` for each of `records`.
    pub(super) fn cell_floats(
        &mut self,
        name: &str,
        count: usize,
        records: usize,
        push: impl Fn(usize, &mut dyn FnMut(f32)) + Sync + 'a,
    ) {
        let encode = move |range: Range<usize>, bytes: &mut Vec<u8>| {
            let mut add = |value: f32| push_f32(bytes, [value]);
            range.for_each(|at| push(at, &mut add));
        };
        self.array(Section::CellData, name, "Float32", 1, 4 * count as u64, records, encode);
    }

    /// Adds the points that cells join, or where each cell ends among these: `numbers` 32-bit numbers, appended by `push` for
    /// each of `records`.
    pub(super) fn integers(
        &mut self,
        name: &str,
        numbers: u64,
        records: usize,
        push: impl Fn(usize, &mut dyn FnMut(u32)) + Sync + 'a,
    ) {
        let encode = move |range: Range<usize>, bytes: &mut Vec<u8>| {
            let mut add = |number: u32| bytes.extend_from_slice(&number.to_le_bytes());
            range.for_each(|at| push(at, &mut add));
        };
        self.array(Section::Cells, name, "Int32", 1, 4 * numbers, records, encode);
    }

    /// Writes the file.
    pub(super) fn write(&self, path: &Path) -> io::Result<()> {
        atomic::write_file(path, |out| {
            out.write_all(self.xml().as_bytes())?;
            for array in &self.arrays {
                out.write_all(&array.bytes.to_le_bytes())?;
                (array.write)(out)?;
            }
            out.write_all(b"\n</AppendedData>\n</VTKFile>\n")
        })
    }

    fn xml(&self) -> String {
        let mut offset = 0;
        let mut lines = [const { String::new() }; 4];
        for Array { section, name, kind, components, bytes, .. } in &self.arrays {
            let name = escape(name);
            lines[*section as usize].push_str(&format!(
                "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" \
                 offset=\"{offset}\"/>\n"
            ));
            // Its length, then itself.
            offset += 8 + bytes;
        }
        let [point_data, cell_data, points, cells] = lines;
        let Self { kind, cells: element, counts, field, active, .. } = self;
        format!(
            "<?xml version=\"1.0\"?>\n\
             <!-- written by yawara {}; unit mm; patient space RAS+: x to the patient's right, y to the front, z to the head -->\n\
             <VTKFile type=\"{kind}\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<{kind}>\n\
             <FieldData>\n{field}</FieldData>\n<Piece {counts}>\n<PointData{active}>\n{point_data}</PointData>\n\
             <CellData>\n{cell_data}</CellData>\n<Points>\n{points}</Points>\n<{element}>\n{cells}</{element}>\n\
             </Piece>\n</{kind}>\n<AppendedData encoding=\"raw\">\n_",
            env!("CARGO_PKG_VERSION")
        )
    }
}
