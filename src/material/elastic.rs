//! What a lattice of springs amounts to as a solid: moduli and wave speeds in any direction.
//!
//! A lattice deformed evenly stays in balance, for every particle is a centre of symmetry. So the energy of its springs per
//! volume is that of a solid with Born's stiffness tensor
//!
//! ```text
//! C = 1/(2V) sum over the 26 springs of a particle of  k L^2 n n n n        V = pitch^3
//! ```
//!
//! with three constants left by the lattice's symmetry: `C11`, `C12` and `C44` (`C12 = C44` for springs alone, Cauchy's
//! relation). Equal springs `k` give a Young's modulus of 2.70, 4.40 and 5.56 `k / pitch` along an edge, a face diagonal and
//! a body diagonal of the voxels. A volume term adds its modulus to `C11` and `C12`.
//!
//! Not covered: large strain, and what a surface or a thin part lacks in springs; waves are those much longer than the pitch.
//!
//! Source: Born and Huang, *Dynamical Theory of Crystal Lattices* (1954), for the tensor; Nye, *Physical Properties of
//! Crystals* (1957), for compliances of cubic symmetry; Christoffel's equation for the wave speeds.

use super::{Assembly, SpringConstants};
use crate::geometry::{Matrix3, Vector3};
use crate::lattice::Lattice;
use crate::lattice::neighbours::{NEIGHBOURS, OFFSETS, family};

/// Elastic constants of cubic symmetry, along the axes of the lattice [Pa].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CubicSolid {
    /// Stress along an axis per strain along it, the other axes held.
    pub c11: f64,
    /// Stress along an axis per strain along another.
    pub c12: f64,
    /// Stress per shear between two axes: the shear modulus on the faces of the voxels.
    pub c44: f64,
}

impl CubicSolid {
    /// Born's tensor of a bulk lattice.
    ///
    /// - `stiffness` [N/m]: of each face, face-diagonal and body-diagonal spring.
    /// - `pitch` [m].
    pub fn of_springs(stiffness: [f64; 3], pitch: f64) -> Self {
        Self::born(|direction| stiffness[family(direction) - 1], pitch)
    }

    fn born(stiffness: impl Fn(usize) -> f64, pitch: f64) -> Self {
        let (mut c11, mut c12) = (0.0, 0.0);
        for (direction, offset) in OFFSETS.iter().enumerate() {
            let along = Vector3::from(offset.map(f64::from));
            let n = along.normalize();
            // 1/(2V) k L^2, with L = pitch |along| and V = pitch^3.
            let weight = stiffness(direction) * along.norm_squared() / (2.0 * pitch);
            // The mean over the axes: the same for each unless springs of one family differ.
            c11 += weight * (n.x.powi(4) + n.y.powi(4) + n.z.powi(4)) / 3.0;
            c12 += weight * ((n.x * n.y).powi(2) + (n.y * n.z).powi(2) + (n.z * n.x).powi(2)) / 3.0;
        }
        Self { c11, c12, c44: c12 }
    }

    /// The same with a volume term of this modulus [Pa].
    #[must_use]
    pub fn with_volume_term(self, modulus: f64) -> Self {
        Self { c11: self.c11 + modulus, c12: self.c12 + modulus, ..self }
    }

    /// `S11`, `S12` and `S44` [1/Pa].
    fn compliance(&self) -> [f64; 3] {
        let Self { c11, c12, c44 } = *self;
        let determinant = (c11 - c12) * (c11 + 2.0 * c12);
        [(c11 + c12) / determinant, -c12 / determinant, 1.0 / c44]
    }

    /// `1/E` along a direction [1/Pa].
    fn stretch_compliance(&self, along: &Vector3) -> f64 {
        let n = along.normalize();
        let [s11, s12, s44] = self.compliance();
        let spread = (n.x * n.y).powi(2) + (n.y * n.z).powi(2) + (n.z * n.x).powi(2);
        s11 - 2.0 * (s11 - s12 - 0.5 * s44) * spread
    }

    /// Young's modulus of a bar cut along a direction [Pa].
    pub fn youngs_modulus(&self, along: &Vector3) -> f64 {
        1.0 / self.stretch_compliance(along)
    }

