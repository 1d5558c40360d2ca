//! From a closed triangle mesh to sampled distances.

use std::collections::HashMap;

use rayon::prelude::*;

use super::closest_triangle::ClosestTriangle;
use super::distance_field::DistanceField;
use crate::geometry::{GridShape, Vector3};

/// Distances to a mesh are sampled this far apart [pitches of the lattice], unless that takes more than two million samples:
/// then as finely as these allow. On a surface of radius `R` the sampled one is off by at most `spacing^2 / (4 R)`, and edges
/// are rounded by less than half a spacing.
pub const SPACING_OF_PITCH: f64 = 0.25;
const MOST_SAMPLES: f64 = 2e6;
/// Empty samples around the body.
const MARGIN: usize = 3;
/// The sampled body may have this share of its volume more or less; what is thinner than the spacing is not caught at all.
const VOLUME_ERROR: f64 = 0.25;

/// The surface of a tool: closed, its triangles counter-clockwise seen from outside.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ToolMesh {
    /// Vertices, RAS+ [mm]. Shape `[vertices, 3]`.
    pub positions: Vec<[f32; 3]>,
    /// Corners of each triangle. Shape `[triangles, 3]`.
    pub triangles: Vec<[u32; 3]>,
}

/// Why a triangle mesh cannot be an obstacle.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshShapeError {
    /// No triangle has an area.
    #[error("it has no triangles; expected the closed surface of a tool")]
    Empty,
    /// A corner is not among the vertices, or not finite.
    #[error("triangle {triangle} has a corner that is no place; expected finite coordinates (mm)")]
    NoPlace {
        /// The triangle, from 0.
        triangle: usize,
    },
    /// The surface has a border, or neighbours that disagree about its sides.
    #[error(
        "it is not closed: {edges} edges have no triangle on one side, or triangles that run the wrong way, the first at \
         ({:.2}, {:.2}, {:.2}) mm; close it and make all its normals point outward",
        place.x, place.y, place.z
    )]
    Open {
        /// How many such edges.
        edges: usize,
        /// An end of the first, RAS+ [mm].
        place: Vector3,
    },
    /// The triangles run clockwise seen from outside.
    #[error("it is inside out: its volume is {volume:.3} mm3; flip its triangles so that normals point outward")]
    InsideOut {
        /// Signed volume [mm^3].
        volume: f64,
    },
    /// Too thin to be sampled.
    #[error(
        "it is too thin: of its {volume:.1} mm3 samples {spacing:.2} mm apart see {sampled:.1} mm3; thicken it, or refine \
         lattice.pitch, for what is thinner than the pitch slips between particles"
    )]
    TooThin {
        /// Its volume [mm^3].
        volume: f64,
        /// What the samples see of it [mm^3].
        sampled: f64,
        /// Distance of samples [mm].
        spacing: f64,
    },
}

/// Samples the distance to a mesh around it, for a lattice of a pitch [m].
pub(super) fn mesh_field(mesh: &ToolMesh, pitch: f64) -> Result<DistanceField, MeshShapeError> {
    let ToolMesh { positions, triangles } = mesh;
    let place = |vertex: u32| positions.get(vertex as usize).map(|p| Vector3::from(p.map(f64::from)) * 1e-3);
    let fine = |t: &[u32; 3]| t.iter().all(|&v| place(v).is_some_and(|p| p.iter().all(|x| x.is_finite())));
    if let Some(triangle) = triangles.iter().position(|t| !fine(t)) {
        return Err(MeshShapeError::NoPlace { triangle });
    }
    let places: Vec<Vector3> = positions.iter().map(|p| Vector3::from(p.map(f64::from)) * 1e-3).collect();
    closed(&places, triangles)?;
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|vertex| places[vertex as usize]);
        (b - a).cross(&(c - a)).norm_squared() > 0.0
    };
    let solid: Vec<[u32; 3]> = triangles.iter().copied().filter(area).collect();
    let used = solid.iter().flatten().map(|&vertex| places[vertex as usize]);
    let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let (min, max) = used.fold(start, |(min, max), p| (min.inf(&p), max.sup(&p)));
    if solid.is_empty() {
        return Err(MeshShapeError::Empty);
    }
    let volume = solid
        .iter()
        .map(|t| t.map(|vertex| places[vertex as usize] - min))
        .map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0)
        .sum::<f64>();
    if volume <= 0.0 {
        return Err(MeshShapeError::InsideOut { volume: volume * 1e9 });
    }
    let counts = |spacing: f64| (max - min).map(|length| (length / spacing).ceil() + (2 * MARGIN + 1) as f64);
    let mut spacing = SPACING_OF_PITCH * pitch;
    while counts(spacing).product() > MOST_SAMPLES {
        spacing *= 1.1;
    }
    let [nx, ny, nz] = counts(spacing).map(|count| count as usize).into();
    let shape = GridShape::new(nx, ny, nz);
    let dims = Vector3::new(nx as f64, ny as f64, nz as f64);
    let origin = 0.5 * (min + max) - 0.5 * spacing * (dims - Vector3::repeat(1.0));
    let mesh = ClosestTriangle::new(&places, &solid);
    let far = (max - min).norm() + 2.0 * spacing * dims.norm();
    let mut values = vec![0.0; shape.len()];
    values.par_chunks_mut(nx).enumerate().for_each(|(row, values)| {
        let mut at_most = far;
        for (i, value) in values.iter_mut().enumerate() {
            let [_, j, k] = shape.ijk(row * nx);
            let place = origin + Vector3::new(i as f64, j as f64, k as f64) * spacing;
            let distance = mesh.signed_distance(place, at_most);
            *value = distance as f32;
            at_most = distance.abs() + spacing;
        }
    });
    let field = DistanceField { origin, spacing, shape, values, in_lattice_axes: false };
    let sampled = sampled_volume(&field);
    if (sampled / volume - 1.0).abs() > VOLUME_ERROR {
        let [volume, sampled] = [volume, sampled].map(|volume| volume * 1e9);
        return Err(MeshShapeError::TooThin { volume, sampled, spacing: spacing * 1e3 });
    }
    Ok(field)
}

