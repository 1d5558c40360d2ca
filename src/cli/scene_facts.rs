//! What a scene amounts to, before it is run: size, material, step, effects, time.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};

use super::accuracy::percent;
use super::facts::{digits, write_columns};
use super::messages::Messages;
use crate::dynamics::World;
use crate::dynamics::effects::sleep::Sleep;
use crate::dynamics::integrator::Integrator;
use crate::dynamics::measure::cell_volume;
use crate::dynamics::stable_dt::SAFETY;
use crate::dynamics::timeline::Timeline;
use crate::geometry::Vector3;
use crate::lattice::Topology;
use crate::material::elastic::Bulk;
use crate::material::{Assembly, SpringConstants};
use crate::run::estimate::Pace;
use crate::run::inputs;
use crate::run::label_lookup::Files;
use crate::run::prepare::{Prepared, Spread, Spreads, prepare};
use crate::run::thin_tools::thin_tools;
use crate::scene::resolved::{Action, Body, Operation, Organ, Scene};

/// The world is stepped for about this long to find its pace.
const BUDGET: Duration = Duration::from_millis(300);
/// A material whose Zener ratio is this close to 1 is called isotropic: constants are f32.
const ISOTROPIC: f64 = 1e-4;
/// Directions that tell a lattice's anisotropy: edges, face diagonals and body diagonals of its voxels.
const DIRECTIONS: [[i32; 3]; 3] = [[1, 0, 0], [1, 1, 0], [1, 1, 1]];

/// Properties that may differ from cell to cell: key, noun, unit.
const SPREADS: [(&str, &str, &str); 2] =
    [("youngs_modulus_pa", "modulus", "Pa"), ("density_kg_per_m3", "density", "kg/m^3")];

/// The facts of a scene; every key ends in its unit.
pub(super) fn facts(path: &Path, messages: &Messages) -> anyhow::Result<Value> {
    let (scene, warnings) = crate::scene::load(path, &Files)?;
    warnings.iter().for_each(|warning| messages.warning(warning));
    let inputs = inputs::load(&scene)?;
    let hu_points = inputs.image.is_some();
    let prepared = prepare(&scene, &inputs)?;
    let mut timeline = Timeline::with_tools(&scene.operations, &prepared.lattice, &inputs.tools)?;
    drop(inputs);
    thin_tools(&scene, prepared.lattice.pitch).iter().for_each(|warning| messages.warning(warning));
    let schedule = prepared.schedule;
    let lattice = &prepared.lattice;
    let particles = lattice.len();
    let cells = cell_volume(lattice, &Topology::new(lattice), |_| Vector3::zeros()).cells;
    let organs: Vec<Value> =
        (0..).zip(&scene.organs).map(|(number, organ)| of_organ(number, organ, &prepared)).collect();
    let effects = effects(&scene, &prepared.assembly, lattice.spring_count());
    // Each frame 3 f32 per particle; once: points, ijk, rest, organ and springs of each, and the CT at every grid point.
    let frame_bytes = 12 * particles + 24;
    let rest_bytes = particles * (4 + 12 + 12 + 1 + 4) + if hu_points { 4 * lattice.grid.shape.len() } else { 0 };
    let disk_bytes = (schedule.frames + 1) as f64 * frame_bytes as f64 + rest_bytes as f64;
    let mut facts = json!({
        "kind": "scene",
        "scene": path.display().to_string(),
        "model": scene.lattice.model,
        "pitch_mm": lattice.pitch * 1e3,
        "particles": particles,
        "springs": lattice.spring_count(),
        "cells": cells,
        "organs": organs,
        "operations": scene.operations.len(),
        "effects": effects,
        "obstacles": obstacles(&scene),
        "duration_s": schedule.dt * schedule.steps as f64,
        "stable_dt_s": schedule.stable_dt.is_finite().then_some(schedule.stable_dt),
        "stable_dt_is": schedule.limit_in_words(),
        "dt_s": schedule.dt,
        "accuracy_asked": scene.accuracy,
        "dt_is_from": if scene.time.dt.is_some() { "scene" } else { "stable_dt" },
        "integrator": {
            "method": scene.time.integrator,
            "cost": scene.time.integrator.cost_in_words(),
            "tolerance_mm": scene.time.integrator.has_tolerance()
                .then(|| 1e3 * scene.time.tolerance.unwrap_or(Integrator::TOLERANCE)),
        },
        "steps": schedule.steps,
        "frames": schedule.frames,
        "frame_mb": frame_bytes as f64 * 1e-6,
        "disk_mb_at_most": disk_bytes * 1e-6,
        "threads": rayon::current_num_threads(),
    });
    let mut world = prepared.into_world(&scene);
    let bytes = world.bytes_per_particle();
    facts["bytes_per_particle"] = json!(bytes);
    facts["memory_mb"] = json!(bytes * particles as f64 * 1e-6);
    let arithmetic = world.arithmetic();
    facts["loop"] = json!({
        "constants": match world.assembly().stiffness {
            SpringConstants::Uniform(_) => "the same for all springs",
            SpringConstants::MeanOfEnds(_) => "means of two ends",
            SpringConstants::SumOfCells { .. } => "sums over cells",
        },
        "exact": arithmetic.exact(),
        "instruction_set": arithmetic.set().name(),
        "share_of_blocks_alike": world.alike_share(),
    });
    let measured = Pace::measure(&mut world, &mut timeline, &schedule, BUDGET);
    facts["self_contact"] = self_contact(&scene, &world);
    facts["sleep"] = world.sleep().map_or(Value::Null, |(Sleep { tolerance, window }, counts)| {
        json!({ "tolerance_mm": tolerance * 1e3, "window_s": window, "blocks": counts.blocks })
    });
    match measured {
        Ok(pace) => {
            facts["estimated_time_s"] = json!(pace.of(&schedule));
            facts["estimated_step_s"] = json!(pace.step);
            facts["estimated_particle_steps_per_s"] = json!(particles as f64 / pace.step);
            facts["estimated_frame_s"] = json!(pace.frame);
            facts["estimated_from_steps"] = json!(pace.timed_steps);
        }
        Err(error) => {
            messages.warning(format_args!("no time can be estimated: {error}"));
            facts["estimated_time_s"] = Value::Null;
        }
    }
    Ok(facts)
}

