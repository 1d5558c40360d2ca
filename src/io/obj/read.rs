//! Reads OBJ: what was written, and the triangles of other programs.

use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::Path;

use super::FORMAT;
use crate::io::mesh_error::ReadMeshError;
use crate::scene::color::linear;
use crate::surface::mesh::{Finish, OrganMesh, TriangleMesh};

/// Reads OBJ with triangles: an organ for each object or group that has faces, with the vertices that they use.
///
/// Normals are kept when each vertex has one of its own number among the normals of its group, as in our files; colours of
/// vertices when all have them; the colour of an organ when the material file is there. Texture, lines and points are passed
/// over.
///
/// # Errors
/// If the file cannot be read, has no face, faces with other than three corners, corners outside the vertices, or numbers
/// that are none or not finite.
pub fn read_obj(path: &Path) -> Result<Vec<OrganMesh>, ReadMeshError> {
    let io = ReadMeshError::io(path);
    let mut input = BufReader::with_capacity(1 << 20, File::open(path).map_err(&io)?);
    let mut obj = Obj::default();
    let (mut line, mut number) = (Vec::new(), 0);
    loop {
        line.clear();
        if input.read_until(b'\n', &mut line).map_err(&io)? == 0 {
            break;
        }
        number += 1;
        let text = String::from_utf8_lossy(&line);
        obj.line(text.trim())
            .map_err(|what| ReadMeshError::malformed(path, FORMAT, format!("line {number}: {what}")))?;
    }
    let colors = obj.library.as_deref().map(|name| material_colors(path, name)).unwrap_or_default();
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let organs = obj.organs(&name, &colors);
    if organs.is_empty() {
        return Err(ReadMeshError::malformed(path, FORMAT, "it has no face"));
    }
    Ok(organs)
}

/// What has been read so far.
#[derive(Default)]
struct Obj {
    positions: Vec<[f32; 3]>,
    /// As long as the positions if all have one.
    colors: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    groups: Vec<Group>,
    material: String,
    library: Option<String>,
}

struct Group {
    name: String,
    material: String,
    /// Vertices, by their number in the file from 0.
    triangles: Vec<[u32; 3]>,
    /// What to add to the number of a vertex to find its normal; `None` when there is no one such number.
    normals: Option<i64>,
}

impl Obj {
    fn line(&mut self, line: &str) -> Result<(), String> {
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        match word {
            "v" => {
                let numbers = numbers(rest)?;
                let Some(&[x, y, z]) = numbers.get(..3).and_then(|place| place.as_array()) else {
                    return Err(format!("a vertex of {} numbers, expected at least 3", numbers.len()));
                };
                self.positions.push([x, y, z]);
                if let [_, _, _, r, g, b] = numbers[..] {
                    self.colors.push(linear_color([r, g, b]));
                }
            }
            "vn" => {
                let numbers = numbers(rest)?;
                let Some(normal) = numbers.as_array() else {
                    return Err(format!("a normal of {} numbers, expected 3", numbers.len()));
                };
                self.normals.push(*normal);
            }
            "f" => self.face(rest)?,
            "o" | "g" => {
                let name = rest.trim();
                match self.groups.last_mut() {
                    Some(group) if group.triangles.is_empty() => name.clone_into(&mut group.name),
                    Some(group) if group.name == name => {}
                    _ => self.begin(name.to_owned()),
                }
            }
            "usemtl" => {
                rest.trim().clone_into(&mut self.material);
                if let Some(group) = self.groups.last_mut().filter(|group| group.triangles.is_empty()) {
                    group.material.clone_from(&self.material);
                }
            }
            "mtllib" => self.library = Some(rest.trim().to_owned()),
            _ => {}
        }
        Ok(())
    }

    fn begin(&mut self, name: String) {
        self.groups.push(Group { name, material: self.material.clone(), triangles: Vec::new(), normals: None });
    }

