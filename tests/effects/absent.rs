//! What a scene does not name costs nothing: no memory is held for it, and steps reserve none.

use std::path::Path;

use yawara::dynamics::World;
use yawara::dynamics::timeline::Timeline;
use yawara::run::inputs;
use yawara::run::label_lookup::Files;
use yawara::run::prepare::prepare;
use yawara::scene;

/// Keys of the organ and tables of the scene for each effect.
const EFFECTS: [(&str, &str, &str); 13] = [
    ("bare", "", ""),
    ("gravity", "", "[gravity]\nacceleration = [0, 0, -9.81]"),
    ("drag", "", "[drag]\nrate = 2.0"),
    ("dampers", "damping_ratio = 0.2", ""),
    ("volume term", "poissons_ratio = 0.45", ""),
    ("fibres", "fibres = { direction = [1, 1, 0], modulus = 1e4 }", ""),
    ("relaxation", "relaxation = { ratio = 0.5, time = 0.2 }", ""),
    ("plasticity", "plasticity = { yield_strain = 0.1 }", ""),
    ("tearing", "tear_strain = 0.5", ""),
    ("fix", "", "[[fix]]\nregion = { half_space = { point = [0, 0, -25], normal = [0, 0, -1] } }"),
    (
        "pull",
        "",
        "[[pull]]\nregion = { sphere = { center = [0, 0, 30], radius = 10 } }\npath = [[0, 0, 0], [0, 0, 1]]\nto = 1.0",
    ),
    (
        "sleep and pull",
        "",
        "[sleep]\nwindow = 0.01\n[[pull]]\nregion = { sphere = { center = [0, 0, 30], radius = 10 } }\npath = [[0, 0, 0], [0, 0, 1]]\nto = 1.0",
    ),
    ("plane", "", "[[plane]]\npoint = [0, 0, -29]\nnormal = [0, 0, 1]\nfriction = 0.3"),
];

/// Steps that are watched: more than the program looks at for a step that is too long.
const STEPS: usize = 200;

struct Case {
    /// Bytes that the world holds.
    held: u64,
    world: World,
    timeline: Timeline,
}

fn case(organ: &str, tables: &str) -> Case {
    let text = format!(
        "[volume]\nphantom = \"cube\"\nspacing = 1.5\n[lattice]\npitch = 3.0\n[[organ]]\nname = \"cube\"\nlabel = \"cube\"\n\
         youngs_modulus = 5e3\ndensity = 1060\n{organ}\n{}{}[time]\nduration = 1\nframes = 1\n{tables}\n",
        if organ.contains("poissons_ratio") { "" } else { "poissons_ratio = 0.25\n" },
        if organ.contains("damping_ratio") { "" } else { "damping_ratio = 0\n" },
    );
    let (scene, _) = scene::parse(&text, Path::new("effect"), Path::new(""), &Files).unwrap();
    let inputs = inputs::load(&scene).unwrap();
    let timeline = Timeline::new(&scene.operations, &prepare(&scene, &inputs).unwrap().lattice).unwrap();
    let mut world = None;
    // What the scene was made from is gone when the count ends.
    let memory = allocation_counter::measure(|| {
        world = Some(prepare(&scene, &inputs).unwrap().into_world(&scene));
    });
    Case { held: memory.bytes_current as u64, world: world.unwrap(), timeline }
}

/// On a thread of its own, whose memory is counted.
fn on_one_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(work)
}

/// Nothing is held beside what the program says that it holds, which names every effect.
#[test]
fn a_world_holds_what_it_says() {
    let said = |case: &Case| case.world.bytes_per_particle() * case.world.lattice().len() as f64;
    let cases = on_one_thread(|| EFFECTS.map(|(name, organ, tables)| (name, case(organ, tables))));
    let bare = said(&cases[0].1);
    for (name, case) in &cases {
        let (said, held) = (said(case), case.held as f64);
        println!("{name}: {held} bytes held, {said} said, {:.2} times the bare lattice's", said / bare);
        assert!((held / said - 1.0).abs() < 0.05, "{name}: {held} bytes are held, {said} are said to be");
        let adds = ["dampers", "volume term", "fibres", "relaxation", "plasticity", "tearing", "sleep and pull"]
            .contains(name);
        assert_eq!(said > 1.05 * bare, adds, "{name}: {said} bytes, {bare} without");
    }
}

/// All but contact, which lists what is near in every step.
#[test]
fn steps_reserve_no_memory() {
    for (name, organ, tables) in EFFECTS.into_iter().filter(|&(name, ..)| name != "plane") {
        let reserved = on_one_thread(|| {
            let Case { mut world, mut timeline, .. } = case(organ, tables);
            // Operations begin, and buffers are made.
            for _ in 0..3 {
                timeline.advance(&mut world);
                world.step().unwrap();
            }
            allocation_counter::measure(|| (0..STEPS).for_each(|_| world.step().unwrap()))
        });
        println!("{name}: {} reservations in {STEPS} steps", reserved.count_total);
        assert_eq!(reserved.count_total, 0, "{name}: {} bytes in {STEPS} steps", reserved.bytes_total);
    }
}
