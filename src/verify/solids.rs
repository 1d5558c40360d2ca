//! Elastic constants, interfaces, bars and beams against the theory of elasticity.

use super::lattices::{MATERIAL, PITCH, Solid, bar, composite, composite_at};
use super::statics::{Statics, Supports};
use super::{Case, Finding, Group};
use crate::geometry::{Matrix3, Vector3};
use crate::kernel::reference::{spring_forces, volume_forces};
use crate::lattice::Topology;
use crate::lattice::neighbours::ALL_ALIVE;
use crate::material::tissue::{CellValues, TissueBody, assemble_varied};

/// Poisson's ratios that are tried.
const RATIOS: [f64; 6] = [0.0, 0.1, 0.25, 0.3, 0.45, 0.49];
/// Edge of a cell [m].
const H: f64 = PITCH * 1e-3;

pub(super) fn cases() -> Vec<Case> {
    let case = |name, asked, run| Case { group: Group::Solids, name, asked, run };
    vec![
        case("uniaxial", "a bar pulled between rollers has the E and nu that were asked for, nu = 0 to 0.49", uniaxial),
        case(
            "affine-patch-f64",
            "an even deformation (stretched, sheared and turned by some 15 %) leaves no force inside, in f64",
            patch_f64,
        ),
        case("affine-patch-f32", "the same in f32, in the loop that steps", patch_f32),
        case("bars-in-series", "two materials end to end, E 1 : 7: the sum of their compliances", series),
        case("bars-in-parallel", "two materials side by side, E 1 : 7: the sum of their stiffnesses", parallel),
        case("partly-filled", "a bar whose outer cells are 40 % tissue has the stiffness of its tissue", partly_filled),
        case(
            "cantilever",
            "the tip of a beam, as a share of Timoshenko's deflection, comes nearer at second order",
            cantilever,
        ),
        case(
            "hanging-column",
            "a column under its own weight stretches by rho g L^2 / 2E, and by the integral where rho differs with height",
            hanging_column,
        ),
    ]
}

/// Pulls a solid by a strain along z between two rollers; gives the displacements and the force [N].
fn pulled(solid: &Solid, cells: usize, strain: f64) -> (Vec<Vector3>, f64) {
    let statics = Statics::new(solid);
    let mut supports = Supports::none(&solid.lattice);
    let (low, high) = (solid.layer(2, 0), solid.layer(2, cells));
    low.iter().for_each(|&p| supports.give(p, 2, 0.0));
    high.iter().for_each(|&p| supports.give(p, 2, strain * cells as f64 * H));
    // One corner may not move across, and its neighbour along x may not turn.
    (0..2).for_each(|axis| supports.give(low[0], axis, 0.0));
    supports.give(low[1], 1, 0.0);
    let displacement = statics.solve(&supports, &vec![Vector3::zeros(); solid.lattice.len()]);
    let held = statics.holding_forces(&displacement);
    (displacement, high.iter().map(|&p| held[p as usize].z).sum())
}

fn uniaxial() -> Finding {
    let (cells, strain) = ([3, 4, 5], 1e-3);
    let (mut worst, mut texts) = (0.0_f64, Vec::new());
    for nu in RATIOS {
        let solid = bar(cells, TissueBody { poissons_ratio: nu, ..MATERIAL });
        let (displacement, force) = pulled(&solid, cells[2], strain);
        let modulus = force / (strain * (cells[0] * cells[1]) as f64 * H * H);
        let width = |axis: usize| {
            let mean = |layer: Vec<u32>| {
                layer.iter().map(|&p| displacement[p as usize][axis]).sum::<f64>() / layer.len() as f64
            };
            (mean(solid.layer(axis, cells[axis])) - mean(solid.layer(axis, 0))) / (cells[axis] as f64 * H)
        };
        let ratio = -0.5 * (width(0) + width(1)) / strain;
        worst = worst.max((modulus / MATERIAL.youngs_modulus - 1.0).abs()).max((ratio - nu).abs());
        texts.push(format!("{nu}: {modulus:.3} Pa, {ratio:.6}"));
    }
    Finding {
        happened: format!("E of 5000 Pa and nu found: {}", texts.join("; ")),
        error: worst,
        allowed: 1e-4,
        steps: 0,
    }
}

