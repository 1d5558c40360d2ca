//! What an organ is made of: a material by name, its numbers, or the constants of the paper.

use std::path::Path;

use super::checks::Checks;
use super::diagnostics::KeyPath;
use super::inelastic;
use super::problem::{Caution, Problem, nearest_name, number};
use super::resolved::{Body, Damping, Fibres, Model, Property};
use super::schema::{self, SceneFile};
use super::written_property::{Written, resolve};
use crate::geometry::Vector3;
use crate::material::library::{Tissue, tissue, tissues};

const DEFAULT_DAMPING_RATIO: f64 = 0.1;
/// What springs alone have, so the one value without a volume term.
const DEFAULT_POISSONS_RATIO: f64 = 0.25;
/// Fibres that go slack and taut in turn hand energy to undamped motion: 2e-4 of it in a step in the tests, of which so much
/// damping takes ten times more.
const LEAST_DAMPING_OF_FIBRES: f64 = 1e-3;
/// Nearer to 1/2 an explicit step is not worth its price, and the cells lock.
const POISSONS_RATIO: [f64; 2] = [0.0, 0.49];
const PAPER_KEYS: &str = "stiffness (N/m), damping (N s/m) and mass (kg), relaxation, plasticity and tear_strain";
const TISSUE_KEYS: &str = "youngs_modulus (Pa), density (kg/m3), poissons_ratio and damping_ratio or viscosity (Pa s), \
                           fibres, relaxation, plasticity and tear_strain, or a material by name";

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
        ("fibres", organ.fibres.is_some()),
    ];
    let shared = [("material", organ.material.is_some()), ("density", organ.density.is_some())];
    if organ.rigid {
        for (key, _) in
            paper.into_iter().chain(deformable).chain(inelastic::keys(organ)).filter(|(_, written)| *written)
        {
            let next = "a rigid organ does not deform, so of a material it takes the density only; keep one of the two";
            let problem = Problem::Conflict { first: "rigid".into(), second: key.into(), next: next.to_owned() };
            checks.problem(&table.key(key), problem);
        }
        return rigid(checks, table, organ, file, folder);
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

/// Checks and resolves an organ's fibres; `None` when a problem was found. What has no place for any says so in [`body`].
pub(super) fn fibres(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    organ: &schema::Organ,
    model: Model,
) -> Option<Option<Fibres>> {
    let Some(written) = organ.fibres.as_ref().filter(|_| !organ.rigid && model == Model::Tissue) else {
        return Some(None);
    };
    let table = table.key("fibres");
    let before = checks.problems.len();
    let key = table.key("direction");
    let direction = Vector3::from(checks.triple(&key, written.direction, "any unit"));
    if direction == Vector3::zeros() {
        let found = "the direction is [0, 0, 0]".to_owned();
        checks
            .problem(&key, Problem::Degenerate { found, expected: "a vector with a length, such as [0, 0, 1]".into() });
    }
    let modulus = checks.above_zero(&table.key("modulus"), written.modulus, "Pa");
    let undamped = match (organ.damping_ratio, organ.viscosity) {
        (Some(ratio), None) => ratio < LEAST_DAMPING_OF_FIBRES,
        (None, Some(viscosity)) => viscosity == 0.0,
        _ => false,
    };
    if undamped {
        checks.caution(&table, Caution::UndampedFibres);
    }
    // By its largest part first: squares of tiny or huge ones are no numbers.
    let direction = (direction / direction.amax()).normalize();
    (checks.problems.len() == before).then_some(Some(Fibres { direction, modulus }))
}

fn rigid(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    organ: &schema::Organ,
    file: &SceneFile,
    folder: &Path,
) -> Option<Body> {
    let material = material(checks, table, organ).ok()?;
    let density = match &organ.density {
        Some(written) => Some(resolve(checks, table, written, &file.volume, folder)?),
        None => material.map(|tissue| Property::Constant(tissue.density)),
    };
    Some(Body::Rigid { density })
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
    let written = organ.youngs_modulus.clone().or(material.map(|tissue| Written::Constant(tissue.youngs_modulus)));
    let example = "5e3 (Pa), or take one by name: material = \"liver\"";
    let written = needed(checks, table, "youngs_modulus", written, Model::Tissue, example);
    let density = organ.density.clone().or(material.map(|tissue| Written::Constant(tissue.density)));
    let density = needed(checks, table, "density", density, Model::Tissue, "1060 (kg/m3)");
    let youngs_modulus = written.and_then(|written| resolve(checks, table, &written, &file.volume, folder));
    let density = density.and_then(|written| resolve(checks, table, &written, &file.volume, folder));
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
