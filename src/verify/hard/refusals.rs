//! What has to be refused, or read as something sensible, with a message that says what to do.

use std::path::Path;

use super::super::bodies::{
    ALL_MODELS, MODELS, Model, Random, SIZES, Trial, alone, block_of, is_finite, largest, shake, state,
};
use super::super::tally::Tally;
use super::super::{Case, Finding, Group};
use super::layer;
use crate::dynamics::StepError;
use crate::dynamics::reference_world::ReferenceWorld;
use crate::geometry::Vector3;
use crate::io::nifti::{CtEncoding, read_ct, write_ct};
use crate::phantom::cube;
use crate::run::inputs::load;
use crate::run::label_lookup::Files;
use crate::run::prepare::{PrepareError, Prepared, prepare};
use crate::scene::parse;
use crate::volume::Volume;

pub(super) fn cases() -> Vec<Case> {
    let case = |name, asked, run| Case { group: Group::Hard, name, asked, run };
    vec![
        case(
            "step-1000-times-too-large",
            "a scene that asks for it is refused with a step that works; a state stepped with it is caught at once",
            too_large,
        ),
        case("fast-tool", "a tool is followed exactly, or refused where tissue cannot follow it", fast_tool),
        case("nan-in-a-ct", "voxels of a CT that are not numbers are read as air and counted", nan_in_ct),
        case(
            "nan-in-a-scene",
            "every number of a scene is refused when it is not one, with its line and key",
            nan_in_scene,
        ),
        case("nan-in-a-state", "a place or velocity that is not a number is found in the first step", nan_in_state),
    ]
}

/// A block in one of the models, gravity, every kind of operation.
fn scene(model: Model, dt: Option<f64>) -> String {
    let (name, material) = match model {
        Model::Paper => ("paper", "stiffness = 7.5\ndamping = 1e-3\nmass = 2.3e-4".to_owned()),
        Model::Tissue(nu) => {
            ("tissue", format!("youngs_modulus = 5e3\npoissons_ratio = {nu:?}\ndensity = 1060.0\ndamping_ratio = 0.2"))
        }
    };
    let dt = dt.map_or(String::new(), |dt| format!("dt = {dt:e}\n"));
    format!(
        r#"
[volume]
phantom = "cube"
spacing = 10.0
[lattice]
model = "{name}"
pitch = 10.0
[[organ]]
name = "cube"
label = "cube"
{material}
[time]
duration = 20.0
{dt}frames = 1
[gravity]
acceleration = [0.0, 0.0, -9.81]
[[fix]]
name = "table"
region = {{ half_space = {{ point = [0.0, 0.0, -24.0], normal = [0.0, 0.0, -1.0] }} }}
[[cut]]
name = "half"
blade = [[-40.0, 0.4, 0.0], [40.0, 0.4, 0.0]]
path = [[0.0, 0.0, 40.0], [0.0, 0.0, 0.0]]
from = 0.01
to = 0.02
[[push]]
name = "hand"
region = {{ box = {{ min = [-31.0, 1.0, 10.0], max = [31.0, 31.0, 31.0] }} }}
force = [0.0, 0.5, 0.0]
from = 0.02
[[pull]]
name = "clamp"
region = {{ sphere = {{ center = [24.0, 24.0, 24.0], radius = 14.0 }} }}
path = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
from = 0.03
to = 0.09
"#
    )
}

/// As a run prepares it; the message when a scene, a volume or the step is refused.
fn prepared(text: &str) -> Result<Result<Prepared, PrepareError>, String> {
    let (scene, _) = parse(text, Path::new("scene.toml"), Path::new(""), &Files).map_err(|error| error.to_string())?;
    let inputs = load(&scene).map_err(|error| error.to_string())?;
    Ok(prepare(&scene, &inputs))
}

fn too_large() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let mut latest = 0_u64;
        for model in ALL_MODELS {
            match refused_step(model) {
                Ok(wrong) => tally.error(model, wrong),
                Err(text) => tally.fault(format!("{model}: {text}")),
            }
            for (pitch, n) in SIZES {
                for (amplitude, times) in [(1e-2, 1e3), (1e-6, 1e3), (1e-2, 1e6)] {
                    let mut trial = Trial::new(block_of(model, pitch, [n; 3], 0.1));
                    trial.world.set_dt(times * trial.world.dt());
                    shake(&mut trial.world, amplitude, 0.0, &mut Random::new(8));
                    let mut twin = ReferenceWorld::of(&trial.world);
                    let caught = (1..=50_u64).find_map(|step| trial.world.step().err().map(|error| (step, error)));
                    match caught {
                        Some((step, error)) => {
                            latest = latest.max(step);
                            tally.refusal(model, &error);
                            tally.expect(error.to_string().contains("times the stable one"), || {
                                format!("{model}: {error}")
                            });
                        }
                        None => {
                            tally.fault(format!("{model}, {pitch} mm: {times:e} times the stable step is not caught"))
                        }
                    }
                    tally.expect(is_finite(&trial.world), || format!("{model}: the last state is not kept"));
                    tally.expect((0..50).any(|_| twin.step().is_err()), || format!("{model}: not caught in f64"));
                    tally.steps += trial.world.steps() + 1;
                }
            }
        }
        let happened = format!(
            "all scenes are refused, and run with the step that the message proposes; {} shaken blocks are caught after at most \
             {latest} steps, with the last good state kept",
            tally.refused
        );
        tally.finding(0.0, happened)
    })
}