/// A deformation that stretches, shears and turns.
fn even_deformation() -> Matrix3 {
    Matrix3::new(10.0, 6.0, -4.0, -2.0, -8.0, 12.0, 8.0, -6.0, 4.0) / 64.0
}

/// Particles with all springs, whose forces must cancel, and the others.
fn inside(solid: &Solid) -> Vec<bool> {
    solid.lattice.springs.iter().map(|&springs| springs == ALL_ALIVE).collect()
}

/// Largest force inside over the largest at the border.
fn imbalance(inside: &[bool], force: &[Vector3]) -> f64 {
    let largest = |wanted: bool| {
        let chosen = force.iter().zip(inside).filter(|(_, inside)| **inside == wanted);
        chosen.map(|(force, _)| force.norm()).fold(0.0, f64::max)
    };
    largest(true) / largest(false)
}

fn patch_f64() -> Finding {
    let mut worst = 0.0_f64;
    for nu in RATIOS {
        let solid = bar([6, 5, 7], TissueBody { poissons_ratio: nu, ..MATERIAL });
        let (lattice, topology) = (&solid.lattice, Topology::new(&solid.lattice));
        let moved: Vec<Vector3> = (0..lattice.len() as u32).map(|p| even_deformation() * solid.place(p)).collect();
        let still = vec![Vector3::zeros(); lattice.len()];
        let springs = spring_forces(lattice, &topology, &solid.assembly, &moved, &still, 1.0);
        let cells = volume_forces(lattice, &topology, &solid.assembly, &moved, &still, 1.0);
        let force: Vec<Vector3> = springs.iter().zip(&cells).map(|(a, b)| a + b).collect();
        worst = worst.max(imbalance(&inside(&solid), &force));
    }
    let happened = format!("largest force inside is {worst:.1e} of that at the border, for six Poisson's ratios");
    Finding { happened, error: worst, allowed: 1e-12, steps: 0 }
}

fn patch_f32() -> Finding {
    let mut worst = 0.0_f64;
    for nu in RATIOS {
        // A pitch of 2^-9 m: f32 holds these displacements exactly, and what is left is the rounding of the loop.
        let body = TissueBody { poissons_ratio: nu, ..MATERIAL };
        let solid = composite_at(1.953125, [20, 9, 10], &[body], |_| 0);
        let inside = inside(&solid);
        let moved: Vec<Vector3> =
            (0..solid.lattice.len() as u32).map(|p| even_deformation() * solid.place(p)).collect();
        let mut world = solid.world(1e-6);
        moved.iter().enumerate().for_each(|(p, u)| world.set_displacement(p as u32, *u));
        world.step().expect("a step of a microsecond");
        let force: Vec<Vector3> =
            (0..moved.len()).map(|p| world.velocity(p as u32) * f64::from(world.mass()[p])).collect();
        worst = worst.max(imbalance(&inside, &force));
    }
    let happened = format!("largest force inside is {worst:.1e} of that at the border, for six Poisson's ratios");
    Finding { happened, error: worst, allowed: 1e-6, steps: RATIOS.len() as u64 }
}

fn series() -> Finding {
    // Without sideways contraction, so that the two do not pull at each other across.
    let soft = TissueBody { poissons_ratio: 0.0, ..MATERIAL };
    let stiff = TissueBody { youngs_modulus: 7.0 * soft.youngs_modulus, ..soft };
    let solid = composite([3, 3, 9], &[soft, stiff], |[.., k]| u8::from(k >= 4));
    let (_, force) = pulled(&solid, 9, 1e-3);
    let compliance = 4.0 / soft.youngs_modulus + 5.0 / stiff.youngs_modulus;
    let expected = 9e-3 / compliance * 9.0 * H * H;
    two_materials(force, expected)
}

