//! Volumes the program makes itself: a procedural abdomen, the paper's cube and a beam.
//!
//! Coordinates are RAS+ [mm]: x grows to the patient's right, y to the front, z to the head. The abdomen's origin is the
//! centre of the trunk at mid-liver height, so the liver has x > 0 and the spine y < 0.
//!
//! The abdomen is a section of a trunk (about 320 x 220 x 174 mm) closed by skin on all sides, with air around it. It
//! imitates a CT in the portal venous phase: liver 105 HU with vessels at 165, renal cortex 190 and medulla 115, spleen
//! 120, aorta 150, vena cava 140, muscle 60, fat -100, cancellous bone 230, cortical bone 850-900, skin 20, air -1000.
//! Noise has a standard deviation of [`NOISE_HU`] at every spacing and the correlation of a smooth kernel within a slice.
//!
//! Guaranteed: same spacing and seed, same bits, at any thread count (on one platform: sines and powers come from its
//! mathematics library); partial volume at every border; every organ clear of the volume's border; the anatomy of a seed
//! is the same at every spacing. Not guaranteed: anatomical completeness (no adrenals, ureters or bile ducts; five
//! vertebrae), vessels thinner than a voxel in the label map (they remain in the HU), values between releases.

mod abdomen;
mod blocks;
mod bones;
mod liver;
pub(crate) mod noise;
mod raster;
mod sdf;
mod torso;
mod vessels;
mod viscera;

use crate::geometry::{Affine, Grid, GridShape};
use crate::scene::resolved::PhantomKind;
use crate::volume::{CtVolume, LabelVolume, Volume};

/// Labels of the phantoms.
pub mod label {
    /// Air around the body.
    pub const AIR: u16 = 0;
    /// Liver without its vessels; take it together with [`LIVER_VESSELS`] for the whole organ.
    pub const LIVER: u16 = 1;
    /// Portal and hepatic veins inside the liver.
    pub const LIVER_VESSELS: u16 = 2;
    /// Right kidney, cortex and medulla.
    pub const KIDNEY_RIGHT: u16 = 3;
    /// Left kidney, cortex and medulla.
    pub const KIDNEY_LEFT: u16 = 4;
    /// Vertebrae and discs.
    pub const SPINE: u16 = 5;
    /// Ribs of both sides.
    pub const RIBS: u16 = 6;
    /// Fat under the skin and between the organs.
    pub const FAT: u16 = 7;
    /// Abdominal wall, back, psoas, diaphragm.
    pub const MUSCLE: u16 = 8;
    /// Skin.
    pub const SKIN: u16 = 9;
    /// Aorta.
    pub const AORTA: u16 = 10;
    /// Inferior vena cava.
    pub const VENA_CAVA: u16 = 11;
    /// Spleen.
    pub const SPLEEN: u16 = 12;
    /// Stomach, content included.
    pub const STOMACH: u16 = 13;
    /// Small bowel and colon, content included.
    pub const BOWEL: u16 = 14;
    /// Pancreas.
    pub const PANCREAS: u16 = 15;
    /// Gallbladder.
    pub const GALLBLADDER: u16 = 16;
    /// Bases of both lungs.
    pub const LUNG: u16 = 17;
    /// Spinal canal.
    pub const SPINAL_CANAL: u16 = 18;
    /// The cube or the beam.
    pub const BLOCK: u16 = 1;
    /// Apex of the heart.
    pub const HEART: u16 = 19;
    /// Number of labels of the abdomen, air included.
    pub(super) const COUNT: usize = 20;
}

/// Label and name of every organ of the abdomen.
pub const ABDOMEN_NAMES: &[(u16, &str)] = &[
    (label::LIVER, "liver"),
    (label::LIVER_VESSELS, "liver_vessels"),
    (label::KIDNEY_RIGHT, "kidney_right"),
    (label::KIDNEY_LEFT, "kidney_left"),
    (label::SPINE, "spine"),
    (label::RIBS, "ribs"),
    (label::FAT, "fat"),
    (label::MUSCLE, "muscle"),
    (label::SKIN, "skin"),
    (label::AORTA, "aorta"),
    (label::VENA_CAVA, "vena_cava"),
    (label::SPLEEN, "spleen"),
    (label::STOMACH, "stomach"),
    (label::BOWEL, "bowel"),
    (label::PANCREAS, "pancreas"),
    (label::GALLBLADDER, "gallbladder"),
    (label::LUNG, "lung"),
    (label::SPINAL_CANAL, "spinal_canal"),
    (label::HEART, "heart"),
];

/// Label and name of the cube.
pub const CUBE_NAMES: &[(u16, &str)] = &[(label::BLOCK, "cube")];
/// Label and name of the beam.
pub const BEAM_NAMES: &[(u16, &str)] = &[(label::BLOCK, "beam")];

/// Smallest and largest voxel spacing of a phantom [mm].
pub const SPACING_MM: [f64; 2] = [0.5, 10.0];
/// Standard deviation of the abdomen's noise [HU].
pub const NOISE_HU: f64 = 11.0;
/// Value of the cube and the beam [HU].
pub const BLOCK_HU: f32 = 50.0;
/// Edge of the cube that [`make`] makes, to the nearest whole voxel [mm].
pub const CUBE_MM: f64 = 60.0;
/// Edges of the beam that [`make`] makes, to the nearest whole voxel [mm].
pub const BEAM_MM: [f64; 3] = [160.0, 32.0, 32.0];

