//! Organs: which voxels each takes, and its colour; what each is made of stands in [`super::bodies`].

use std::collections::BTreeMap;
use std::path::Path;

use super::bodies::{body, fibres};
use super::checks::Checks;
use super::color;
use super::diagnostics::KeyPath;
use super::inelastic::inelastic;
use super::look::look;
use super::problem::{Caution, Problem, nearest_name, number};
use super::resolve::LabelLookup;
use super::resolved::{Model, Organ, VoxelSelection};
use super::schema::{self, SceneFile};
use super::values::{Label, LabelList, Pair};
use crate::lattice::FRINGE;

/// Most organs of a scene: a particle keeps its organ in a byte, whose last value marks the fringe.
const MAX_ORGANS: usize = FRINGE as usize;

/// Checks and resolves every organ; `None` when a problem was found.
pub(super) fn organs(
    checks: &mut Checks<'_>,
    file: &SceneFile,
    model: Model,
    folder: &Path,
    label_names: &dyn LabelLookup,
) -> Option<Vec<Organ>> {
    let list = KeyPath::top("organ");
    if file.organ.is_empty() || file.organ.len() > MAX_ORGANS {
        checks.out_of_range(&list, format!("{} organs", file.organ.len()), format!("1 to {MAX_ORGANS}"));
        return None;
    }
    check_names(checks, &file.organ);
    let labels = labels(checks, file, folder, label_names);
    check_hu_overlaps(checks, &file.organ);
    let mut resolved = Vec::new();
    for (index, (organ, labels)) in file.organ.iter().zip(labels).enumerate() {
        let table = list.index(index);
        let body = body(checks, &table, organ, file, model, folder);
        let fibres = fibres(checks, &table, organ, model);
        let inelastic = inelastic(checks, &table, organ);
        let voxels = voxels(checks, &table, organ, labels, file);
        let color = match &organ.color {
            None => Some(color::default_for(&organ.name, index)),
            Some(text) => parse_color(checks, &table.key("color"), text),
        };
        let look = look(checks, &table.key("look"), organ.look.as_ref(), &file.volume);
        if let (Some(body), Some(fibres), Some(inelastic), Some(voxels), Some(color), Some(look)) =
            (body, fibres, inelastic, voxels, color, look)
        {
            resolved.push(Organ { name: organ.name.clone(), voxels, body, fibres, inelastic, color, look });
        }
    }
    (resolved.len() == file.organ.len()).then_some(resolved)
}

/// A colour as written; reported when it is none.
pub(super) fn parse_color(checks: &mut Checks<'_>, key: &KeyPath, text: &str) -> Option<[f32; 3]> {
    let color = color::parse(text);
    if color.is_none() {
        let expected = "an sRGB colour of six hexadecimal digits, such as \"#8c3b2e\"";
        checks.out_of_range(key, format!("\"{text}\""), expected);
    }
    color
}

fn check_names(checks: &mut Checks<'_>, organs: &[schema::Organ]) {
    for (index, organ) in organs.iter().enumerate() {
        let key = KeyPath::top("organ").index(index).key("name");
        if organ.name.trim().is_empty() {
            checks.out_of_range(&key, "an empty name", "a name such as \"liver\"");
        } else if let Some(first) = organs[..index].iter().position(|earlier| earlier.name == organ.name) {
            let first = KeyPath::top("organ").index(first).to_string();
            checks.problem(&key, Problem::DuplicateName { kind: "organ", name: organ.name.clone(), first });
        }
    }
}

/// The labels of each organ as numbers, ascending; `None` for organs without `label`.
fn labels(
    checks: &mut Checks<'_>,
    file: &SceneFile,
    folder: &Path,
    label_names: &dyn LabelLookup,
) -> Vec<Option<Vec<u16>>> {
    let by_name = file.organ.iter().any(|organ| written_labels(organ).iter().any(|l| matches!(l, Label::Name(_))));
    let names = if by_name { names(checks, file, folder, label_names) } else { BTreeMap::new() };
    let mut taken: BTreeMap<u16, KeyPath> = BTreeMap::new();
    let mut resolved = Vec::new();
    for (index, organ) in file.organ.iter().enumerate() {
        let key = KeyPath::top("organ").index(index).key("label");
        let Some(list) = &organ.label else {
            resolved.push(None);
            continue;
        };
        let mut ids = Vec::new();
        for (position, label) in written_labels(organ).iter().enumerate() {
            let key = if matches!(list, LabelList::Many(_)) { key.index(position) } else { key.clone() };
            let id = match label {
                Label::Id(id) => *id,
                Label::Name(name) => match id_of(&names, name) {
                    Some(id) => id,
                    None => {
                        // Without any names the missing file has already been reported.
                        if !names.is_empty() {
                            unknown_label(checks, &key, name, &names);
                        }
                        continue;
                    }
                },
            };
            let shown = match label {
                Label::Id(id) => id.to_string(),
                Label::Name(name) => format!("{id} (\"{name}\")"),
            };
            if id == 0 {
                checks.out_of_range(&key, shown, "a label from 1 to 65535; 0 is background");
            } else if let Some(first) = taken.get(&id) {
                let first = first.to_string();
                checks.problem(&key, Problem::DuplicateLabel { label: shown, first });
            } else {
                taken.insert(id, key);
                ids.push(id);
            }
        }
        if matches!(list, LabelList::Many(list) if list.is_empty()) {
            checks.out_of_range(&key, "an empty list", "at least one label");
        }
        ids.sort_unstable();
        resolved.push(Some(ids));
    }
    resolved
}