fn parallel() -> Finding {
    let soft = TissueBody { poissons_ratio: 0.3, ..MATERIAL };
    let stiff = TissueBody { youngs_modulus: 7.0 * soft.youngs_modulus, ..soft };
    let solid = composite([5, 3, 6], &[soft, stiff], |[i, ..]| u8::from(i >= 2));
    let (_, force) = pulled(&solid, 6, 1e-3);
    two_materials(force, 1e-3 * (6.0 * soft.youngs_modulus + 9.0 * stiff.youngs_modulus) * H * H)
}

fn two_materials(force: f64, expected: f64) -> Finding {
    let happened = format!("{:.6} mN for a strain of 0.1 %, expected {:.6} mN", 1e3 * force, 1e3 * expected);
    Finding { happened, error: (force / expected - 1.0).abs(), allowed: 1e-3, steps: 0 }
}

fn partly_filled() -> Finding {
    use crate::geometry::{Affine, Grid, GridShape};
    use crate::lattice::build::OrganMap;
    use crate::lattice::cells::build_cells;
    use crate::volume::Volume;
    let body = TissueBody { poissons_ratio: 0.45, ..MATERIAL };
    let grid =
        Grid { shape: GridShape::new(4, 3, 6), affine: Affine::from_spacing([PITCH; 3], [0.0; 3]).expect("a spacing") };
    let fill = |voxel: usize| if grid.shape.ijk(voxel)[0] == 3 { 0.4 } else { 1.0 };
    let fill = Volume::from_vec(grid, (0..grid.shape.len()).map(fill).collect());
    let lattice = build_cells(&OrganMap::from_vec(grid, vec![0; grid.shape.len()]), Some(&fill)).expect("cells");
    let assembly = crate::material::tissue::assemble(&lattice, &[Some(body)]);
    let (_, force) = pulled(&Solid { lattice, assembly }, 6, 1e-3);
    two_materials(force, 1e-3 * body.youngs_modulus * 3.4 * 3.0 * H * H)
}

/// How the root of a beam is held.
#[derive(Clone, Copy, PartialEq)]
enum Root {
    /// As Timoshenko's: no displacement along the beam, the shear force spread over the cross-section.
    Guided,
    /// Every particle of the cross-section held, which keeps it from narrowing.
    Clamped,
}

/// Deflection of the tip over that of Timoshenko's beam.
fn tip(across: usize, nu: f64, root: Root) -> f64 {
    const SLENDERNESS: usize = 6;
    let body = TissueBody { poissons_ratio: nu, ..MATERIAL };
    let cells = [SLENDERNESS * across, across, across];
    // The same beam at every resolution, in cells of its own size: only ratios count.
    let solid = bar(cells, body);
    let statics = Statics::new(&solid);
    let mut supports = Supports::none(&solid.lattice);
    let (held, end) = (solid.layer(0, 0), solid.layer(0, cells[0]));
    for &p in &held {
        let axes = if root == Root::Clamped { 0..3 } else { 0..1 };
        axes.for_each(|axis| supports.give(p, axis, 0.0));
    }
    let mut force = vec![Vector3::zeros(); solid.lattice.len()];
    let mut shares = Vec::new();
    for &p in &end {
        let at = solid.lattice.ijk(p);
        // Border points of the face carry half or a quarter of the area.
        let share = (1..3).map(|axis| if [1, across + 1].contains(&at[axis]) { 0.5 } else { 1.0 }).product::<f64>();
        shares.push(share / (across * across) as f64);
        force[p as usize].z = 1e-3 * shares[shares.len() - 1];
    }
    if root == Root::Guided {
        // The shear force; what is left for the supports is nothing but where the beam is.
        held.iter().zip(&shares).for_each(|(&p, share)| force[p as usize].z = -1e-3 * share);
        supports.give(held[0], 1, 0.0);
        supports.give(held[0], 2, 0.0);
        supports.give(held[across], 2, 0.0);
    }
    let displacement = statics.solve(&supports, &force);
    let mean =
        |face: &[u32]| -> f64 { face.iter().zip(&shares).map(|(&p, share)| share * displacement[p as usize].z).sum() };
    let found = mean(&end) - mean(&held);
    let (length, side) = (cells[0] as f64 * H, across as f64 * H);
    let shear_modulus = body.youngs_modulus / (2.0 * (1.0 + nu));
    // Cowper's coefficient for a rectangle.
    let kappa = 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu);
    let bending = 4.0 * length.powi(3) / (body.youngs_modulus * side.powi(4));
    let shear = length / (kappa * shear_modulus * side.powi(2));
    found / (1e-3 * (bending + shear))
}

