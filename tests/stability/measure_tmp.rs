use super::support::*;
use std::time::Instant;
use yawara::dynamics::World;
use yawara::dynamics::stable_dt::{Limits, SAFETY};
use yawara::dynamics::step_control::StepControl;
use yawara::lattice::Topology;
use yawara::run::{inputs, label_lookup::Files, prepare::prepare};

fn measure(name: &str, lattice: yawara::lattice::Lattice, assembly: yawara::material::Assembly) {
    let topology = Topology::new(&lattice);
    let t = Instant::now();
    let at_rest = Limits::at_rest(&lattice, &topology, &assembly);
    let t_rest = t.elapsed().as_secs_f64();
    let mut text = String::new();
    for steps in [1e3, 3e3, 1e4, 1e5] {
        let t = Instant::now();
        let l = at_rest.sharpen(&lattice, &topology, &assembly, steps);
        text += &format!(" {steps}: {:.4} of rest in {:.3} s;", l.sharp / at_rest.rest, t.elapsed().as_secs_f64());
    }
    let mut world = World::new(lattice, assembly, SAFETY * at_rest.rest);
    shake(&mut world, 1e-4, 0.0, 1);
    let mut control = StepControl::new(&world, at_rest);
    let n = 10;
    let t = Instant::now();
    (0..n).for_each(|_| world.step().unwrap());
    let step = t.elapsed().as_secs_f64() / n as f64;
    let t = Instant::now();
    (0..n).for_each(|_| {
        control.look(&world);
    });
    let look = t.elapsed().as_secs_f64() / n as f64;
    println!(
        "{name}: {} particles, rest/promise {:.3}, {at_rest:?}, at_rest {t_rest:.3} s, sharpen{text} step {:.2} ms, look {:.2} ms = {:.2} steps",
        world.lattice().len(),
        at_rest.rest / at_rest.promise,
        step * 1e3,
        look * 1e3,
        look / step
    );
}

#[test]
fn figures() {
    for scene in ["fixtures/scenes/liver-ct.toml", "fixtures/scenes/beam.toml"] {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(scene);
        let (scene_, _) = yawara::scene::load(&path, &Files).unwrap();
        let inputs = inputs::load(&scene_.volume).unwrap();
        let t = Instant::now();
        let p = prepare(&scene_, &inputs).unwrap();
        println!("{scene}: prepare {:.3} s, {:?}", t.elapsed().as_secs_f64(), p.schedule);
        measure(scene, p.lattice, p.assembly);
    }
    let (l, mut a) = tissue_lattice(&block([125, 125, 125]), &[Some(TISSUE)]);
    measure("block", l.clone(), a.clone());
    a.volume = Some(yawara::material::VolumeTerm { modulus: vec![5e3; l.len()], viscosity: None });
    measure("block with volume", l, a);
}