/// What acts on the particles.
fn effects(scene: &Scene, assembly: &Assembly, springs: usize) -> Value {
    let mut kinds = BTreeMap::<String, usize>::new();
    for operation in &scene.operations {
        // The action's name as scenes in JSON have it, so that none is forgotten here.
        if let Ok(Value::Object(action)) = serde_json::to_value(&operation.action) {
            action.keys().for_each(|kind| *kinds.entry(kind.clone()).or_default() += 1);
        }
    }
    let count = |does: fn(&Organ) -> bool| scene.organs.iter().filter(|organ| does(organ)).count();
    json!({
        "springs": springs,
        "dampers": assembly.damping.is_some(),
        "volume_term": assembly.volume.is_some(),
        "fibrous_organs": count(|organ| organ.fibres.is_some()),
        "relaxing_organs": count(|organ| organ.inelastic.relaxation.is_some()),
        "yielding_organs": count(|organ| organ.inelastic.plasticity.is_some()),
        "tearing_organs": count(|organ| organ.inelastic.tear_strain.is_some()),
        "gravity_m_per_s2": scene.gravity,
        "drag_per_s": scene.drag,
        "rigid_organs": count(|organ| matches!(organ.body, Body::Rigid { .. })),
        "operations": kinds,
    })
}

/// What soft tissue cannot enter, as the resolved scene has it.
fn obstacles(scene: &Scene) -> Vec<Value> {
    let obstacles = scene.operations.iter().filter(|operation| operation.action.is_obstacle());
    obstacles
        .map(|Operation { name, from, until, action }| {
            let until = until.is_finite().then_some(until);
            json!({ "name": name, "from_s": from, "until_s": until, "is": action })
        })
        .collect()
}

/// What soft tissue does with itself, as the resolved scene has it; null where it may pass through itself.
fn self_contact(scene: &Scene, world: &World) -> Value {
    let found = scene.operations.iter().find_map(|operation| match &operation.action {
        Action::SelfContact { organs, friction } => Some((organs, friction)),
        _ => None,
    });
    found.map_or(Value::Null, |(organs, friction)| {
        json!({
            "organs": organs.iter().map(|&organ| scene.organs[organ].name.as_str()).collect::<Vec<_>>(),
            "friction": friction,
            "surface_particles": world.self_contact().map(|facts| facts.surface_particles),
        })
    })
}