fn cantilever() -> Finding {
    let (mut texts, mut worst) = (Vec::new(), 0.0_f64);
    for (nu, root) in [(0.25, Root::Guided), (0.45, Root::Guided), (0.25, Root::Clamped)] {
        let ratios = [2, 4, 8, 16].map(|across| tip(across, nu, root));
        // From three resolutions, without knowing the limit: a clamp is a little stiffer than Timoshenko's.
        let order = ((ratios[2] - ratios[1]) / (ratios[3] - ratios[2])).log2();
        worst = worst.max((0.96 - ratios[2]) / 0.96).max((1.8 - order) / 1.8);
        let ratios = ratios.map(|ratio| format!("{ratio:.4}")).join(", ");
        let root = if root == Root::Guided { "" } else { ", clamped" };
        texts.push(format!("nu {nu}{root}: {ratios} for 2, 4, 8, 16 cells across, order {order:.2}"));
    }
    let happened =
        format!("{}; at least 0.96 at 8 and order 1.8 are asked for, the error is what lacks", texts.join("; "));
    Finding { happened, error: worst.max(0.0), allowed: 0.0, steps: 0 }
}

fn hanging_column() -> Finding {
    const GRAVITY: f64 = 9.81;
    let (cells, mut worst, mut texts) = ([4, 4, 24], 0.0_f64, Vec::new());
    let length = cells[2] as f64 * H;
    for (nu, graded) in [(0.0, false), (0.25, false), (0.45, false), (0.0, true), (0.25, true), (0.45, true)] {
        let body = TissueBody { poissons_ratio: nu, ..MATERIAL };
        let mut solid = bar(cells, body);
        // Of the material's density, by the height over the lower end from 0 to 1.
        let share = |height: f64| if graded { 0.4 + 1.8 * height * height } else { 1.0 };
        let density = |cell: u32| body.density * share((solid.place(cell).z + 0.5 * H) / length);
        solid.assembly = assemble_varied(&solid.lattice, &[Some(body)], &[None], |cell| CellValues {
            density: Some(density(cell)),
            ..CellValues::default()
        });
        let mut supports = Supports::none(&solid.lattice);
        let top = solid.layer(2, cells[2]);
        top.iter().for_each(|&p| supports.give(p, 2, 0.0));
        (0..2).for_each(|axis| supports.give(top[0], axis, 0.0));
        supports.give(top[1], 1, 0.0);
        let weight =
            solid.assembly.mass.iter().map(|&m| Vector3::new(0.0, 0.0, -GRAVITY * f64::from(m))).collect::<Vec<_>>();
        let displacement = Statics::new(&solid).solve(&supports, &weight);
        let end = solid.layer(2, 0);
        let found = -end.iter().map(|&p| displacement[p as usize].z).sum::<f64>() / end.len() as f64;
        // The integral of share (1 - height) over the height: 0.4 / 2 + 1.8 (1/3 - 1/4).
        let integral = if graded { 0.35 } else { 0.5 };
        let expected = integral * body.density * GRAVITY * length * length / body.youngs_modulus;
        worst = worst.max((found / expected - 1.0).abs());
        let graded = if graded { ", density graded 0.4 to 2.2" } else { "" };
        texts.push(format!("nu {nu}{graded}: {:.4} mm of {:.4} mm", 1e3 * found, 1e3 * expected));
    }
    Finding { happened: texts.join("; "), error: worst, allowed: 5e-3, steps: 0 }
}
