//! `yawara info`: what a file or a run holds.

use std::path::Path;

use serde_json::{Value, json};

use super::args::InfoArguments;
use super::examine::{Examined, examine};
use super::exit::Outcome;
use super::facts::{digits, text, write_columns};
use super::mesh::open;
use super::messages::{Messages, out};
use super::scene_facts;
use super::source::{Source, label_map};
use crate::io::mesh_format::MeshFormat;
use crate::io::nifti::{VolumeInfo, read_ct, read_info};
use crate::material::ct_density::{DensityMap, density_maps};
use crate::material::library::{Tissue, tissues};

pub(super) fn info(arguments: &InfoArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    // Without a path, clap has seen to it that materials are asked for.
    let Some(path) = &arguments.path else {
        out(&if arguments.json { materials_json().to_string() } else { materials_text() })?;
        return Ok(Outcome::Done);
    };
    let facts = match Source::of(path)? {
        Source::Run => of_run(path, messages)?,
        Source::Scene => scene_facts::facts(path, messages)?,
        Source::Mesh(format) => of_mesh(path, format)?,
        Source::Volume => of_volume(path)?,
    };
    out(&match facts["kind"].as_str() {
        _ if arguments.json => facts.to_string(),
        Some("scene") => scene_facts::text(&facts),
        _ => text(&facts),
    })?;
    Ok(Outcome::Done)
}

fn materials_json() -> Value {
    let materials: Vec<Value> = tissues()
        .iter()
        .map(|tissue| {
            json!({
                "name": tissue.name,
                "synonyms": tissue.synonyms,
                "youngs_modulus_pa": tissue.youngs_modulus,
                "youngs_modulus_range_pa": tissue.youngs_modulus_range,
                "poissons_ratio": tissue.poissons_ratio,
                "density_kg_per_m3": tissue.density,
                "note": tissue.note,
                "sources": tissue.sources,
            })
        })
        .collect();
    let maps: Vec<Value> = density_maps()
        .iter()
        .map(|DensityMap { name, points, note, source }| {
            json!({ "name": name, "points_hu_kg_per_m3": points, "note": note, "source": source })
        })
        .collect();
    json!({ "kind": "materials", "materials": materials, "density_maps": maps })
}

/// A table of the constants, then each tissue with its note and sources. Works cited by several tissues stand in a list of
/// their own and are referred to by number. Published maps from CT numbers to density come between.
fn materials_text() -> String {
    let mut rows = vec![["name", "E [Pa]", "from", "to", "nu", "density [kg/m^3]", "also"].map(str::to_owned).to_vec()];
    let mut cited: Vec<&str> = Vec::new();
    let mut notes = Vec::new();
    for tissue in tissues() {
        let Tissue {
            name,
            synonyms,
            youngs_modulus,
            youngs_modulus_range: [low, high],
            poissons_ratio,
            density,
            note,
            ..
        } = tissue;
        let mut row = vec![(*name).to_owned()];
        row.extend([*youngs_modulus, *low, *high, *poissons_ratio, *density].map(|value| digits(value, 3)));
        row.push(synonyms.join(", "));
        rows.push(row);
        let numbers: Vec<String> = tissue
            .sources
            .iter()
            .map(|source| {
                let place = cited.iter().position(|known| known == source).unwrap_or_else(|| {
                    cited.push(source);
                    cited.len() - 1
                });
                format!("[{}]", place + 1)
            })
            .collect();
        notes.push(vec![(*name).to_owned(), format!("{note} {}", numbers.join(" "))]);
    }
    let mut lines = Vec::new();
    write_columns(rows, "", &mut lines);
    lines.push("\nE: Young's modulus, the value taken and the range of the sources; nu: Poisson's ratio.\n".to_owned());
    write_columns(notes, "", &mut lines);
    lines.push(
        "\nDensity from CT numbers, as density = { hu = \"NAME\" }: HU to kg/m^3, straight between.\n".to_owned(),
    );
    let mut maps = Vec::new();
    for DensityMap { name, points, note, source } in density_maps() {
        cited.push(source);
        let points: Vec<String> = points.iter().map(|[hu, density]| format!("{hu}: {}", digits(*density, 4))).collect();
        maps.push(vec![(*name).to_owned(), format!("{}. {note} [{}]", points.join(", "), cited.len())]);
    }
    write_columns(maps, "", &mut lines);
    lines.push("\nSources".to_owned());
    let sources =
        cited.iter().enumerate().map(|(place, source)| vec![format!("[{}]", place + 1), (*source).to_owned()]);
    write_columns(sources.collect(), "", &mut lines);
    lines.join("\n")
}

fn of_run(path: &Path, messages: &Messages) -> anyhow::Result<Value> {
    let reader = open(path, messages)?;
    let mut facts = json!({ "kind": "run", "manifest": reader.manifest() });
    facts["series"] = json!(reader.series_names());
    if let Some(last) = reader.frames().checked_sub(1) {
        facts["last_time_s"] = json!(reader.times()[last]);
        facts["severed_springs"] = json!(reader.severed(last)?.len());
    }
    Ok(facts)
}

fn of_mesh(path: &Path, format: MeshFormat) -> anyhow::Result<Value> {
    let meshes: Vec<Value> = format
        .read(path)?
        .iter()
        .map(|organ| {
            let Examined { report, merged } = examine(&organ.mesh);
            json!({
                "name": organ.name,
                "vertices": report.vertices,
                "triangles": report.triangles,
                "components": report.components.len(),
                "closed": report.is_closed(),
                "merged": merged,
                "area_mm2": report.area_mm2,
                "volume_ml": report.volume_ml(),
                "bounds_ras_mm": report.bounds,
            })
        })
        .collect();
    Ok(json!({ "kind": "mesh", "format": format.to_string(), "meshes": meshes }))
}

fn of_volume(path: &Path) -> anyhow::Result<Value> {
    let header = read_info(path)?;
    let mut facts = of_header(&header);
    if let Some(map) = label_map(path, &header)? {
        let voxel_ml = header.affine().determinant().abs() * 1e-3;
        facts["labels"] = map
            .label_summaries()
            .iter()
            .filter(|summary| summary.label != 0)
            .map(|summary| {
                json!({
                    "label": summary.label,
                    "voxels": summary.voxels,
                    "volume_ml": summary.voxels as f64 * voxel_ml,
                    "touches_border": summary.touches_border(),
                })
            })
            .collect();
    } else {
        let (image, info) = read_ct(path)?;
        let statistics = image.statistics();
        facts["min_hu"] = json!(statistics.min);
        facts["max_hu"] = json!(statistics.max);
        facts["mean_hu"] = json!(statistics.mean());
        facts["replaced_voxels"] = json!(info.replaced_voxels);
    }
    Ok(facts)
}

fn of_header(header: &VolumeInfo) -> Value {
    let matrix = header.affine().matrix();
    let rows: Vec<Vec<f64>> = (0..4).map(|row| matrix.row(row).iter().copied().collect()).collect();
    json!({
        "kind": "volume",
        "format": header.version.to_string(),
        "shape": header.shape().dims(),
        "spacing_mm": header.spacing(),
        "axes": header.axis_codes(),
        "affine_from": header.affine_source.to_string(),
        "affine_ras_mm": rows,
        "datatype": header.datatype.to_string(),
        "byte_order": header.byte_order.to_string(),
        "gzip": header.gzip,
        "slope_and_intercept": header.scaling.map(|scaling| [scaling.slope, scaling.intercept]),
    })
}