/// The same in a line.
fn self_contact_text(contact: &Value) -> String {
    let organs: Vec<&str> = contact["organs"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let friction = contact["friction"].as_f64().filter(|&friction| friction > 0.0);
    let friction =
        friction.map_or_else(|| "no friction".to_owned(), |friction| format!("friction {}", digits(friction, 4)));
    let surface = contact["surface_particles"].as_u64().unwrap_or(0);
    format!("{}: {surface} particles on their surfaces, {friction}", organs.join(", "))
}

/// When blocks sleep, in a line.
fn sleep_text(sleep: &Value) -> String {
    let number = |key: &str| digits(sleep[key].as_f64().unwrap_or(f64::NAN), 3);
    format!(
        "each of {} blocks that moves by less than {} mm in {} s is left out of the step until something reaches it",
        sleep["blocks"],
        number("tolerance_mm"),
        number("window_s")
    )
}

/// An obstacle in a line: its name, what it is, when, and friction.
fn obstacle_text(obstacle: &Value) -> String {
    let name = obstacle["name"].as_str().unwrap_or_default();
    let mm = |place: &Value| {
        let parts = place.as_array().into_iter().flatten().filter_map(Value::as_f64);
        format!("({})", parts.map(|part| digits(part, 4)).collect::<Vec<_>>().join(", "))
    };
    let long = |length: &Value| digits(length.as_f64().unwrap_or(f64::NAN), 4);
    let is = &obstacle["is"];
    let (what, action) = if let Some(tool) = is["tool"].as_object() {
        let shape = &tool["shape"];
        let [sphere, capsule, block, mesh] = ["sphere", "capsule", "box", "mesh"].map(|kind| &shape[kind]);
        let mut text = if !sphere.is_null() {
            format!("sphere of radius {} mm at {} mm", long(&sphere["radius_mm"]), mm(&sphere["center_mm"]))
        } else if !capsule.is_null() {
            let [from, to] = ["from_mm", "to_mm"].map(|end| mm(&capsule[end]));
            format!("capsule of radius {} mm from {from} to {to} mm", long(&capsule["radius_mm"]))
        } else if !block.is_null() {
            format!("box from {} to {} mm", mm(&block["min_mm"]), mm(&block["max_mm"]))
        } else {
            format!("mesh {}", mesh["file"].as_str().unwrap_or_default())
        };
        let path = tool["path_mm"].as_array().map_or(&[][..], Vec::as_slice);
        match path {
            [] | [_] => text += ", stands still",
            [.., last] => text += &format!(", moves by {} mm until {} s", mm(last), long(&tool["arrive_s"])),
        }
        (text, &is["tool"])
    } else if let Some(plane) = is["plane"].as_object() {
        (format!("plane through {} mm, tissue towards {}", mm(&plane["point_mm"]), mm(&plane["normal"])), &is["plane"])
    } else {
        ("rigid organs that stay where they are".to_owned(), &is["bone"])
    };
    let from =
        obstacle["from_s"].as_f64().filter(|&from| from > 0.0).map(|from| format!(", from {} s", digits(from, 4)));
    let until = obstacle["until_s"].as_f64().map(|until| format!(", until {} s", digits(until, 4)));
    let friction = action["friction"].as_f64().unwrap_or(0.0);
    let friction = if friction > 0.0 { format!("friction {}", digits(friction, 4)) } else { "no friction".to_owned() };
    format!("{name}: {what}{}{}, {friction}", from.unwrap_or_default(), until.unwrap_or_default())
}

fn of_organ(number: u8, organ: &Organ, prepared: &Prepared) -> Value {
    let Prepared { lattice, assembly, spreads, .. } = prepared;
    let particles = lattice.organ.iter().filter(|&&o| o == number).count();
    let Spreads { youngs_modulus, density } = spreads[usize::from(number)];
    let mut facts = json!({
        "name": organ.name,
        "particles": particles,
        "body": organ.body,
        "fibres": organ.fibres,
        "inelastic": organ.inelastic,
        "solid": Value::Null,
        "spread": { "youngs_modulus_pa": of_spread(youngs_modulus), "density_kg_per_m3": of_spread(density) },
    });
    // Springs inside a rigid body do nothing, so they make no solid.
    if let Some(bulk) = Bulk::of_organ(lattice, assembly, number)
        && !matches!(organ.body, Body::Rigid { .. })
    {
        facts["solid"] = of_bulk(&bulk);
    }
    facts
}

/// A property that differs from cell to cell; null for one that does not.
fn of_spread(spread: Option<Spread>) -> Value {
    spread.map_or(Value::Null, |Spread { least, most, mean }| json!({ "least": least, "most": most, "mean": mean }))
}

/// The assembled material, read back from springs, volume term and mass.
fn of_bulk(bulk: &Bulk) -> Value {
    let Bulk { stiffness, viscosity, density } = bulk;
    let edge = Vector3::x();
    let [shear_on_faces, shear_on_diagonals] = stiffness.shear_moduli();
    let directions: Vec<Value> = DIRECTIONS
        .iter()
        .map(|along| {
            let direction = Vector3::from(along.map(f64::from));
            json!({
                "along": along,
                "youngs_modulus_pa": stiffness.youngs_modulus(&direction),
                "poissons_ratios": stiffness.poissons_ratios(&direction),
                "wave_speeds_m_per_s": stiffness.wave_speeds(*density, &direction),
            })
        })
        .collect();
    let [pressure, shear, _] = stiffness.wave_speeds(*density, &edge);
    json!({
        "density_kg_per_m3": density,
        "isotropic": (stiffness.anisotropy() - 1.0).abs() < ISOTROPIC,
        "youngs_modulus_pa": stiffness.youngs_modulus(&edge),
        "poissons_ratio": stiffness.poissons_ratios(&edge)[0],
        "viscosity_pa_s": viscosity.map_or(0.0, |viscosity| viscosity.youngs_modulus(&edge)),
        "c_p_m_per_s": pressure,
        "c_s_m_per_s": shear,
        "bulk_modulus_pa": stiffness.bulk_modulus(),
        "shear_moduli_pa": [shear_on_faces, shear_on_diagonals],
        "anisotropy": stiffness.anisotropy(),
        "c11_pa": stiffness.c11,
        "c12_pa": stiffness.c12,
        "c44_pa": stiffness.c44,
        "directions": directions,
    })
}

/// The facts for people.
pub(super) fn text(facts: &Value) -> String {
    let number = |key: &str| facts[key].as_f64().unwrap_or(f64::NAN);
    let short = |key: &str| digits(number(key), 4);
    let count = |key: &str| facts[key].as_u64().unwrap_or(0);
    let plain = |key: &str| facts[key].as_str().unwrap_or_default().to_owned();
    let step = match facts["stable_dt_s"].as_f64() {
        None if plain("dt_is_from") == "scene" => format!("{} s: as the scene asks; nothing limits it", short("dt_s")),
        None => format!("{} s: nothing limits it", short("dt_s")),
        Some(bound) if plain("dt_is_from") == "scene" => {
            format!("{} s: as the scene asks; {:.2} of the stable bound", short("dt_s"), number("dt_s") / bound)
        }
        Some(_) => {
            format!("{} s: chosen; at most {SAFETY} of the stable bound, and whole steps between frames", short("dt_s"))
        }
    };
    let bound = match facts["stable_dt_s"].as_f64() {
        None => plain("stable_dt_is"),
        Some(bound) => format!("{} s, {}", digits(bound, 4), plain("stable_dt_is")),
    };
    let estimate = match facts["estimated_time_s"].as_f64() {
        None => "none: the state diverges within the first steps".to_owned(),
        Some(seconds) => format!(
            "{} with {} threads, an estimate: {} ms a step over the first {}, {} ms a frame, disk not counted",
            duration(seconds),
            count("threads"),
            digits(1e3 * number("estimated_step_s"), 3),
            count("estimated_from_steps"),
            digits(1e3 * number("estimated_frame_s"), 3),
        ),
    };
    let rows = [
        ("scene", plain("scene")),
        ("lattice", format!("model {}, pitch {} mm", plain("model"), short("pitch_mm"))),
        ("size", format!("{} particles, {} springs, {} cells", count("particles"), count("springs"), count("cells"))),
        (
            "memory",
            format!("{} MB while stepping, {} bytes per particle", short("memory_mb"), short("bytes_per_particle")),
        ),
        (
            "disk",
            format!(
                "at most {} MB: {} frames of {} MB and the lattice, before compression",
                short("disk_mb_at_most"),
                count("frames") + 1,
                short("frame_mb")
            ),
        ),
        ("simulated", format!("{} s in {} steps, {} frames", short("duration_s"), count("steps"), count("frames"))),
        ("stable bound", bound),
        ("step", step),
        ("integrator", integrator_text(&facts["integrator"])),
        ("effects", effects_text(&facts["effects"])),
        ("loop", loop_text(facts)),
        ("time", estimate),
    ];
    let mut lines = Vec::new();
    let mut rows = rows.map(|(key, value)| vec![key.to_owned(), value]).to_vec();
    if let Some(asked) = facts["accuracy_asked"].as_f64() {
        let text = format!(
            "{} asked: `yawara run` chooses by trials what is not given here as the scene has it by itself",
            percent(asked)
        );
        rows.insert(1, vec!["accuracy".to_owned(), text]);
    }
    for (place, obstacle) in facts["obstacles"].as_array().into_iter().flatten().enumerate() {
        let key = if place == 0 { "obstacles" } else { "" };
        rows.insert(rows.len() - 1, vec![key.to_owned(), obstacle_text(obstacle)]);
    }
    if !facts["self_contact"].is_null() {
        rows.insert(rows.len() - 1, vec!["self contact".to_owned(), self_contact_text(&facts["self_contact"])]);
    }
    if !facts["sleep"].is_null() {
        rows.insert(rows.len() - 1, vec!["sleep".to_owned(), sleep_text(&facts["sleep"])]);
    }
    write_columns(rows, "", &mut lines);
    organs_text(facts, &mut lines);
    lines.join("\n")
}

fn integrator_text(integrator: &Value) -> String {
    let text = |key: &str| integrator[key].as_str().unwrap_or_default().to_owned();
    let tolerance = integrator["tolerance_mm"].as_f64();
    let tolerance = tolerance.map_or_else(String::new, |length| format!("; tolerance {} mm", digits(length, 3)));
    format!("{}: {}{tolerance}", text("method"), text("cost"))
}

fn effects_text(effects: &Value) -> String {
    let mut found = vec!["springs".to_owned()];
    let flag = |key: &str| effects[key].as_bool() == Some(true);
    found.extend(flag("dampers").then(|| "dampers".to_owned()));
    found.extend(flag("volume_term").then(|| "volume term".to_owned()));
    let gravity: f64 =
        effects["gravity_m_per_s2"].as_array().into_iter().flatten().filter_map(Value::as_f64).map(|g| g * g).sum();
    found.extend((gravity > 0.0).then(|| format!("gravity {} m/s^2", digits(gravity.sqrt(), 4))));
    found.extend(effects["drag_per_s"].as_f64().map(|rate| format!("drag {} /s", digits(rate, 4))));
    let times = |count: u64, one: &str| format!("{count} {one}{}", if count == 1 { "" } else { "s" });
    for (kind, count) in effects["operations"].as_object().into_iter().flatten() {
        if kind == "bone" {
            found.push("contact with bone".to_owned());
            continue;
        }
        if kind == "self_contact" {
            found.push("contact of tissue with itself".to_owned());
            continue;
        }
        let one = if kind == "fix" { "fixed region" } else { kind.as_str() };
        found.push(times(count.as_u64().unwrap_or(0), one));
    }
    for kind in ["fibrous", "relaxing", "yielding", "tearing", "rigid"] {
        let count = effects[format!("{kind}_organs")].as_u64().unwrap_or(0);
        found.extend((count > 0).then(|| times(count, &format!("{kind} organ"))));
    }
    found.join(", ")
}

/// The loop that was chosen for these effects.
fn loop_text(facts: &Value) -> String {
    let chosen = &facts["loop"];
    let text = |key: &str| chosen[key].as_str().unwrap_or_default();
    let dampers = if facts["effects"]["dampers"].as_bool() == Some(true) { "springs and dampers" } else { "springs" };
    let arithmetic = if chosen["exact"].as_bool() == Some(true) { "exact" } else { "fast" };
    let alike = 100.0 * chosen["share_of_blocks_alike"].as_f64().unwrap_or(f64::NAN);
    let mut found = format!(
        "{dampers}, constants {}, {arithmetic} arithmetic on {}, {alike:.0} % of blocks alike",
        text("constants"),
        text("instruction_set")
    );
    if let Some(rate) = facts["estimated_particle_steps_per_s"].as_f64() {
        found += &format!(", {} million particle-steps/s", digits(rate * 1e-6, 3));
    }
    found
}

/// Organs as a table of what they are made of, then what is different from direction to direction.
fn organs_text(facts: &Value, lines: &mut Vec<String>) {
    const TITLES: [&str; 9] = [
        "organ",
        "particles",
        "E [Pa]",
        "nu",
        "density [kg/m^3]",
        "viscosity [Pa s]",
        "c_P [m/s]",
        "c_S [m/s]",
        "as given",
    ];
    let organs: Vec<&Value> = facts["organs"].as_array().into_iter().flatten().collect();
    let cell = |value: &Value| value.as_f64().map_or("-".to_owned(), |value| digits(value, 4));
    let mut rows = vec![TITLES.map(str::to_owned).to_vec()];
    for organ in &organs {
        let solid = &organ["solid"];
        let mut row = vec![organ["name"].as_str().unwrap_or_default().to_owned(), organ["particles"].to_string()];
        row.extend(
            [
                "youngs_modulus_pa",
                "poissons_ratio",
                "density_kg_per_m3",
                "viscosity_pa_s",
                "c_p_m_per_s",
                "c_s_m_per_s",
            ]
            .map(|key| cell(&solid[key])),
        );
        row.push(body_text(&organ["body"]));
        rows.push(row);
    }
    lines.push(String::new());
    write_columns(rows, "", lines);
    let isotropic = |organ: &&&Value| organ["solid"]["isotropic"].as_bool() != Some(false);
    if organs.iter().any(|organ| organ["solid"].is_null() && organ["body"]["rigid"].is_null()) {
        lines.push(
            "-: too thin for a material of its own: no particle has all its 26 neighbours in the organ".to_owned(),
        );
    }
    for organ in &organs {
        let mut found = SPREADS.iter().filter(|(key, ..)| !organ["spread"][key].is_null()).peekable();
        if found.peek().is_none() {
            continue;
        }
        let name = organ["name"].as_str().unwrap_or_default();
        for (key, noun, unit) in found {
            let part = |part: &str| cell(&organ["spread"][key][part]);
            lines.push(format!(
                "{name}: its {noun} differs from cell to cell, {} to {} {unit}, mean {}",
                part("least"),
                part("most"),
                part("mean")
            ));
        }
        if !organ["solid"].is_null() {
            lines.push(format!("{name}: the figures above are those at one particle inside"));
        }
    }
    for organ in organs.iter().filter(|organ| !organ["fibres"].is_null()) {
        let direction = organ["fibres"]["direction"].as_array().into_iter().flatten().map(cell);
        lines.push(format!(
            "{}: fibres along [{}] add {} Pa to E where it is drawn out along them; the figures above are without",
            organ["name"].as_str().unwrap_or_default(),
            direction.collect::<Vec<_>>().join(", "),
            cell(&organ["fibres"]["modulus_pa"])
        ));
    }
    for organ in &organs {
        let (name, inelastic) = (organ["name"].as_str().unwrap_or_default(), &organ["inelastic"]);
        if let relaxation @ Value::Object(_) = &inelastic["relaxation"] {
            let [ratio, time] = ["ratio", "time_s"].map(|key| cell(&relaxation[key]));
            lines.push(format!(
                "{name}: relaxes from 1 + {ratio} times the E above, in {time} s to 1/e of the difference"
            ));
        }
        if let plasticity @ Value::Object(_) = &inelastic["plasticity"] {
            let [strain, time] = ["yield_strain", "time_s"].map(|key| cell(&plasticity[key]));
            lines.push(format!("{name}: yields beyond a strain of {strain}, in {time} s"));
        }
        if !inelastic["tear_strain"].is_null() {
            lines.push(format!("{name}: tears at a strain of {}", cell(&inelastic["tear_strain"])));
        }
    }
    for organ in organs.iter().filter(|organ| !isotropic(organ)) {
        let solid = &organ["solid"];
        lines.push(String::new());
        lines.push(format!(
            "{}: not isotropic, E, nu and speeds above are along the voxels' edges; Zener ratio {}",
            organ["name"].as_str().unwrap_or_default(),
            cell(&solid["anisotropy"])
        ));
        let titles = ["along", "E [Pa]", "nu", "c_P [m/s]", "c_S [m/s]"];
        let mut rows = vec![titles.map(str::to_owned).to_vec()];
        for direction in solid["directions"].as_array().into_iter().flatten() {
            let parts = |key: &str| direction[key].as_array().into_iter().flatten().map(cell).collect::<Vec<_>>();
            let (ratios, speeds) = (parts("poissons_ratios"), parts("wave_speeds_m_per_s"));
            let along = direction["along"].as_array().into_iter().flatten().map(Value::to_string);
            rows.push(vec![
                format!("[{}]", along.collect::<String>()),
                cell(&direction["youngs_modulus_pa"]),
                different(&ratios, " to "),
                speeds.first().cloned().unwrap_or_default(),
                different(speeds.get(1..).unwrap_or_default(), ", "),
            ]);
        }
        write_columns(rows, "  ", lines);
        let [on_faces, on_diagonals] = [0, 1].map(|i| cell(&solid["shear_moduli_pa"][i]));
        lines.push(format!(
            "  shear modulus {on_faces} Pa on the voxels' faces, {on_diagonals} Pa across their diagonals; bulk modulus {} Pa",
            cell(&solid["bulk_modulus_pa"])
        ));
    }
}

/// Values as text, once if they read alike.
fn different(values: &[String], between: &str) -> String {
    let mut values = values.to_vec();
    values.dedup();
    values.join(between)
}

/// A body's constants as scenes in JSON name them.
fn body_text(body: &Value) -> String {
    let text = |value: &Value| match (value.as_f64().or(value["constant"].as_f64()), &value["from_hu"]) {
        (Some(number), _) => digits(number, 4),
        (None, Value::Array(points)) => format!("from HU by {} points", points.len()),
        (None, _) => value["from_file"].as_str().map_or(value.to_string(), |path| format!("from {path}")),
    };
    if let Some(rigid) = body.get("rigid") {
        return match &rigid["density_kg_per_m3"] {
            Value::Null => "rigid, stays where it is unless it is moved".to_owned(),
            density => format!("rigid and free to move, density_kg_per_m3 {}", text(density)),
        };
    }
    match body.as_object().and_then(|body| body.values().next()).and_then(Value::as_object) {
        None => body.as_str().unwrap_or_default().to_owned(),
        Some(constants) => constants
            .iter()
            .filter(|(_, value)| !value.is_null())
            .map(|(key, value)| format!("{key} {}", text(value)))
            .collect::<Vec<_>>()
            .join(", "),
    }
}

/// A time as people say it.
fn duration(seconds: f64) -> String {
    const UNITS: [(f64, &str); 5] =
        [(120.0, "s"), (7200.0, "min"), (172_800.0, "hours"), (6.3e7, "days"), (f64::INFINITY, "years")];
    const LENGTHS: [f64; 5] = [1.0, 60.0, 3600.0, 86_400.0, 31_557_600.0];
    let unit = UNITS.iter().position(|(most, _)| seconds < *most).unwrap_or(4);
    format!("{} {}", digits(seconds / LENGTHS[unit], 2), UNITS[unit].1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_in_the_unit_people_take() {
        for (seconds, text) in [
            (0.0123, "0.012 s"),
            (119.0, "120 s"),
            (600.0, "10 min"),
            (36_000.0, "10 hours"),
            (864_000.0, "10 days"),
            (3.2e8, "10 years"),
        ] {
            assert_eq!(duration(seconds), text);
        }
    }

    #[test]
    fn like_values_are_said_once() {
        let texts = |values: &[&str]| values.iter().map(|&v| v.to_owned()).collect::<Vec<_>>();
        assert_eq!(different(&texts(&["0.35", "0.35"]), " to "), "0.35");
        assert_eq!(different(&texts(&["0.1", "0.35"]), " to "), "0.1 to 0.35");
    }
}
