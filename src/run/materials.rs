//! What the organs of a scene are made of, brought to the particles and cells of its lattice.

use rayon::prelude::*;

use super::inputs::Inputs;
use super::prepare::PrepareError;
use crate::geometry::{Point3, Vector3};
use crate::lattice::Lattice;
use crate::material::Assembly;
use crate::material::paper::{self, PaperBody};
use crate::material::tissue::{self, Damping, TissueBody};
use crate::scene::resolved::{self, Body, Model, Scene, YoungsModulus};
use crate::volume::{CtVolume, LabelVolume};

/// Samples along each axis of a cell, at most: a cell of 27 mm of a CT of 1 mm is seen at every third voxel.
const MOST_SAMPLES: usize = 9;

/// Masses and spring constants by the scene's model.
///
/// - `native`: organ number plus 1 of each voxel of the scene's volume.
pub(super) fn assemble(
    scene: &Scene,
    inputs: &Inputs,
    native: &LabelVolume,
    lattice: &Lattice,
) -> Result<Assembly, PrepareError> {
    Ok(match scene.lattice.model {
        Model::Paper => {
            let body = |organ: &resolved::Organ| match organ.body {
                Body::Paper { stiffness, damping, mass } => Some(PaperBody { stiffness, damping, mass }),
                Body::Tissue { .. } | Body::Rigid { .. } => None,
            };
            paper::assemble_with_rigid(
                lattice,
                &scene.organs.iter().map(body).collect::<Vec<_>>(),
                &rigid_density(scene),
            )
        }
        Model::Tissue => {
            let bodies: Vec<Option<TissueBody>> = scene.organs.iter().map(tissue_body).collect();
            let moduli = varying_moduli(scene, inputs, native, lattice)?;
            tissue::assemble_varied(lattice, &bodies, &rigid_density(scene), |cell| {
                moduli.as_ref().and_then(|moduli| moduli[cell as usize])
            })
        }
    })
}

/// Density of the rigid organs that move freely [kg/m^3]; `None` for all others.
fn rigid_density(scene: &Scene) -> Vec<Option<f64>> {
    let density = |organ: &resolved::Organ| match organ.body {
        Body::Rigid { density } => density,
        Body::Paper { .. } | Body::Tissue { .. } => None,
    };
    scene.organs.iter().map(density).collect()
}

/// Constants of an organ of model `tissue`; `None` for a rigid one. A modulus that varies stands at 0 here.
fn tissue_body(organ: &resolved::Organ) -> Option<TissueBody> {
    let Body::Tissue { youngs_modulus, poissons_ratio, density, damping } = &organ.body else { return None };
    Some(TissueBody {
        youngs_modulus: match youngs_modulus {
            YoungsModulus::Constant(modulus) => *modulus,
            YoungsModulus::FromHu(_) | YoungsModulus::FromFile(_) => 0.0,
        },
        poissons_ratio: *poissons_ratio,
        density: *density,
        damping: match *damping {
            resolved::Damping::Ratio(ratio) => Damping::Ratio(ratio),
            resolved::Damping::Viscosity(viscosity) => Damping::Viscosity(viscosity),
        },
    })
}

/// Young's modulus of each cell [Pa] whose organ takes it from the CT or from a file; `None` when no organ does.
fn varying_moduli(
    scene: &Scene,
    inputs: &Inputs,
    native: &LabelVolume,
    lattice: &Lattice,
) -> Result<Option<Vec<Option<f64>>>, PrepareError> {
    let sources: Vec<Option<Source<'_>>> = scene.organs.iter().map(|organ| Source::of(organ, inputs)).collect();
    if sources.iter().all(Option::is_none) {
        return Ok(None);
    }
    let cells = lattice.cell_organ.par_iter().enumerate();
    let of_cell = |(particle, &organ): (usize, &u8)| {
        let Some(source) = sources.get(usize::from(organ)).and_then(Option::as_ref) else { return Ok(None) };
        source.mean(native, u16::from(organ) + 1, lattice, particle as u32).map(Some)
    };
    cells.map(of_cell).collect::<Result<Vec<_>, _>>().map(Some)
}

/// Where the modulus of an organ varies from.
struct Source<'a> {
    organ: &'a resolved::Organ,
    modulus: &'a YoungsModulus,
    volume: &'a CtVolume,
}

impl<'a> Source<'a> {
    fn of(organ: &'a resolved::Organ, inputs: &'a Inputs) -> Option<Self> {
        let Body::Tissue { youngs_modulus: modulus, .. } = &organ.body else { return None };
        let volume = match modulus {
            YoungsModulus::Constant(_) => None,
            YoungsModulus::FromHu(_) => inputs.image.as_ref(),
            YoungsModulus::FromFile(path) => inputs.moduli.get(path),
        }?;
        Some(Self { organ, modulus, volume })
    }

    /// Mean modulus of the organ's voxels in the cell above a particle [Pa]; of all voxels where none is the organ's.
    fn mean(&self, native: &LabelVolume, organ: u16, lattice: &Lattice, particle: u32) -> Result<f64, PrepareError> {
        let affine = &native.grid().affine;
        let axes = lattice.grid.affine.linear();
        let corner = lattice.rest_place(particle);
        // At least one sample per voxel along each axis of the cell.
        let count = [0, 1, 2].map(|axis| {
            let voxels = affine.index_vector_of(axes.column(axis).into_owned()).norm();
            ((voxels - 1e-3).ceil() as usize).clamp(1, MOST_SAMPLES)
        });
        let samples = (0..count.iter().product::<usize>()).map(|n| {
            let at = [n % count[0], n / count[0] % count[1], n / (count[0] * count[1])];
            let share = Vector3::from_fn(|axis, _| (at[axis] as f64 + 0.5) / count[axis] as f64);
            corner + axes * share
        });
        let (mut own, mut all) = ((0.0, 0), (0.0, 0));
        for place in samples {
            let modulus = self.at(place)?;
            all = (all.0 + modulus, all.1 + 1);
            if native.label_at(place, 0) == organ {
                own = (own.0 + modulus, own.1 + 1);
            }
        }
        let (sum, count) = if own.1 > 0 { own } else { all };
        Ok(sum / f64::from(count))
    }

    fn at(&self, place: Point3) -> Result<f64, PrepareError> {
        let value = f64::from(self.volume.sample(place, 0.0));
        let modulus = self.modulus.at_hu(value).unwrap_or(value);
        if modulus > 0.0 && modulus.is_finite() {
            return Ok(modulus);
        }
        let YoungsModulus::FromFile(file) = self.modulus else { return Ok(modulus) };
        Err(PrepareError::Modulus { organ: self.organ.name.clone(), file: file.clone(), place, found: modulus })
    }
}
