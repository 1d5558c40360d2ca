//! The abdomen as a stack of layers: which tissue wins where, with which HU and label.
//!
//! Layers are ordered from the innermost to the outermost and each reaches under the ones before it, so at any border
//! two tissues share a voxel and none leaks in between: the share of a layer is the coverage of the union up to it less
//! the coverage of the union before it (see `raster`).

use super::label;
use super::liver::Liver;
use super::noise::{Lumps, Stream};
use super::sdf::FAR;
use super::torso;
use super::vessels::{Root, Vessels};
use super::viscera::{self, Bowel, Kidney};
use super::{bones, bones::Spine};
use crate::geometry::Point3;

/// What a layer is made of.
pub(super) struct Tissue {
    /// Mean [HU].
    pub(super) hu: f64,
    /// Label of its voxels.
    pub(super) label: u16,
}

const fn tissue(hu: f64, label: u16) -> Tissue {
    Tissue { hu, label }
}

/// Number of layers.
pub(super) const LAYERS: usize = 28;

/// HU in the portal venous phase, about 70 s after contrast was given; see the module's table.
pub(super) const TISSUES: [Tissue; LAYERS] = [
    tissue(165.0, label::LIVER_VESSELS),
    tissue(105.0, label::LIVER),
    tissue(8.0, label::GALLBLADDER),
    tissue(-70.0, label::FAT), // sinus of the kidneys
    tissue(115.0, label::KIDNEY_RIGHT),
    tissue(190.0, label::KIDNEY_RIGHT),
    tissue(115.0, label::KIDNEY_LEFT),
    tissue(190.0, label::KIDNEY_LEFT),
    tissue(30.0, label::SPINAL_CANAL),
    tissue(230.0, label::SPINE), // cancellous
    tissue(900.0, label::SPINE), // cortical
    tissue(85.0, label::SPINE),  // discs
    tissue(230.0, label::RIBS),
    tissue(850.0, label::RIBS),
    tissue(150.0, label::AORTA),
    tissue(140.0, label::VENA_CAVA),
    tissue(120.0, label::SPLEEN),
    tissue(95.0, label::PANCREAS),
    tissue(-950.0, label::STOMACH), // gas
    tissue(15.0, label::STOMACH),
    tissue(75.0, label::STOMACH),
    tissue(-900.0, label::BOWEL), // gas
    tissue(28.0, label::BOWEL),
    tissue(80.0, label::BOWEL),
    tissue(130.0, label::HEART),
    tissue(-840.0, label::LUNG),
    tissue(60.0, label::MUSCLE),
    tissue(-100.0, label::FAT),
];

/// Skin is the shell around everything and air the rest.
pub(super) const SKIN: Tissue = tissue(20.0, label::SKIN);
/// Air around the body [HU].
pub(super) const AIR_HU: f64 = -1000.0;

/// Farther from a border than any voxel reaches [mm].
const DEEP: f64 = 10.0;

/// One seeded patient.
pub(super) struct Abdomen {
    liver: Liver,
    vessels: Vessels,
    kidneys: [Kidney; 2],
    lobules: Lumps,
    bowel: Bowel,
}

/// Distances to the layers at a place; the last entry is the skin's outer surface.
pub(super) type Layers = [f64; LAYERS + 1];

impl Abdomen {
    pub(super) fn new(seed: u64) -> Self {
        let liver = Liver::new(seed);
        let kidneys = [Kidney::new(seed, true), Kidney::new(seed, false)];
        let lobules = Lumps::new(&mut Stream::new(seed, 5), 14.0, 4.0);
        let organ = |p: Point3| {
            let around = Around { spine: Spine::at(p), great: viscera::great_vessels(p), kidney: kidneys[0].outer(p) };
            liver_at(&liver, &around, p, torso::cavity(p))
        };
        let point = Point3::new;
        let portal = Root {
            start: point(30.0, 8.0, -16.0),
            trunk: vec![point(36.0, 9.0, -6.0), point(46.0, 9.0, 0.0)],
            radius: 6.5,
        };
        let portal_left = Root {
            start: point(36.0, 9.0, -6.0),
            trunk: vec![point(24.0, 18.0, 6.0), point(12.0, 32.0, 15.0)],
            radius: 4.6,
        };
        let portal_lower = Root {
            start: point(46.0, 9.0, 0.0),
            trunk: vec![point(64.0, 6.0, -10.0), point(82.0, 4.0, -20.0)],
            radius: 4.4,
        };
        let hepatic_lower = Root {
            start: point(68.0, -22.0, 30.0),
            trunk: vec![point(90.0, -18.0, 10.0), point(104.0, -4.0, -8.0)],
            radius: 4.0,
        };
        let hepatic = [
            [point(44.0, -12.0, 38.0), point(68.0, -22.0, 30.0)],
            [point(34.0, 4.0, 40.0), point(46.0, 20.0, 30.0)],
            [point(22.0, 10.0, 42.0), point(6.0, 30.0, 36.0)],
        ]
        .map(|trunk| Root { start: point(23.0, -4.0, 46.0), trunk: trunk.to_vec(), radius: 5.2 });
        let roots: Vec<Root> = [portal, portal_left, portal_lower, hepatic_lower].into_iter().chain(hepatic).collect();
        let vessels = Vessels::grow(&mut Stream::new(seed, 6), &roots, organ);
        // Cheap tests first: most of the places the packing tries are taken.
        let bowel = Bowel::new(seed, |p, room| {
            let cavity = torso::cavity(p);
            if -cavity < room || kidneys.iter().any(|k| k.outer(p) < room) || liver.gallbladder(p) < room {
                return false;
            }
            let [aorta, cava] = viscera::great_vessels(p);
            let spine = Spine::at(p);
            if aorta.min(cava).min(spine.bone).min(spine.disc) < room || viscera::pancreas(p, &lobules) < room {
                return false;
            }
            let liver = organ(p);
            liver > room
                && torso::muscle(p, cavity, FAR) > room
                && viscera::spleen(p, cavity, kidneys[1].outer(p)) > room
                && viscera::stomach(p, cavity, liver).outer > room
        });
        Self { liver, vessels, kidneys, lobules, bowel }
    }