/// Asks for a thousand times the stable step, then for what the refusal proposes; the number of wrong answers.
fn refused_step(model: Model) -> Result<f64, String> {
    let chosen = prepared(&scene(model, None))?.map_err(|error| error.to_string())?;
    let asked = 1e3 * chosen.schedule.stable_dt;
    let Err(error) = prepared(&scene(model, Some(asked)))? else { return Err(format!("{asked:e} s is accepted")) };
    let text = error.to_string();
    let PrepareError::UnstableStep { suggested, .. } = error else { return Err(text) };
    let named =
        text.contains(&format!("{suggested:.2e}")) && text.contains("time.dt") && text.contains("leave time.dt out");
    let works = prepared(&scene(model, Some(suggested)))?.is_ok();
    Ok(f64::from(u8::from(!named) + u8::from(!works)))
}

fn fast_tool() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        let (mut followed, mut apart) = (0, 0.0_f64);
        for model in MODELS {
            for (pitch, n) in SIZES {
                for moves in [0.01, 0.1, 1.0, 10.0, 1e4] {
                    let what = format!("{model}, {pitch} mm, {moves} pitches in a step");
                    let mut trial = Trial::new(block_of(model, pitch, [n + 2, n, n], 0.2));
                    let world = &mut trial.world;
                    let (h, dt) = (world.lattice().pitch, world.dt());
                    let tool = layer(world, 1);
                    let grab = world.grab(&tool);
                    let mut twin = ReferenceWorld::of(world);
                    twin.grab(&tool);
                    // Two pitches away and back, then still; 1e4 pitches in a step go as far as they come.
                    let way = |time: f64| {
                        let gone = moves * time / dt;
                        if moves > 5.0 { gone } else { (gone % 4.0).min(4.0 - gone % 4.0) }
                    };
                    let result = trial.run_beside(&mut twin, 10, |world, twin| {
                        let at = Vector3::new(-0.6, 0.8, 0.0) * (way(world.time() + world.dt()) * h);
                        world.move_grab(grab, at * 1e3);
                        twin.move_grab(at);
                    });
                    let world = &trial.world;
                    tally.expect(is_finite(world), || format!("{what}: a place is not a number"));
                    match result {
                        Ok(far) => {
                            followed += 1;
                            apart = apart.max(far);
                            let told = Vector3::new(-0.6, 0.8, 0.0) * (way(world.time()) * h);
                            tally
                                .error(&what, largest(tool.iter().map(|&p| (world.displacement(p) - told).norm() / h)));
                            tally.expect(moves < 5.0, || format!("{what}: not refused"));
                        }
                        Err(error) => {
                            tally.refusal(&what, &error);
                            tally.expect(moves > 0.05, || format!("{what}: {error}"));
                        }
                    }
                    tally.steps += trial.steps;
                }
            }
        }
        let happened = format!(
            "tools of 0.01 to 10 000 pitches in a step: {followed} are followed to {:.1e} pitches, with all tissue within \
             {apart:.1e} of a twin in f64, {} refused with place and reason",
            tally.error, tally.refused
        );
        tally.expect(apart < 1e-3, || format!("f32 and f64 differ by {apart:.1e} pitches"));
        tally.finding(1e-4, happened)
    })
}

fn nan_in_ct() -> Finding {
    let mut tally = Tally::default();
    if let Err(text) = read_bad_ct(&mut tally) {
        tally.fault(text);
    }
    let happened = format!(
        "4 of 216 voxels that are NaN or infinite are read as air and counted, so that the run can warn; the others differ by {} HU",
        tally.error
    );
    tally.finding(0.0, happened)
}

