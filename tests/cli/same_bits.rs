//! The same files whatever the number of threads.

use crate::support::Folder;

#[test]
fn one_two_and_four_threads_write_the_same_bytes() {
    let folder = Folder::new();
    // Two organs of tissue, so that the kernel's and the surface's parallel parts all run.
    folder.write(
        "two.toml",
        r#"
[volume]
phantom = "abdomen"
spacing = 8.0
[lattice]
model = "tissue"
[[organ]]
name = "liver"
label = "liver"
youngs_modulus = 5e3
density = 1060
damping_ratio = 0.2
[[organ]]
name = "vessels"
label = "liver_vessels"
youngs_modulus = 2e4
density = 1060
damping_ratio = 0.2
[time]
duration = 0.03
frames = 3
[[fix]]
region = { half_space = { point = [0, -30, 0], normal = [0, -1, 0] } }
[[cut]]
blade = [[61, 20, -80], [61, 20, 80]]
path = [[0, 80, 0], [0, 0, 0]]
from = 0.001
to = 0.01
[[pull]]
region = { sphere = { center = [74, 58, 0], radius = 20 } }
force = [1, 0.5, 0]
from = 0.01
"#,
    );
    for threads in ["1", "2", "4"] {
        let at = |name: &str| format!("t{threads}/{name}");
        let call = |arguments: &[&str]| folder.yawara(&[&["--threads", threads, "-q"], arguments].concat()).done();
        let run = at("run");
        call(&["run", "two.toml", "-o", &run]);
        for name in ["a.stl", "a.ply"] {
            call(&["mesh", &run, "-o", &at(name)]);
        }
        call(&["mesh", &run, "-o", &at("a.glb"), "--frame", "all"]);
        call(&["slice", &run, "-o", &at("a.png"), "--axis", "z", "--at", "0"]);
        call(&["volume", &run, "-o", &at("v.png")]);
        // They tell when, and how fast.
        for name in ["manifest.json", "log.txt"] {
            std::fs::remove_file(folder.path(&at("run")).join(name)).expect("a file of the run");
        }
    }
    let one = folder.tree("t1");
    assert!(one["a.stl"].len() > 50_000 && one.keys().any(|name| name.contains("displacement/c.3")));
    for threads in ["t2", "t4"] {
        let other = folder.tree(threads);
        assert!(one.keys().eq(other.keys()), "{threads}");
        let differ: Vec<&String> = one.keys().filter(|name| one[*name] != other[*name]).collect();
        assert!(differ.is_empty(), "{threads}: {differ:?}");
    }
}