/// Volume where a field is below zero [m^3]: an eighth of a cell for each of eight places in it.
fn sampled_volume(field: &DistanceField) -> f64 {
    let DistanceField { origin, spacing, shape, values, .. } = field;
    let inside = |point: usize| {
        let ijk = shape.ijk(point);
        // The grid ends in empty samples.
        if f64::from(values[point]) > 2.0 * spacing || (0..3).any(|axis| ijk[axis] + 1 >= shape.dims()[axis]) {
            return 0;
        }
        let corner = origin + Vector3::from(ijk.map(|n| n as f64)) * *spacing;
        let place = |c: usize| Vector3::from([0, 1, 2].map(|axis| 0.25 + 0.5 * (c >> axis & 1) as f64));
        (0..8).filter(|&c| field.value(corner + place(c) * *spacing) < 0.0).count()
    };
    (0..shape.len()).into_par_iter().map(inside).sum::<usize>() as f64 / 8.0 * spacing.powi(3)
}

/// Every edge has as many triangles one way as the other.
fn closed(places: &[Vector3], triangles: &[[u32; 3]]) -> Result<(), MeshShapeError> {
    let mut balance = HashMap::<[u32; 2], i64>::new();
    for t in triangles {
        for i in 0..3 {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            *balance.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
    }
    // An edge from a vertex to itself counts for nothing.
    let mut open: Vec<[u32; 2]> =
        balance.into_iter().filter(|&([a, b], sum)| a != b && sum != 0).map(|e| e.0).collect();
    open.sort_unstable();
    match open.first() {
        Some(&[a, _]) => Err(MeshShapeError::Open { edges: open.len(), place: places[a as usize] * 1e3 }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PITCH: f64 = 3e-3;

    /// A box [mm], twelve triangles.
    fn cuboid(min: [f32; 3], max: [f32; 3]) -> ToolMesh {
        let corner = |c: usize| [0, 1, 2].map(|axis| if c >> axis & 1 == 1 { max[axis] } else { min[axis] });
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        ToolMesh { positions: (0..8).map(corner).collect(), triangles }
    }

    /// A ball [mm] by latitude and longitude.
    fn ball(radius: f64, rings: u32) -> ToolMesh {
        let around = 2 * rings;
        let place = |ring: u32, step: u32| {
            let theta = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
            let phi = std::f64::consts::PI * f64::from(step) / f64::from(rings);
            [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()].map(|x| (radius * x) as f32)
        };
        let mut positions = vec![place(0, 0), place(rings, 0)];
        (1..rings).for_each(|ring| (0..around).for_each(|step| positions.push(place(ring, step))));
        let at = |ring: u32, step: u32| match ring {
            0 => 0,
            ring if ring == rings => 1,
            ring => 2 + (ring - 1) * around + step % around,
        };
        let mut triangles = Vec::new();
        for ring in 0..rings {
            for step in 0..around {
                let [a, b] = [at(ring, step), at(ring, step + 1)];
                let [c, d] = [at(ring + 1, step), at(ring + 1, step + 1)];
                triangles.extend(
                    [[a, c, b], [b, c, d]].into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[0] != t[2]),
                );
            }
        }
        ToolMesh { positions, triangles }
    }

    /// Largest difference of a field and a distance near the surface, and how often the side is wrong where it is clear [m].
    fn compare(field: &DistanceField, exact: impl Fn(Vector3) -> f64) -> f64 {
        let [x, y, z] = field.shape.dims();
        let mut worst = 0.0_f64;
        for n in 0..40_000_u32 {
            let share = |step: f64| (f64::from(n) * step).fract();
            let index =
                Vector3::new(share(0.819_173) * x as f64, share(0.671_044) * y as f64, share(0.549_701) * z as f64);
            let place = field.origin + index * field.spacing;
            let expected = exact(place);
            if expected.abs() < 2.0 * field.spacing {
                worst = worst.max((field.value(place) - expected).abs());
            }
        }
        worst
    }

    #[test]
    fn a_sampled_box_is_exact_but_at_its_edges() {
        let mesh = cuboid([-5.0, -4.0, -3.0], [7.0, 6.0, 5.0]);
        let field = mesh_field(&mesh, PITCH).unwrap();
        assert!((field.spacing - SPACING_OF_PITCH * PITCH).abs() < 1e-15);
        let (center, half) = (Vector3::new(1e-3, 1e-3, 1e-3), Vector3::new(6e-3, 5e-3, 4e-3));
        let exact = |p: Vector3| {
            let beyond = (p - center).abs() - half;
            beyond.sup(&Vector3::zeros()).norm() + beyond.max().min(0.0)
        };
        let worst = compare(&field, exact);
        assert!(worst < 0.5 * field.spacing, "{worst:e} of {:e}", field.spacing);
        // In the middle of a face nothing but f32 is lost.
        for n in 0..100 {
            let place = center + Vector3::new(6e-3 + 1e-5 * f64::from(n - 50), 1e-3, -1e-3);
            assert!((field.value(place) - exact(place)).abs() < 1e-8);
        }
    }

    #[test]
    fn a_sampled_ball_is_as_good_as_promised() {
        let radius = 8e-3;
        let mesh = ball(radius * 1e3, 90);
        for pitch in [PITCH, 2.0 * PITCH] {
            let field = mesh_field(&mesh, pitch).unwrap();
            let worst = compare(&field, |p| p.norm() - radius);
            // Its triangles lie inside the ball by at most this.
            let flat = radius * (1.0 - (std::f64::consts::PI / 180.0).cos());
            let promised = field.spacing.powi(2) / (4.0 * (radius - 2.0 * field.spacing));
            assert!(worst < promised + 2.0 * flat, "{worst:e}, promised {promised:e} and {flat:e}");
        }
    }

    #[test]
    fn bad_meshes_are_refused() {
        let mesh = cuboid([-5.0, -4.0, -3.0], [7.0, 6.0, 5.0]);
        let refused = |positions: &[[f32; 3]], triangles: &[[u32; 3]]| {
            let mesh = ToolMesh { positions: positions.to_vec(), triangles: triangles.to_vec() };
            mesh_field(&mesh, PITCH).unwrap_err()
        };
        let ToolMesh { positions, triangles } = &mesh;
        assert_eq!(refused(&[], &[]), MeshShapeError::Empty);
        assert!(matches!(refused(positions, &triangles[1..]), MeshShapeError::Open { edges: 3, .. }));
        let mut turned = triangles.clone();
        turned[3].swap(0, 1);
        assert!(matches!(refused(positions, &turned), MeshShapeError::Open { edges: 3, .. }));
        let inside_out: Vec<[u32; 3]> = triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
        let MeshShapeError::InsideOut { volume } = refused(positions, &inside_out) else { panic!("accepted") };
        assert!((volume + 960.0).abs() < 1e-6, "{volume}");
        assert_eq!(refused(&positions[..7], triangles), MeshShapeError::NoPlace { triangle: 2 });
        let mut nowhere = positions.clone();
        nowhere[0][1] = f32::NAN;
        assert_eq!(refused(&nowhere, triangles), MeshShapeError::NoPlace { triangle: 0 });
        let thin = cuboid([-5.0, -4.0, -0.01], [7.0, 6.0, 0.01]);
        assert!(matches!(refused(&thin.positions, &thin.triangles), MeshShapeError::TooThin { .. }));
    }
}