fn read_bad_ct(tally: &mut Tally) -> Result<(), String> {
    let text = |error: &dyn std::error::Error| error.to_string();
    let phantom = cube(2, 3.0).map_err(|error| text(&error))?;
    let good = phantom.image.as_slice().to_vec();
    let mut bad = good.clone();
    let places = [0, 43, 100, 215];
    for (place, value) in places.into_iter().zip([f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -f32::NAN]) {
        *bad.get_mut(place).ok_or("the phantom is smaller than it was")? = value;
    }
    let folder = tempfile::tempdir().map_err(|error| text(&error))?;
    let path = folder.path().join("ct.nii.gz");
    let volume = Volume::from_vec(*phantom.image.grid(), bad);
    write_ct(&path, &volume, CtEncoding::Float32).map_err(|error| text(&error))?;
    let (read, info) = read_ct(&path).map_err(|error| text(&error))?;
    tally.expect(info.replaced_voxels == 4, || format!("{} voxels counted, 4 are bad", info.replaced_voxels));
    for (place, (&found, &expected)) in read.as_slice().iter().zip(&good).enumerate() {
        let expected = if places.contains(&place) { -1024.0 } else { expected };
        tally.error(format!("voxel {place}"), f64::from(found - expected).abs());
    }
    Ok(())
}

/// Every number of a scene in turn.
fn nan_in_scene() -> Finding {
    let mut tally = Tally::default();
    for model in [Model::Paper, Model::Tissue(0.45)] {
        let text = scene(model, Some(1e-5));
        if let Err(error) = parse(&text, Path::new("scene.toml"), Path::new(""), &Files) {
            tally.fault(format!("{model}: {error}"));
        }
        for (start, end) in numbers(&text) {
            for bad in ["nan", "-nan", "inf", "-inf"] {
                let wrong = format!("{}{bad}{}", &text[..start], &text[end..]);
                let line = text[..start].matches('\n').count() + 1;
                tally.trials += 1;
                match parse(&wrong, Path::new("scene.toml"), Path::new(""), &Files) {
                    Ok(_) => {
                        tally.error += 1.0;
                        tally.fault(format!("line {line}: {bad} instead of {} is accepted", &text[start..end]));
                    }
                    Err(error) => {
                        let told = error.to_string();
                        tally.expect(told.contains(&format!("scene.toml:{line}:")), || {
                            format!("line {line}, {bad}: {told}")
                        });
                    }
                }
            }
        }
    }
    let happened = format!(
        "nan, -nan, inf and -inf in place of each number of two scenes: {} tried, {} accepted, each refusal names file and line",
        tally.trials, tally.error
    );
    tally.finding(0.0, happened)
}

/// Where the numbers of a scene begin and end: what follows `= `, `[` or `, ` and begins like one.
fn numbers(text: &str) -> Vec<(usize, usize)> {
    let bytes = text.as_bytes();
    let mut found = Vec::new();
    for start in 1..bytes.len() {
        let begins = bytes[start].is_ascii_digit() || bytes[start] == b'-';
        if begins && matches!(bytes[start - 1], b' ' | b'[') {
            let length = text[start..].find([',', ']', ' ', '\n']).unwrap_or(text.len() - start);
            found.push((start, start + length));
        }
    }
    found
}

fn nan_in_state() -> Finding {
    alone(|| {
        let mut tally = Tally::default();
        for model in ALL_MODELS {
            for (pitch, n) in SIZES {
                for damping in [0.0, 0.2] {
                    let rest = Trial::new(block_of(model, pitch, [n; 3], damping));
                    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e30] {
                        for place in [true, false] {
                            let mut world = rest.world.clone();
                            let (other, wrong) = (Vector3::zeros(), Vector3::new(0.0, bad, 0.0));
                            world.set_displacement(7, if place { wrong } else { other });
                            world.set_velocity(7, if place { other } else { wrong });
                            let what =
                                format!("{model}, {pitch} mm, {bad} as a {}", if place { "place" } else { "velocity" });
                            for result in [world.step(), ReferenceWorld::of(&world).step()] {
                                tally.trials += 1;
                                match result {
                                    Err(error @ StepError::Diverged { step: 1, .. }) => tally.refusal(&what, &error),
                                    _ => {
                                        tally.error += 1.0;
                                        tally.fault(format!("{what}: not found in the first step"));
                                    }
                                }
                            }
                            let others = state(&world).0;
                            let moved =
                                others.iter().enumerate().filter(|&(p, u)| p != 7 && *u != Vector3::zeros()).count();
                            tally.expect(moved == 0, || format!("{what}: {moved} other particles moved"));
                        }
                    }
                }
            }
        }
        let happened = format!(
            "{} states with NaN, infinity or 1e30 m in one place or velocity, in f32 and f64: {} not found in the first step; no other \
             particle has moved",
            tally.trials, tally.error
        );
        tally.finding(0.0, happened)
    })
}
