//! What the organs of a scene are made of, brought to the particles and cells of its lattice.

use rayon::prelude::*;

use super::inputs::Inputs;
use super::prepare::PrepareError;
use crate::geometry::{GridShape, Point3, Vector3};
use crate::lattice::Lattice;
use crate::material::paper::{self, PaperBody};
use crate::material::tissue::{self, CellValues, Damping, TissueBody};
use crate::material::{Assembly, FibreTerm, Fibres, Inelastic, OrganInelastic, Plasticity, Relaxation};
use crate::scene::resolved::{self, Body, Model, Property, PropertyKind, Scene};
use crate::volume::{CtVolume, LabelVolume, SAME_GRID_TOLERANCE};

/// Samples along each axis of a cube, at most: a cube of 27 mm of a CT of 1 mm is seen at every third voxel.
const MOST_SAMPLES: usize = 9;

/// How far from a voxel's centre still counts as there [voxels]: as far as grids that are the same may lie apart.
const ON_A_VOXEL: f64 = SAME_GRID_TOLERANCE;

/// Masses and spring constants of a scene, and what went into them.
pub(super) struct Materials {
    pub(super) assembly: Assembly,
    /// Of each organ.
    pub(super) spreads: Vec<Spreads>,
}

/// How the properties of one organ spread; `None` for what is the same everywhere, or is not there.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Spreads {
    /// Of Young's modulus [Pa].
    pub youngs_modulus: Option<Spread>,
    /// Of density [kg/m^3].
    pub density: Option<Spread>,
}

/// A property over the cubes of an organ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// The smallest.
    pub least: f64,
    /// The largest.
    pub most: f64,
    /// The mean over the organ's volume: each cube counts by how much of it is tissue.
    pub mean: f64,
}

/// Masses and spring constants by the scene's model.
///
/// - `native`: organ number plus 1 of each voxel of the scene's volume.
pub(super) fn assemble(
    scene: &Scene,
    inputs: &Inputs,
    native: &LabelVolume,
    lattice: &Lattice,
) -> Result<Materials, PrepareError> {
    let [moduli, densities] = PropertyKind::ALL.map(|kind| Varying::of_scene(kind, scene, inputs, native, lattice));
    let (moduli, densities) = (moduli?, densities?);
    let mut assembly = match scene.lattice.model {
        Model::Paper => {
            let body = |organ: &resolved::Organ| match organ.body {
                Body::Paper { stiffness, damping, mass } => Some(PaperBody { stiffness, damping, mass }),
                Body::Tissue { .. } | Body::Rigid { .. } => None,
            };
            let bodies: Vec<_> = scene.organs.iter().map(body).collect();
            paper::assemble_with_rigid(lattice, &bodies, &rigid_density(scene), |particle| densities.at(particle))
        }
        Model::Tissue => {
            let bodies: Vec<Option<TissueBody>> = scene.organs.iter().map(tissue_body).collect();
            let mut assembly = tissue::assemble_varied(lattice, &bodies, &rigid_density(scene), |cell| CellValues {
                youngs_modulus: moduli.at(cell),
                density: densities.at(cell),
            });
            let fibres = |organ: &resolved::Organ| {
                organ.fibres.map(|resolved::Fibres { direction, modulus }| Fibres { direction, modulus })
            };
            assembly.fibres = FibreTerm::new(lattice, &scene.organs.iter().map(fibres).collect::<Vec<_>>());
            assembly
        }
    };
    let organs: Vec<_> = scene.organs.iter().map(inelastic).collect();
    assembly.inelastic = Inelastic::new(lattice, &assembly.stiffness, &organs);
    let spreads = (0..scene.organs.len()).map(|organ| Spreads {
        youngs_modulus: moduli.spread(lattice, organ),
        density: densities.spread(lattice, organ),
    });
    Ok(Materials { assembly, spreads: spreads.collect() })
}

/// Density of the rigid organs that move freely [kg/m^3]; `None` for all others. One that varies stands at 0 here.
fn rigid_density(scene: &Scene) -> Vec<Option<f64>> {
    let density = |organ: &resolved::Organ| match &organ.body {
        Body::Rigid { density } => density.as_ref().map(|density| density.constant().unwrap_or(0.0)),
        Body::Paper { .. } | Body::Tissue { .. } => None,
    };
    scene.organs.iter().map(density).collect()
}