    /// Distances to all layers at a place.
    pub(super) fn layers(&self, p: Point3) -> Layers {
        let mut d = [FAR; LAYERS + 1];
        let body = torso::body(p);
        d[LAYERS] = body;
        d[LAYERS - 1] = body + torso::SKIN;
        // Nothing but skin and fat within 4 mm of the surface.
        if body > -4.0 {
            return d;
        }
        let cavity = torso::cavity(p);
        // Innermost first: deep inside the liver nothing but its vessels can show.
        let around = Around { spine: Spine::at(p), great: viscera::great_vessels(p), kidney: self.kidneys[0].outer(p) };
        let liver = liver_at(&self.liver, &around, p, cavity);
        d[0] = if liver < 8.0 { self.vessels.distance(p).max(liver) } else { FAR };
        d[1] = liver;
        if liver < -DEEP {
            return d;
        }
        let spine = &around.spine;
        (d[8], d[9], d[10], d[11]) = (spine.canal, spine.cancellous, spine.bone, spine.disc);
        [d[12], d[13]] = bones::ribs(p, cavity);
        let beneath = if cavity < 8.0 { self.organs(p, cavity, &around, &mut d) } else { FAR };
        let lung = if cavity < 8.0 { torso::lung(p, cavity, beneath) } else { FAR };
        d[25] = lung;
        d[26] = torso::muscle(p, cavity, lung);
        d
    }

    /// Fills the layers inside the cavity; returns the distance to all that lungs give way to.
    fn organs(&self, p: Point3, cavity: f64, around: &Around, d: &mut Layers) -> f64 {
        d[2] = self.liver.gallbladder(p);
        let [right, left] = [self.kidneys[0].parts(p), self.kidneys[1].parts(p)];
        d[3] = right.sinus.min(left.sinus);
        (d[4], d[5], d[6], d[7]) = (right.medulla, right.outer, left.medulla, left.outer);
        [d[14], d[15]] = around.great;
        d[16] = viscera::spleen(p, cavity, left.outer);
        d[17] = viscera::pancreas(p, &self.lobules);
        let solid = d[1].min(d[2]).min(d[5]).min(d[7]).min(d[14]).min(d[15]).min(d[16]).min(d[17]);
        let stomach = viscera::stomach(p, cavity, solid);
        (d[18], d[19], d[20]) = (stomach.gas, stomach.content, stomach.outer);
        let bowel = self.bowel.at(p, cavity, solid.min(stomach.outer));
        (d[21], d[22], d[23]) = (bowel.gas, bowel.content, bowel.outer);
        d[24] = viscera::heart(p, cavity);
        solid.min(d[24]).min(stomach.outer).min(bowel.outer).min(d[10]).min(d[11])
    }
}

/// What the liver gives way to.
struct Around {
    spine: Spine,
    /// Aorta and vena cava.
    great: [f64; 2],
    /// Right kidney.
    kidney: f64,
}

/// Distance to the liver among its neighbours.
fn liver_at(liver: &Liver, around: &Around, p: Point3, cavity: f64) -> f64 {
    if cavity > 8.0 || p.x < -76.0 {
        return FAR;
    }
    let (spine, [aorta, cava]) = (&around.spine, around.great);
    // The vena cava lies in a groove of the liver; everything else keeps its fat.
    let clear = around.kidney.min(viscera::renal_bed(p)).min(aorta).min(spine.bone).min(spine.disc).min(cava + 5.0);
    liver.distance(p, cavity, clear)
}
