//! Surfaces as VTK polygons.

use std::path::Path;

use super::appended::{AppendedFile, Section};
use crate::io::mesh_error::{WriteMeshError, check_organs};
use crate::plot::canvas::srgb;
use crate::surface::mesh::{OrganMesh, TriangleMesh};

/// Writes surfaces as `.vtp` [mm, RAS+], all organs in one piece.
///
/// Point data, as far as every organ with vertices has it: `normal`, `label`, `displacement_mm`, `hu`, `strain`,
/// `speed_mm_per_s`, `color_srgb` (bytes). Cell data: `organ`, its place in `organ_names` of the field data, and `label`, that
/// of the triangle's first corner.
/// - `time`: of the frame [s], if it has one.
///
/// # Errors
/// If the meshes are inconsistent, not finite or empty, hold more than 2^31 - 1 corners, or the file cannot be written.
pub fn write_vtp(path: &Path, organs: &[OrganMesh], time: Option<f64>) -> Result<(), WriteMeshError> {
    write(path, organs, None, time)
}

/// What lies on the two sides of borders.
#[derive(Debug, Clone, Copy)]
pub struct Regions<'a> {
    /// Names of all regions, the outside first.
    pub names: &'a [String],
    /// For each mesh the regions behind and in front of its triangles, as places among the names.
    pub sides: &'a [[u16; 2]],
}

/// Writes borders between regions as [`write_vtp`] writes organs; cell data `inside` and `outside` are the regions behind and in front of
/// each triangle, as places in `region_names` of the field data. The closed surface of a region: all triangles that name it.
///
/// # Errors
/// As [`write_vtp`].
///
/// # Panics
/// If there is not one pair of sides per mesh.
pub fn write_vtp_borders(
    path: &Path,
    borders: &[OrganMesh],
    regions: Regions<'_>,
    time: Option<f64>,
) -> Result<(), WriteMeshError> {
    assert_eq!(borders.len(), regions.sides.len(), "two sides per mesh");
    write(path, borders, Some(regions), time)
}

fn write(
    path: &Path,
    organs: &[OrganMesh],
    regions: Option<Regions<'_>>,
    time: Option<f64>,
) -> Result<(), WriteMeshError> {
    check_organs(path, organs)?;
    let index = Index::new(organs);
    let (points, triangles) = (index.points, index.triangles);
    if i32::try_from(points.max(3 * triangles)).is_err() {
        return Err(WriteMeshError::TooLarge {
            path: path.to_path_buf(),
            format: "VTP with 32-bit indices",
            what: "corners",
            found: points.max(3 * triangles) as u64,
            limit: i32::MAX as u64,
            advice: "write one organ at a time",
        });
    }
    let counts = format!(
        "NumberOfPoints=\"{points}\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"{triangles}\""
    );
    let mut file = AppendedFile::new("PolyData", "Polys", counts);
    file.texts("unit", ["mm"]);
    file.texts("space", ["RAS+: x to the patient's right, y to the front, z to the head"]);
    file.texts("organ_names", organs.iter().map(|organ| organ.name.as_str()));
    if let Some(regions) = regions {
        file.texts("region_names", regions.names.iter().map(String::as_str));
    }
    time.into_iter().for_each(|time| file.time(time));

    let all = |there: fn(&TriangleMesh) -> bool| {
        organs.iter().map(|organ| &organ.mesh).filter(|mesh| !mesh.positions.is_empty()).all(there)
    };
    let index = &index;
    let on = move |point: usize| index.mesh_of_point(point);
    file.floats(Section::Points, "points", points, move |point| {
        let (mesh, vertex) = on(point);
        mesh.positions[vertex]
    });
    if all(|mesh| !mesh.normals.is_empty()) {
        file.active("Normals", "normal");
        file.floats(Section::PointData, "normal", points, move |point| {
            let (mesh, vertex) = on(point);
            mesh.normals[vertex]
        });
    }
    if all(|mesh| !mesh.displacements.is_empty()) {
        file.floats(Section::PointData, "displacement_mm", points, move |point| {
            let (mesh, vertex) = on(point);
            mesh.displacements[vertex]
        });
    }
    let scalars: [(&str, Values); 3] =
        [("hu", |mesh| &mesh.hu), ("strain", |mesh| &mesh.strains), ("speed_mm_per_s", |mesh| &mesh.speeds)];
    for (name, values) in scalars {
        if organs.iter().all(|organ| values(&organ.mesh).len() == organ.mesh.positions.len()) {
            file.floats(Section::PointData, name, points, move |point| {
                let (mesh, vertex) = on(point);
                [values(mesh)[vertex]]
            });
        }
    }
    if all(|mesh| !mesh.colors.is_empty()) {
        file.bytes(Section::PointData, "color_srgb", points, move |point| {
            let (mesh, vertex) = on(point);
            srgb(mesh.colors[vertex])
        });
    }
    if all(|mesh| !mesh.labels.is_empty()) {
        file.words(Section::PointData, "label", points, move |point| {
            let (mesh, vertex) = on(point);
            mesh.labels[vertex]
        });
        file.words(Section::CellData, "label", triangles, move |triangle| {
            let (organ, triangle) = index.organ_of_triangle(triangle);
            let mesh = &index.organs[organ].mesh;
            mesh.labels[mesh.triangles[triangle][0] as usize]
        });
    }
    file.words(Section::CellData, "organ", triangles, move |triangle| index.organ_of_triangle(triangle).0 as u16);
    if let Some(Regions { sides, .. }) = regions {
        for (side, name) in ["inside", "outside"].into_iter().enumerate() {
            file.words(Section::CellData, name, triangles, move |triangle| {
                sides[index.organ_of_triangle(triangle).0][side]
            });
        }
    }
    file.integers("connectivity", 3 * triangles as u64, triangles, move |triangle, add| {
        let (organ, triangle) = index.organ_of_triangle(triangle);
        let first = index.first_point[organ] as u32;
        index.organs[organ].mesh.triangles[triangle].iter().for_each(|corner| add(corner + first));
    });
    file.integers("offsets", triangles as u64, triangles, |triangle, add| add(3 * (triangle as u32 + 1)));
    file.write(path).map_err(WriteMeshError::io(path))
}

/// An attribute of one number per vertex.
type Values = fn(&TriangleMesh) -> &Vec<f32>;

/// Which organ a point or a triangle of the file is of.
struct Index<'a> {
    organs: &'a [OrganMesh],
    first_point: Vec<usize>,
    first_triangle: Vec<usize>,
    points: usize,
    triangles: usize,
}

impl<'a> Index<'a> {
    fn new(organs: &'a [OrganMesh]) -> Self {
        let (mut points, mut triangles) = (0, 0);
        let (mut first_point, mut first_triangle) = (Vec::new(), Vec::new());
        for OrganMesh { mesh, .. } in organs {
            first_point.push(points);
            first_triangle.push(triangles);
            points += mesh.positions.len();
            triangles += mesh.triangles.len();
        }
        Self { organs, first_point, first_triangle, points, triangles }
    }

    fn mesh_of_point(&self, point: usize) -> (&'a TriangleMesh, usize) {
        // The last that begins here or before: organs without points begin where the next does.
        let organ = self.first_point.partition_point(|&first| first <= point) - 1;
        (&self.organs[organ].mesh, point - self.first_point[organ])
    }

    fn organ_of_triangle(&self, triangle: usize) -> (usize, usize) {
        let organ = self.first_triangle.partition_point(|&first| first <= triangle) - 1;
        (organ, triangle - self.first_triangle[organ])
    }
}