/// Constants of an organ of model `tissue`; `None` for a rigid one. A property that varies stands at 0 here.
fn tissue_body(organ: &resolved::Organ) -> Option<TissueBody> {
    let Body::Tissue { youngs_modulus, poissons_ratio, density, damping } = &organ.body else { return None };
    Some(TissueBody {
        youngs_modulus: youngs_modulus.constant().unwrap_or(0.0),
        poissons_ratio: *poissons_ratio,
        density: density.constant().unwrap_or(0.0),
        damping: match *damping {
            resolved::Damping::Ratio(ratio) => Damping::Ratio(ratio),
            resolved::Damping::Viscosity(viscosity) => Damping::Viscosity(viscosity),
        },
    })
}

/// What an organ's springs do beyond elasticity; `None` for a rigid one.
fn inelastic(organ: &resolved::Organ) -> Option<OrganInelastic> {
    if matches!(organ.body, Body::Rigid { .. }) {
        return None;
    }
    let resolved::Inelastic { relaxation, plasticity, tear_strain } = organ.inelastic;
    Some(OrganInelastic {
        relaxation: relaxation.map(|resolved::Relaxation { ratio, time }| Relaxation { ratio, time }),
        plasticity: plasticity.map(|resolved::Plasticity { yield_strain, time }| Plasticity { yield_strain, time }),
        tear_strain,
    })
}

/// A property over the lattice, where organs take it from the CT or from a file.
///
/// The cube of a particle is what its organ's matter is counted in: the cell above it where the lattice has cells, else the
/// cube around it.
struct Varying {
    /// Value of each particle's cube; `None` where the organ has one for all. Empty when no organ varies.
    values: Vec<Option<f64>>,
}

impl Varying {
    fn of_scene(
        kind: PropertyKind,
        scene: &Scene,
        inputs: &Inputs,
        native: &LabelVolume,
        lattice: &Lattice,
    ) -> Result<Self, PrepareError> {
        let sources: Vec<Option<Source<'_>>> =
            scene.organs.iter().map(|organ| Source::of(kind, organ, inputs)).collect();
        if sources.iter().all(Option::is_none) {
            return Ok(Self { values: Vec::new() });
        }
        let of_cube = |particle: u32| {
            let organ = organ_of_cube(lattice, particle);
            let Some(source) = sources.get(usize::from(organ)).and_then(Option::as_ref) else { return Ok(None) };
            source.mean(native, u16::from(organ) + 1, lattice, particle).map(Some)
        };
        let values = (0..lattice.len() as u32).into_par_iter().map(of_cube).collect::<Result<_, _>>()?;
        Ok(Self { values })
    }

    fn at(&self, particle: u32) -> Option<f64> {
        self.values.get(particle as usize).copied().flatten()
    }

    /// How it spreads over an organ; `None` where it is the same everywhere.
    fn spread(&self, lattice: &Lattice, organ: usize) -> Option<Spread> {
        let mut spread = Spread { least: f64::INFINITY, most: f64::NEG_INFINITY, mean: 0.0 };
        let mut volume = 0.0;
        for (particle, value) in (0..).zip(&self.values) {
            let Some(value) = value.filter(|_| usize::from(organ_of_cube(lattice, particle)) == organ) else {
                continue;
            };
            let fill = if lattice.has_cells() { f64::from(lattice.cell_fill[particle as usize]) } else { 1.0 };
            spread.least = spread.least.min(value);
            spread.most = spread.most.max(value);
            spread.mean += fill * value;
            volume += fill;
        }
        (volume > 0.0).then(|| Spread { mean: spread.mean / volume, ..spread })
    }
}

/// The organ whose matter is in a particle's cube; `NO_ORGAN` where there is none.
fn organ_of_cube(lattice: &Lattice, particle: u32) -> u8 {
    let organs = if lattice.has_cells() { &lattice.cell_organ } else { &lattice.organ };
    organs[particle as usize]
}

/// Where a property of an organ varies from.
struct Source<'a> {
    kind: PropertyKind,
    organ: &'a resolved::Organ,
    property: &'a Property,
    volume: &'a CtVolume,
}