    /// Poisson's ratio of a bar cut along a direction: the smallest and the largest over the directions across it.
    pub fn poissons_ratios(&self, along: &Vector3) -> [f64; 2] {
        let n = along.normalize();
        let [s11, s12, s44] = self.compliance();
        // -E (s12 + (s11 - s12 - s44/2) sum n_i^2 m_i^2): a quadratic form in m across n, so its extremes are the
        // eigenvalues of the form between two directions across.
        let helper = if n.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let a = n.cross(&helper).normalize();
        let b = n.cross(&a);
        let form = |p: &Vector3, q: &Vector3| (0..3).map(|i| n[i] * n[i] * p[i] * q[i]).sum::<f64>();
        let (aa, bb, ab) = (form(&a, &a), form(&b, &b), form(&a, &b));
        let (middle, half) = (0.5 * (aa + bb), (0.25 * (aa - bb).powi(2) + ab * ab).sqrt());
        let ratio = |sum: f64| -(s12 + (s11 - s12 - 0.5 * s44) * sum) / self.stretch_compliance(&n);
        let (one, other) = (ratio(middle - half), ratio(middle + half));
        [one.min(other), one.max(other)]
    }

    /// Shear moduli on the faces of the voxels (`C44`) and across their face diagonals, `(C11 - C12) / 2` [Pa]: no plane has a
    /// smaller or larger one.
    pub fn shear_moduli(&self) -> [f64; 2] {
        [self.c44, 0.5 * (self.c11 - self.c12)]
    }

    /// Pressure per loss of volume [Pa].
    pub fn bulk_modulus(&self) -> f64 {
        (self.c11 + 2.0 * self.c12) / 3.0
    }

    /// Zener's ratio, `2 C44 / (C11 - C12)`: 1 for an isotropic solid.
    pub fn anisotropy(&self) -> f64 {
        2.0 * self.c44 / (self.c11 - self.c12)
    }

    /// Speeds of the three plane waves along a direction, fastest first [m/s]: for an isotropic solid the pressure wave,
    /// `sqrt((lambda + 2 mu) / density)`, and the shear wave twice, `sqrt(mu / density)`. 0 where the solid is not stable.
    ///
    /// - `density` [kg/m^3].
    pub fn wave_speeds(&self, density: f64, along: &Vector3) -> [f64; 3] {
        let n = along.normalize();
        let christoffel = Matrix3::from_fn(|i, j| {
            if i == j {
                self.c11 * n[i] * n[i] + self.c44 * (1.0 - n[i] * n[i])
            } else {
                (self.c12 + self.c44) * n[i] * n[j]
            }
        });
        let mut speeds: [f64; 3] =
            christoffel.symmetric_eigenvalues().map(|value| (value / density).max(0.0).sqrt()).into();
        speeds.sort_by(|a, b| b.total_cmp(a));
        speeds
    }
}

/// An organ as a solid, as it was assembled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bulk {
    /// Its stiffness [Pa].
    pub stiffness: CubicSolid,
    /// The same tensor of its dampers [Pa s]; `None` when nothing damps.
    pub viscosity: Option<CubicSolid>,
    /// Mass of a particle over the volume of its voxel [kg/m^3].
    pub density: f64,
}

