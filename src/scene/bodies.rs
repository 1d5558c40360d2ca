//! What an organ is made of: a material by name, its numbers, or the constants of the paper.

use std::path::Path;

use super::checks::Checks;
use super::diagnostics::KeyPath;
use super::problem::{Caution, Problem, nearest_name, number};
use super::resolved::{Body, Damping, Model, YoungsModulus};
use super::schema::{self, SceneFile};
use super::values::{MapPoint, Modulus, VaryingModulus};
use crate::material::library::{Tissue, tissue, tissues};

const DEFAULT_DAMPING_RATIO: f64 = 0.1;
/// What springs alone have, so the one value without a volume term.
const DEFAULT_POISSONS_RATIO: f64 = 0.25;
/// Nearer to 1/2 an explicit step is not worth its price, and the cells lock.
const POISSONS_RATIO: [f64; 2] = [0.0, 0.49];
const PAPER_KEYS: &str = "stiffness (N/m), damping (N s/m) and mass (kg)";
const TISSUE_KEYS: &str = "youngs_modulus (Pa), density (kg/m3), poissons_ratio and damping_ratio or viscosity (Pa s), or \
                           a material by name";

/// Checks and resolves what an organ is made of; `None` when a problem was found.
pub(super) fn body(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    organ: &schema::Organ,
    file: &SceneFile,
    model: Model,
    folder: &Path,
) -> Option<Body> {
    let paper = [
        ("stiffness", organ.stiffness.is_some()),
        ("damping", organ.damping.is_some()),
        ("mass", organ.mass.is_some()),
    ];
    // What a deformable tissue alone has; a rigid body shares the other two with it.
    let deformable = [
        ("youngs_modulus", organ.youngs_modulus.is_some()),
        ("poissons_ratio", organ.poissons_ratio.is_some()),
        ("damping_ratio", organ.damping_ratio.is_some()),
        ("viscosity", organ.viscosity.is_some()),
    ];
    let shared = [("material", organ.material.is_some()), ("density", organ.density.is_some())];
    if organ.rigid {
        for (key, _) in paper.into_iter().chain(deformable).filter(|(_, written)| *written) {
            let next = "a rigid organ does not deform, so of a material it takes the density only; keep one of the two";
            let problem = Problem::Conflict { first: "rigid".into(), second: key.into(), next: next.to_owned() };
            checks.problem(&table.key(key), problem);
        }
        return rigid(checks, table, organ);
    }
    let foreign: Vec<(&'static str, bool)> = match model {
        Model::Tissue => paper.to_vec(),
        Model::Paper => deformable.into_iter().chain(shared).collect(),
    };
    let (belongs_to, model_name, takes) = match model {
        Model::Tissue => ("paper", "tissue", TISSUE_KEYS),
        Model::Paper => ("tissue", "paper", PAPER_KEYS),
    };
    for (key, _) in foreign.into_iter().filter(|(_, written)| *written) {
        checks.problem(&table.key(key), Problem::OtherModel { key, belongs_to, model: model_name, takes });
    }
    match model {
        Model::Tissue => elastic(checks, table, organ, file, folder),
        Model::Paper => of_the_paper(checks, table, organ),
    }
}

fn rigid(checks: &mut Checks<'_>, table: &KeyPath, organ: &schema::Organ) -> Option<Body> {
    let material = material(checks, table, organ).ok()?;
    if let Some(density) = organ.density {
        check_density(checks, table, density);
    }
    Some(Body::Rigid { density: organ.density.or(material.map(|tissue| tissue.density)) })
}

fn of_the_paper(checks: &mut Checks<'_>, table: &KeyPath, organ: &schema::Organ) -> Option<Body> {
    let stiffness = needed(checks, table, "stiffness", organ.stiffness, Model::Paper, "10 (N/m)");
    let damping = needed(checks, table, "damping", organ.damping, Model::Paper, "0.01 (N s/m)");
    let mass = needed(checks, table, "mass", organ.mass, Model::Paper, "3e-5 (kg)");
    let (stiffness, damping, mass) = (stiffness?, damping?, mass?);
    checks.above_zero(&table.key("stiffness"), stiffness, "N/m");
    checks.not_negative(&table.key("damping"), damping, "N s/m");
    checks.above_zero(&table.key("mass"), mass, "kg");
    Some(Body::Paper { stiffness, damping, mass })
}