    fn face(&mut self, rest: &str) -> Result<(), String> {
        if self.groups.is_empty() {
            self.begin(String::new());
        }
        let (mut corners, mut count) = ([0; 3], 0);
        let mut offsets = [None; 3];
        for word in rest.split_ascii_whitespace() {
            let mut parts = word.split('/');
            let vertex = index(parts.next().unwrap_or_default(), self.positions.len(), "vertex")?;
            let normal = match parts.nth(1) {
                Some(normal) if !normal.is_empty() => Some(index(normal, self.normals.len(), "normal")?),
                _ => None,
            };
            if let (Some(corner), Some(offset)) = (corners.get_mut(count), offsets.get_mut(count)) {
                *corner = vertex;
                *offset = normal.map(|normal| i64::from(normal) - i64::from(vertex));
            }
            count += 1;
        }
        if count != 3 {
            return Err(format!("a face of {count} corners, only triangles are read (triangulate it)"));
        }
        let Some(group) = self.groups.last_mut() else { return Ok(()) };
        let same = offsets[1] == offsets[0] && offsets[2] == offsets[0];
        let first = group.triangles.is_empty();
        group.normals = if same && (first || group.normals == offsets[0]) { offsets[0] } else { None };
        group.triangles.push(corners);
        Ok(())
    }

    fn organs(self, file: &str, colors: &HashMap<String, [f32; 3]>) -> Vec<OrganMesh> {
        let colored = self.colors.len() == self.positions.len();
        let mut organs = Vec::new();
        for group in self.groups.iter().filter(|group| !group.triangles.is_empty()) {
            let mut used: Vec<u32> = group.triangles.as_flattened().to_vec();
            used.sort_unstable();
            used.dedup();
            let local = |corner: u32| used.partition_point(|&vertex| vertex < corner) as u32;
            let pick = |values: &[[f32; 3]]| used.iter().map(|&vertex| values[vertex as usize]).collect::<Vec<_>>();
            let normal = |offset: i64| {
                let at = |vertex: &u32| usize::try_from(i64::from(*vertex) + offset).ok();
                used.iter().map(|vertex| self.normals.get(at(vertex)?).copied()).collect::<Option<Vec<_>>>()
            };
            let mesh = TriangleMesh {
                positions: pick(&self.positions),
                triangles: group.triangles.iter().map(|corners| corners.map(local)).collect(),
                normals: group.normals.and_then(normal).unwrap_or_default(),
                colors: if colored { pick(&self.colors) } else { Vec::new() },
                ..TriangleMesh::default()
            };
            let name = if group.name.is_empty() { file } else { &group.name }.to_owned();
            let color = colors.get(&group.material).copied().unwrap_or([0.8; 3]);
            organs.push(OrganMesh { name, color, finish: Finish::default(), mesh });
        }
        organs
    }
}

fn numbers(text: &str) -> Result<Vec<f32>, String> {
    text.split_ascii_whitespace()
        .map(|word| match word.parse::<f32>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(format!("'{word}' is no finite number")),
        })
        .collect()
}

/// An index from 1, or from the end when it is negative, as one from 0.
fn index(word: &str, count: usize, what: &str) -> Result<u32, String> {
    let number: i64 = word.parse().map_err(|_| format!("'{word}' is no number of a {what}"))?;
    let index = if number < 0 { i64::try_from(count).ok().map(|count| count + number) } else { number.checked_sub(1) };
    let inside = index.and_then(|index| u32::try_from(index).ok()).filter(|&index| (index as usize) < count);
    inside.ok_or_else(|| format!("a face uses {what} {number} of {count} so far"))
}

fn linear_color(srgb: [f32; 3]) -> [f32; 3] {
    srgb.map(|part| linear((255.0 * part.clamp(0.0, 1.0)).round() as u8))
}

/// Colours of materials by name, as far as the file beside can be read: a mesh is complete without.
fn material_colors(path: &Path, name: &str) -> HashMap<String, [f32; 3]> {
    let mut colors = HashMap::new();
    let beside = Path::new(name).file_name().is_some_and(|file| file == name);
    let text = if beside { fs::read(path.with_file_name(name)).unwrap_or_default() } else { Vec::new() };
    let mut material = String::new();
    for line in String::from_utf8_lossy(&text).lines() {
        match line.trim().split_once(char::is_whitespace) {
            Some(("newmtl", name)) => name.trim().clone_into(&mut material),
            Some(("Kd", color)) => {
                if let Ok(Some(&color)) = numbers(color).as_ref().map(|numbers| numbers.as_array::<3>()) {
                    colors.insert(material.clone(), linear_color(color));
                }
            }
            _ => {}
        }
    }
    colors
}