impl Bulk {
    /// The bulk of an organ: springs, volume term and mass of the first particle well inside it (all eight cells or all 26
    /// neighbours are the organ's); `None` for an organ so thin that it has no such particle, and for a rigid one.
    pub fn of_organ(lattice: &Lattice, assembly: &Assembly, organ: u8) -> Option<Self> {
        let belongs = |particle: u32| lattice.organ[particle as usize] == organ;
        let inside = |particle: &u32| {
            if lattice.has_cells() {
                let is_full =
                    |&cell: &u32| lattice.cell_organ[cell as usize] == organ && lattice.cell_fill[cell as usize] == 1.0;
                return lattice.cells_around(*particle).filter(is_full).count() == 8;
            }
            let neighbour = |direction: usize| lattice.neighbour(*particle, direction);
            belongs(*particle) && (0..NEIGHBOURS).all(|direction| neighbour(direction).is_some_and(belongs))
        };
        let particle = (0..lattice.len() as u32).find(inside)?;
        let mass = f64::from(assembly.mass[particle as usize]);
        let born = |constants: &SpringConstants| {
            CubicSolid::born(|direction| constants.of(lattice, particle, direction), lattice.pitch)
        };
        let modulus = |cells: &Vec<f32>| f64::from(cells[particle as usize]);
        let volume = assembly.volume.as_ref();
        let volume_viscosity = volume.and_then(|term| term.viscosity.as_ref()).map_or(0.0, modulus);
        let stiffness = born(&assembly.stiffness).with_volume_term(volume.map_or(0.0, |term| modulus(&term.modulus)));
        let viscosity = assembly.damping.as_ref().map(|damping| born(damping).with_volume_term(volume_viscosity));
        (mass > 0.0).then(|| Self { stiffness, viscosity, density: mass / lattice.pitch.powi(3) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Affine, Grid, GridShape};
    use crate::lattice::build::build;
    use crate::lattice::cells::build_cells;
    use crate::material::VolumeTerm;
    use crate::material::paper::{self, PaperBody};
    use crate::material::tissue::{self, Damping, TissueBody};
    use crate::volume::Volume;

    const EDGE: [f64; 3] = [0.0, 0.0, 1.0];
    const FACE: [f64; 3] = [1.0, -1.0, 0.0];
    const BODY: [f64; 3] = [1.0, 1.0, -1.0];

    fn near(found: f64, expected: f64) {
        assert!((found - expected).abs() <= 1e-6 * expected.abs().max(1e-9), "{found} is not {expected}");
    }

    fn block() -> Volume<u8> {
        let grid = Grid { shape: GridShape::new(5, 5, 5), affine: Affine::from_spacing([3.0; 3], [0.0; 3]).unwrap() };
        Volume::from_vec(grid, vec![0; 125])
    }

    /// By hand: C11 = 13/3, C12 = C44 = 7/3 in k/h; 1/E = 10/27, 43/189, 34/189: E is 2.70, 4.40 and 5.56.
    #[test]
    fn equal_springs_are_twice_as_stiff_along_a_body_diagonal() {
        let solid = CubicSolid::of_springs([7.5; 3], 0.003);
        let unit = 7.5 / 0.003;
        near(solid.c11, 13.0 / 3.0 * unit);
        near(solid.c12, 7.0 / 3.0 * unit);
        near(solid.c44, 7.0 / 3.0 * unit);
        near(solid.youngs_modulus(&EDGE.into()), 2.7 * unit);
        near(solid.youngs_modulus(&FACE.into()), 189.0 / 43.0 * unit);
        near(solid.youngs_modulus(&BODY.into()), 189.0 / 34.0 * unit);
        near(solid.anisotropy(), 7.0 / 3.0);
        near(solid.bulk_modulus(), 3.0 * unit);
        for nu in solid.poissons_ratios(&EDGE.into()) {
            near(nu, 0.35);
        }
        // K = E / (3 (1 - 2 nu)) holds along a body diagonal too, for nothing singles out a direction across it.
        for nu in solid.poissons_ratios(&BODY.into()) {
            near(nu, 0.5 - 189.0 / 34.0 / 18.0);
        }
        // Across a face diagonal the two differ, and their mean keeps the bulk modulus.
        let [low, high] = solid.poissons_ratios(&FACE.into());
        assert!(high - low > 0.1, "{low} {high}");
        near(0.5 * (low + high), 0.5 - 189.0 / 43.0 / 18.0);
    }

    /// The strain energy of an evenly deformed neighbourhood, spring by spring, against the tensor.
    #[test]
    fn the_tensor_gives_the_energy_of_the_springs() {
        let (stiffness, pitch) = ([3.0, 1.3, 0.4], 0.002);
        let solid = CubicSolid::of_springs(stiffness, pitch);
        let strain = Matrix3::new(0.3, 0.1, -0.2, 0.1, -0.5, 0.05, -0.2, 0.05, 0.7);
        let energy: f64 = OFFSETS
            .iter()
            .enumerate()
            .map(|(direction, offset)| {
                let along = Vector3::from(offset.map(f64::from)) * pitch;
                let stretch = along.dot(&(strain * along)) / along.norm();
                // Each spring belongs to two particles.
                0.25 * stiffness[family(direction) - 1] * stretch * stretch / pitch.powi(3)
            })
            .sum();
        let e = |i: usize, j: usize| strain[(i, j)];
        let squares = e(0, 0).powi(2) + e(1, 1).powi(2) + e(2, 2).powi(2);
        let products = e(0, 0) * e(1, 1) + e(1, 1) * e(2, 2) + e(2, 2) * e(0, 0);
        let shears = e(0, 1).powi(2) + e(1, 2).powi(2) + e(2, 0).powi(2);
        near(0.5 * solid.c11 * squares + solid.c12 * products + 2.0 * solid.c44 * shears, energy);
    }

    #[test]
    fn isotropic_solids_look_the_same_from_everywhere() {
        let (e, nu, density, pitch) = (5e3, 0.45, 1060.0, 0.0015);
        let body = TissueBody { youngs_modulus: e, poissons_ratio: nu, density, damping: Damping::Ratio(0.1) };
        let weights = tissue::cell_weights(pitch).map(|weight| f64::from(weight) * body.spring_modulus());
        // A face spring is shared by four cells, a face diagonal by two.
        let springs = [4.0 * weights[0], 2.0 * weights[1], weights[2]];
        let solid = CubicSolid::of_springs(springs, pitch).with_volume_term(body.volume_modulus());
        near(solid.anisotropy(), 1.0);
        let mu = e / (2.0 * (1.0 + nu));
        let lambda = e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu));
        for along in [EDGE, FACE, BODY, [0.3, -2.0, 0.9]].map(Vector3::from) {
            near(solid.youngs_modulus(&along), e);
            for found in solid.poissons_ratios(&along) {
                near(found, nu);
            }
            let [pressure, shear, same] = solid.wave_speeds(density, &along);
            near(pressure, ((lambda + 2.0 * mu) / density).sqrt());
            near(shear, (mu / density).sqrt());
            near(same, shear);
        }
        for found in solid.shear_moduli() {
            near(found, mu);
        }
    }