impl<'a> Source<'a> {
    fn of(kind: PropertyKind, organ: &'a resolved::Organ, inputs: &'a Inputs) -> Option<Self> {
        let property = organ.body.property(kind)?;
        let volume = match property {
            Property::Constant(_) => None,
            Property::FromHu(_) => inputs.image.as_ref(),
            Property::FromFile(path) => inputs.properties.get(path),
        }?;
        Some(Self { kind, organ, property, volume })
    }

    /// Mean value of the organ's voxels in a particle's cube; of all voxels where none is the organ's.
    ///
    /// Straight between the organ's voxels, and no other voxel has a say: what lies beside the organ (air, or no value at
    /// all in a file) does not run into it.
    fn mean(&self, native: &LabelVolume, organ: u16, lattice: &Lattice, particle: u32) -> Result<f64, PrepareError> {
        let affine = &native.grid().affine;
        let axes = lattice.grid.affine.linear();
        let below = if lattice.has_cells() { 0.0 } else { 0.5 };
        let corner = lattice.rest_place(particle) - axes * Vector3::repeat(below);
        // At least one sample per voxel along each axis of the cube.
        let count = [0, 1, 2].map(|axis| {
            let voxels = affine.index_vector_of(axes.column(axis).into_owned()).norm();
            ((voxels - 1e-3).ceil() as usize).clamp(1, MOST_SAMPLES)
        });
        let samples = || {
            (0..count.iter().product::<usize>()).map(|n| {
                let at = [n % count[0], n / count[0] % count[1], n / (count[0] * count[1])];
                let share = Vector3::from_fn(|axis, _| (at[axis] as f64 + 0.5) / count[axis] as f64);
                affine.index_of(corner + axes * share)
            })
        };
        let labels = native.as_slice();
        let mean = |counts: &dyn Fn(usize) -> bool| -> Result<Option<f64>, PrepareError> {
            let (mut sum, mut total) = (0.0, 0.0);
            for (voxel, weight) in samples().flat_map(|index| voxels_around(native.shape(), index)) {
                if weight > 0.0 && counts(voxel) {
                    sum += weight * self.of_voxel(voxel)?;
                    total += weight;
                }
            }
            Ok((total > 0.0).then(|| sum / total))
        };
        match mean(&|voxel| labels[voxel] == organ)? {
            Some(own) => Ok(own),
            // The weights of all voxels are never 0.
            None => Ok(mean(&|_| true)?.unwrap_or_default()),
        }
    }

    fn of_voxel(&self, voxel: usize) -> Result<f64, PrepareError> {
        let stored = f64::from(self.volume.as_slice()[voxel]);
        let value = self.property.at_hu(stored).unwrap_or(stored);
        if value > 0.0 && value.is_finite() {
            return Ok(value);
        }
        let Property::FromFile(file) = self.property else { return Ok(value) };
        Err(PrepareError::Property {
            organ: self.organ.name.clone(),
            kind: self.kind,
            file: file.clone(),
            place: self.volume.grid().place(voxel),
            found: value,
        })
    }
}

/// The eight voxels around a fractional index and their trilinear weights, which add up to 1; at the border of the volume,
/// and beyond it, those of the border.
fn voxels_around(shape: GridShape, index: Point3) -> [(usize, f64); 8] {
    let dims = shape.dims();
    let (mut low, mut high, mut t) = ([0; 3], [0; 3], [0.0; 3]);
    for axis in 0..3 {
        let clamped = index[axis].clamp(0.0, (dims[axis] - 1) as f64);
        // Places that are meant to be voxel centres come out beside them by rounding.
        let clamped = if (clamped - clamped.round()).abs() < ON_A_VOXEL { clamped.round() } else { clamped };
        low[axis] = clamped as usize;
        high[axis] = (low[axis] + 1).min(dims[axis] - 1);
        t[axis] = clamped - low[axis] as f64;
    }
    std::array::from_fn(|corner| {
        let upper = |axis: usize| corner >> axis & 1 == 1;
        let ijk = std::array::from_fn(|axis| if upper(axis) { high[axis] } else { low[axis] });
        let weight = (0..3).map(|axis| if upper(axis) { t[axis] } else { 1.0 - t[axis] }).product();
        (shape.linear(ijk), weight)
    })
}