fn elastic(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    organ: &schema::Organ,
    file: &SceneFile,
    folder: &Path,
) -> Option<Body> {
    // A name that is not known has been reported; that its numbers are missing would not be news.
    let material = material(checks, table, organ).ok()?;
    let written = organ.youngs_modulus.clone().or(material.map(|tissue| Modulus::Constant(tissue.youngs_modulus)));
    let example = "5e3 (Pa), or take one by name: material = \"liver\"";
    let written = needed(checks, table, "youngs_modulus", written, Model::Tissue, example);
    let density = organ.density.or(material.map(|tissue| tissue.density));
    let density = needed(checks, table, "density", density, Model::Tissue, "1060 (kg/m3)");
    let youngs_modulus = written.and_then(|written| modulus(checks, table, written, file, folder));
    if let Some(density) = density {
        check_density(checks, table, density);
    }
    let poissons_ratio = poissons_ratio(checks, table, organ.poissons_ratio, material);
    let damping = damping(checks, table, organ);
    Some(Body::Tissue { youngs_modulus: youngs_modulus?, poissons_ratio, density: density?, damping: damping? })
}

/// A value that must be written, if it is.
fn needed<T>(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    key: &str,
    value: Option<T>,
    model: Model,
    example: &str,
) -> Option<T> {
    if value.is_none() {
        let (name, takes) = match model {
            Model::Tissue => ("tissue", TISSUE_KEYS),
            Model::Paper => ("paper", PAPER_KEYS),
        };
        checks.missing(table, key, format!("model \"{name}\" takes {takes}; write {key} = {example}"));
    }
    value
}

/// A name that is no tissue; reported where it was found.
struct UnknownMaterial;

fn material(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    organ: &schema::Organ,
) -> Result<Option<&'static Tissue>, UnknownMaterial> {
    let Some(name) = &organ.material else { return Ok(None) };
    if let Some(found) = tissue(name) {
        return Ok(Some(found));
    }
    let all = tissues().iter().flat_map(|tissue| std::iter::once(&tissue.name).chain(tissue.synonyms));
    let suggestion = nearest_name(name, all.copied());
    let known = tissues().iter().map(|tissue| tissue.name.to_owned()).collect();
    let problem = Problem::UnknownName { kind: "material", found: name.clone(), suggestion, known };
    checks.problem(&table.key("material"), problem);
    Err(UnknownMaterial)
}

fn poissons_ratio(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    written: Option<f64>,
    material: Option<&'static Tissue>,
) -> f64 {
    let key = table.key("poissons_ratio");
    let default = material.map_or(DEFAULT_POISSONS_RATIO, |tissue| tissue.poissons_ratio);
    let Some(ratio) = written else { return default };
    let [low, high] = POISSONS_RATIO;
    if !(low..=high).contains(&ratio) {
        let expected = "0 to 0.49; 0.45 is customary for soft tissue, and what cannot change its volume at all (0.5) has \
                        no stable step";
        checks.out_of_range(&key, number(ratio), expected);
    } else if ratio < DEFAULT_POISSONS_RATIO {
        checks.caution(&key, Caution::SmallStrainOnly { found: number(ratio) });
    }
    ratio
}

fn damping(checks: &mut Checks<'_>, table: &KeyPath, organ: &schema::Organ) -> Option<Damping> {
    match (organ.damping_ratio, organ.viscosity) {
        (Some(_), Some(_)) => {
            let next =
                "keep `damping_ratio` (relative to critical, depends on the pitch) or `viscosity` (Pa s, does not)";
            let problem =
                Problem::Conflict { first: "damping_ratio".into(), second: "viscosity".into(), next: next.to_owned() };
            checks.problem(&table.key("viscosity"), problem);
            None
        }
        (None, Some(viscosity)) => {
            Some(Damping::Viscosity(checks.not_negative(&table.key("viscosity"), viscosity, "Pa s")))
        }
        (ratio, None) => {
            let ratio = ratio.unwrap_or(DEFAULT_DAMPING_RATIO);
            Some(Damping::Ratio(checks.not_negative(&table.key("damping_ratio"), ratio, "")))
        }
    }
}