    #[test]
    fn waves_along_a_diagonal_of_equal_springs() {
        let solid = CubicSolid { c11: 13.0, c12: 7.0, c44: 7.0 };
        let [pressure, fast, slow] = solid.wave_speeds(1.0, &FACE.into());
        // Textbook speeds along [110].
        near(pressure.powi(2), 0.5 * (13.0 + 7.0 + 14.0));
        near(fast.powi(2), 7.0);
        near(slow.powi(2), 3.0);
        assert_eq!(CubicSolid { c11: 1.0, c12: 2.0, c44: 1.0 }.wave_speeds(1.0, &FACE.into())[2], 0.0);
    }

    #[test]
    fn assembled_tissue_is_the_tissue_that_was_asked_for() {
        let lattice = build_cells(&block(), None).unwrap();
        let body =
            TissueBody { youngs_modulus: 5e3, poissons_ratio: 0.25, density: 1060.0, damping: Damping::Viscosity(3.0) };
        let mut assembly = tissue::assemble(&lattice, &[Some(body)]);
        let bulk = Bulk::of_organ(&lattice, &assembly, 0).unwrap();
        near(bulk.density, 1060.0);
        near(bulk.stiffness.anisotropy(), 1.0);
        near(bulk.stiffness.youngs_modulus(&BODY.into()), 5e3);
        near(bulk.viscosity.unwrap().youngs_modulus(&EDGE.into()), 3.0);
        assert!(Bulk::of_organ(&lattice, &assembly, 1).is_none());

        // Twice the first constant of Lame, 2000 Pa: nu = lambda / 2 (lambda + mu) = 1/3.
        assembly.volume = Some(VolumeTerm { modulus: vec![2e3; lattice.len()], viscosity: None });
        let bulk = Bulk::of_organ(&lattice, &assembly, 0).unwrap();
        for nu in bulk.stiffness.poissons_ratios(&FACE.into()) {
            near(nu, 1.0 / 3.0);
        }
    }

    #[test]
    fn assembled_paper_springs() {
        let lattice = build(&block()).unwrap();
        let body = PaperBody { stiffness: 7.5, damping: 0.0, mass: 2.7e-5 };
        let bulk = Bulk::of_organ(&lattice, &paper::assemble(&lattice, &[Some(body)]), 0).unwrap();
        near(bulk.density, 1000.0);
        near(bulk.stiffness.youngs_modulus(&EDGE.into()), 2.7 * 7.5 / 0.003);
        assert!(bulk.viscosity.is_none());
        let rigid = paper::assemble(&lattice, &[None]);
        assert!(Bulk::of_organ(&lattice, &rigid, 0).is_none());
    }
}