fn written_labels(organ: &schema::Organ) -> &[Label] {
    match &organ.label {
        None => &[],
        Some(LabelList::One(label)) => std::slice::from_ref(label),
        Some(LabelList::Many(list)) => list,
    }
}

/// Reads the label names the scene refers to; empty after a problem.
fn names(
    checks: &mut Checks<'_>,
    file: &SceneFile,
    folder: &Path,
    label_names: &dyn LabelLookup,
) -> BTreeMap<String, u16> {
    if let Some(kind) = file.volume.phantom {
        return label_names.of_phantom(kind);
    }
    let table = KeyPath::top("volume");
    let Some(path) = &file.volume.label_names else {
        let next = "labels are given by name, so say where the names are, such as label_names = \"labels.tsv\" (lines \
                    of id <tab> name), or give labels by number";
        checks.missing(&table, "label_names", next);
        return BTreeMap::new();
    };
    let message = match label_names.in_file(&folder.join(path)) {
        Ok(names) if names.is_empty() => format!("{} has no names in it", path.display()),
        Ok(names) => return names,
        Err(error) => error.to_string(),
    };
    checks.problem(&table.key("label_names"), Problem::LabelNames { message });
    BTreeMap::new()
}

/// The label of a name as written, else of the same name in other letter case.
fn id_of(names: &BTreeMap<String, u16>, name: &str) -> Option<u16> {
    let in_other_case = || names.iter().find(|(known, _)| known.to_lowercase() == name.to_lowercase());
    names.get(name).copied().or_else(|| in_other_case().map(|(_, &id)| id))
}

fn unknown_label(checks: &mut Checks<'_>, key: &KeyPath, name: &str, names: &BTreeMap<String, u16>) {
    let suggestion = nearest_name(name, names.keys().map(String::as_str));
    let known = names.keys().cloned().collect();
    checks.problem(key, Problem::UnknownName { kind: "label", found: name.to_owned(), suggestion, known });
}

fn voxels(
    checks: &mut Checks<'_>,
    table: &KeyPath,
    organ: &schema::Organ,
    labels: Option<Vec<u16>>,
    file: &SceneFile,
) -> Option<VoxelSelection> {
    // A volume with nothing at all has been reported as such.
    let volume = &file.volume;
    match (labels, organ.hu) {
        (Some(_), Some(_)) => {
            let next = "choose the organ's voxels by one of the two".to_owned();
            checks.problem(&table.key("hu"), Problem::Conflict { first: "label".into(), second: "hu".into(), next });
            None
        }
        (None, None) => {
            checks.missing(table, "label", "choose voxels by label = 5, label = \"liver\" or hu = [0, 120] (HU)");
            None
        }
        (Some(ids), None) => {
            if volume.labels.is_none() && volume.phantom.is_none() && volume.image.is_some() {
                let next =
                    "an organ is chosen by label, so add the label map: labels = \"segmentation.nii.gz\"".to_owned();
                checks.problem(&table.key("label"), Problem::Missing { key: "volume.labels".into(), next });
            }
            Some(VoxelSelection::Labels(ids))
        }
        (None, Some(Pair([min, max]))) => {
            let key = table.key("hu");
            if volume.image.is_none() && volume.phantom.is_none() && volume.labels.is_some() {
                let next = "an organ is chosen by HU, so add the CT: image = \"ct.nii.gz\"".to_owned();
                checks.problem(&key, Problem::Missing { key: "volume.image".into(), next });
            }
            // Also refuses NaN, and what would be infinite in the 32 bits of a CT number.
            if !(min <= max && (min as f32).is_finite() && (max as f32).is_finite()) {
                let found = format!("[{}, {}]", number(min), number(max));
                checks.out_of_range(&key, found, "two finite numbers of HU, the smaller first");
            }
            Some(VoxelSelection::Hu { min: min as f32, max: max as f32 })
        }
    }
}

fn check_hu_overlaps(checks: &mut Checks<'_>, organs: &[schema::Organ]) {
    for (index, organ) in organs.iter().enumerate() {
        let Some(Pair([min, max])) = organ.hu else { continue };
        let overlaps = |earlier: &schema::Organ| earlier.hu.is_some_and(|Pair([low, high])| low <= max && min <= high);
        if let Some(first) = organs[..index].iter().find(|earlier| overlaps(earlier)) {
            let first = format!("organ \"{}\"", first.name);
            let caution = Caution::OverlappingHu { min: number(min), max: number(max), first };
            checks.caution(&KeyPath::top("organ").index(index).key("hu"), caution);
        }
    }
}
