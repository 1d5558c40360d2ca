//! Normals at rest: of the smoothed field on the skin, of the triangles on the faces of cuts and where the field is flat.

use rayon::prelude::*;

use super::Body;
use crate::geometry::{Grid, Point3};
use crate::surface::SurfaceError;
use crate::surface::field_normals::{GradientOf, field_normals};
use crate::surface::normals::Sheet;

/// The field's normals at the vertices of a surface, kept for the next one of the same body: a normal depends on its place only, and
/// most places stay. A blade adds vertices at the end of each layer.
#[derive(Debug, Clone, Default)]
pub(super) struct SkinNormals {
    /// First vertex of each layer, and the end.
    layers: Vec<u32>,
    rest: Vec<[f64; 3]>,
    /// `None` on the faces of cuts.
    normals: Vec<Option<[f32; 3]>>,
}

impl SkinNormals {
    /// Normals of vertices at rest; those that stayed where they were are not computed again.
    ///
    /// - `layers`: first vertex of each layer, and the end; empty when the vertices are in no such order.
    /// - `of_triangles`: normals by the triangles around each vertex.
    pub(super) fn update(
        &mut self,
        body: &Body,
        sheets: &[Sheet],
        layers: &[u32],
        rest: &[[f64; 3]],
        of_triangles: &[[f32; 3]],
    ) -> Result<Vec<[f32; 3]>, SurfaceError> {
        let mut of_field: Vec<Option<[f32; 3]>> = vec![None; rest.len()];
        for (now, before) in layers.windows(2).zip(self.layers.windows(2)) {
            let [now, before] = [now, before].map(|layer| layer[0] as usize..layer[1] as usize);
            for (at, known) in now.zip(before) {
                if rest[at] == self.rest[known] {
                    of_field[at] = self.normals[known];
                }
            }
        }
        let asked = |&vertex: &usize| sheets[vertex] != Sheet::Seam && of_field[vertex].is_none();
        let missing: Vec<usize> = (0..rest.len()).into_par_iter().filter(asked).collect();
        let Grid { shape, affine } = &body.points.grid;
        let index = |&vertex: &usize| affine.index_of(Point3::from(rest[vertex])).into();
        let indices: Vec<[f64; 3]> = missing.par_iter().map(index).collect();
        let found = field_normals(*shape, affine, &body.values, GradientOf::Smoothed, &indices)?;
        for (vertex, normal) in missing.into_iter().zip(found) {
            of_field[vertex] = Some(normal);
        }
        let choose = |((sheet, field), &triangles): ((&Sheet, &Option<[f32; 3]>), &[f32; 3])| {
            // Thin parts may be thinner than what the gradient is taken over, and look the wrong way.
            let agrees = |field: &[f32; 3]| (0..3).map(|axis| field[axis] * triangles[axis]).sum::<f32>() > 0.5;
            field.filter(|field| *sheet != Sheet::Seam && agrees(field)).unwrap_or(triangles)
        };
        let normals = sheets.par_iter().zip(&of_field).zip(of_triangles).map(choose).collect();
        (self.layers, self.rest, self.normals) = (layers.to_vec(), rest.to_vec(), of_field);
        Ok(normals)
    }
}