fn modulus(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    written: Modulus,
    file: &SceneFile,
    folder: &Path,
) -> Option<YoungsModulus> {
    let key = table.key("youngs_modulus");
    match written {
        Modulus::Constant(value) => {
            checks.above_zero(&key, value, "Pa");
            check_usual_modulus(checks, &key, value);
            Some(YoungsModulus::Constant(value))
        }
        Modulus::Varying(VaryingModulus { hu: Some(_), file: Some(_) }) => {
            let next = "take the modulus from the CT number or from a volume of its own".to_owned();
            let problem = Problem::Conflict { first: "hu".into(), second: "file".into(), next };
            checks.problem(&key.key("file"), problem);
            None
        }
        Modulus::Varying(VaryingModulus { hu: None, file: None }) => {
            let expected = "a number of Pa, { hu = [[-100, 2e3], [100, 2e4]] } or { file = \"stiffness.nii.gz\" }";
            checks.out_of_range(&key, "an empty table", expected);
            None
        }
        Modulus::Varying(VaryingModulus { hu: Some(points), file: None }) => {
            hu_map(checks, &key.key("hu"), &points, file).map(YoungsModulus::FromHu)
        }
        Modulus::Varying(VaryingModulus { hu: None, file: Some(path) }) => {
            if path.as_os_str().is_empty() {
                checks.out_of_range(&key.key("file"), "an empty path", "the path of a volume of Young's modulus [Pa]");
            }
            Some(YoungsModulus::FromFile(folder.join(path)))
        }
    }
}

fn hu_map(checks: &mut Checks<'_>, key: &KeyPath, points: &[MapPoint], file: &SceneFile) -> Option<Vec<[f64; 2]>> {
    let before = checks.problems.len();
    let volume = &file.volume;
    // A volume with nothing at all has been reported as such.
    if volume.image.is_none() && volume.phantom.is_none() && volume.labels.is_some() {
        let next = "the modulus is taken from the CT number, so add the CT: image = \"ct.nii.gz\"".to_owned();
        checks.problem(key, Problem::Missing { key: "volume.image".into(), next });
    }
    if points.len() < 2 {
        let found = format!("{} points", points.len());
        let expected = "at least two points [HU, Pa]; for the same modulus everywhere write youngs_modulus = 5e3";
        checks.out_of_range(key, if points.len() == 1 { "1 point".to_owned() } else { found }, expected);
    }
    let mut earlier = None;
    for (index, &MapPoint([hu, modulus])) in points.iter().enumerate() {
        let point = key.index(index);
        if !hu.is_finite() {
            checks.out_of_range(&point.index(0), number(hu), "a finite number of HU");
        } else if let Some(earlier) = earlier.filter(|&earlier| hu <= earlier) {
            let expected =
                format!("more than the {} HU of the point before; give the points by ascending HU", number(earlier));
            checks.out_of_range(&point.index(0), format!("{} HU", number(hu)), expected);
        }
        earlier = Some(hu);
        checks.above_zero(&point.index(1), modulus, "Pa");
        check_usual_modulus(checks, &point.index(1), modulus);
    }
    (checks.problems.len() == before).then(|| points.iter().map(|point| point.0).collect())
}

/// Warns where a number looks like kPa. Softest tissue (fat, brain): some hundred Pa; metal implants reach 1.1e11 Pa
/// (titanium).
fn check_usual_modulus(checks: &mut Checks<'_>, key: &KeyPath, youngs_modulus: f64) {
    if youngs_modulus > 0.0 && !(50.0..=5e11).contains(&youngs_modulus) {
        let (usual, hint) = ("50 to 5e11", "1 kPa is 1e3 Pa");
        let caution = Caution::UnusualValue { found: number(youngs_modulus), unit: "Pa", usual, hint };
        checks.caution(key, caution);
    }
}

/// Warns where a number looks like g/cm3. Inflated lung: 200 kg/m3; cortical bone: 1900 kg/m3; steel: 8000 kg/m3.
fn check_density(checks: &mut Checks<'_>, table: &KeyPath, density: f64) {
    let key = table.key("density");
    checks.above_zero(&key, density, "kg/m3");
    if density > 0.0 && !(50.0..=25_000.0).contains(&density) {
        let (usual, hint) = ("50 to 25000", "1 g/cm3 is 1000 kg/m3");
        checks.caution(&key, Caution::UnusualValue { found: number(density), unit: "kg/m3", usual, hint });
    }
}