/// A made volume: CT image, label map on the same grid, and the names of the labels.
#[derive(Debug, Clone)]
pub struct Phantom {
    /// CT image [HU].
    pub image: CtVolume,
    /// Label map; 0 is air.
    pub labels: LabelVolume,
    /// Label and name of every organ.
    pub names: &'static [(u16, &'static str)],
}

/// Why a phantom cannot be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PhantomError {
    /// The spacing is not a number, or out of range.
    #[error("phantom spacing is {found} mm; choose a voxel spacing from {} to {} mm", SPACING_MM[0], SPACING_MM[1])]
    BadSpacing {
        /// The spacing asked for [mm].
        found: f64,
    },
    /// A block has no voxels, or too many along an edge.
    #[error("a block of {found} voxels along an edge cannot be made; choose from 1 to {most}")]
    BadCount {
        /// The number asked for.
        found: usize,
        /// The largest number allowed.
        most: usize,
    },
    /// The whole volume would take too much memory.
    #[error(
        "the phantom would have {voxels} voxels, air included; at most {most} are made: choose fewer or larger voxels"
    )]
    TooLarge {
        /// Voxels, air included.
        voxels: usize,
        /// The largest number allowed.
        most: usize,
    },
}

/// Air around the body on every side, at least [mm].
const AIR_MARGIN: f64 = 6.0;

/// The abdomen at a voxel spacing [mm].
///
/// The grid is symmetric about the origin, which is a voxel centre at every spacing. Takes about 0.6 s at 3 mm on two
/// cores, and time and memory (6 bytes per voxel) grow with the number of voxels: 119 million at 0.5 mm.
///
/// # Errors
/// If the spacing is not in [`SPACING_MM`].
///
/// # Panics
/// Never: the spacing was checked.
pub fn abdomen(spacing_mm: f64, seed: u64) -> Result<Phantom, PhantomError> {
    check_spacing(spacing_mm)?;
    let half = [torso::HALF_WIDTH[0], torso::HALF_WIDTH[1], torso::HALF_HEIGHT];
    // Half a voxel more, so that no border voxel holds a part of the body.
    let reach = half.map(|h| ((h + AIR_MARGIN) / spacing_mm + 0.5).ceil() as usize);
    let [nx, ny, nz] = reach.map(|n| 2 * n + 1);
    let origin = reach.map(|n| -(n as f64) * spacing_mm);
    let affine = Affine::from_spacing([spacing_mm; 3], origin).expect("the spacing was checked");
    let grid = Grid { shape: GridShape::new(nx, ny, nz), affine };
    let patient = abdomen::Abdomen::new(seed);
    let (image, labels) = raster::render(&patient, &grid, reach.map(|n| -(n as i64)), (seed, NOISE_HU));
    Ok(Phantom { image: Volume::from_vec(grid, image), labels: Volume::from_vec(grid, labels), names: ABDOMEN_NAMES })
}

/// A cube of `voxels` along each edge, centred at the origin: [`BLOCK_HU`] in air, two voxels of air on every side.
///
/// # Errors
/// If the spacing is not in [`SPACING_MM`] or the number of voxels is 0 or too large.
pub fn cube(voxels: usize, spacing_mm: f64) -> Result<Phantom, PhantomError> {
    check_spacing(spacing_mm)?;
    blocks::block([voxels; 3], spacing_mm, label::BLOCK, CUBE_NAMES)
}

/// A bar of the given number of voxels along x, y, z, centred at the origin, as [`cube`].
///
/// # Errors
/// As [`cube`].
pub fn beam(voxels: [usize; 3], spacing_mm: f64) -> Result<Phantom, PhantomError> {
    check_spacing(spacing_mm)?;
    blocks::block(voxels, spacing_mm, label::BLOCK, BEAM_NAMES)
}

/// The phantom a scene names. Cube and beam take [`CUBE_MM`] and [`BEAM_MM`] to the nearest whole number of voxels (60 mm
/// at 3 mm: 20; 160 x 32 x 32 mm at 4 mm: 40 x 8 x 8) and have no use for the seed.
///
/// # Errors
/// If the spacing is not in [`SPACING_MM`].
pub fn make(kind: PhantomKind, spacing_mm: f64, seed: u64) -> Result<Phantom, PhantomError> {
    check_spacing(spacing_mm)?;
    let voxels = |length: f64| (length / spacing_mm).round() as usize;
    match kind {
        PhantomKind::Abdomen => abdomen(spacing_mm, seed),
        PhantomKind::Cube => cube(voxels(CUBE_MM), spacing_mm),
        PhantomKind::Beam => beam(BEAM_MM.map(voxels), spacing_mm),
    }
}

fn check_spacing(found: f64) -> Result<(), PhantomError> {
    // NaN is in no range.
    if (SPACING_MM[0]..=SPACING_MM[1]).contains(&found) { Ok(()) } else { Err(PhantomError::BadSpacing { found }) }
}
