//! Scenes that a bound is asked for: bodies, materials, loads, and how fast they come.

/// A scene, in parts.
#[derive(Debug)]
pub(super) struct Case {
    pub(super) name: &'static str,
    pub(super) accuracy: f64,
    /// `phantom` and `spacing` [mm].
    pub(super) volume: &'static str,
    pub(super) model: &'static str,
    /// Pitch [mm]; 0 where the program is to choose.
    pub(super) pitch: f64,
    pub(super) material: &'static str,
    /// Duration [s].
    pub(super) duration: f64,
    pub(super) frames: u32,
    pub(super) loads: &'static str,
}

impl Case {
    /// The scene as it is written.
    pub(super) fn text(&self) -> String {
        let Self { accuracy, volume, model, material, duration, frames, loads, .. } = self;
        let pitch = if self.pitch > 0.0 { format!("pitch = {}", self.pitch) } else { String::new() };
        // Particles of model "paper" lie in the middle of voxels, half a voxel further in.
        let loads = if *model == "paper" { loads.replace("29", "24") } else { (*loads).to_owned() };
        let label = if volume.contains("beam") { "beam" } else { "cube" };
        format!(
            "accuracy = {accuracy}\n[volume]\n{volume}\n[lattice]\nmodel = \"{model}\"\n{pitch}\n[[organ]]\nname = \"block\"\n\
             label = \"{label}\"\n{material}\n[time]\nduration = {duration}\nframes = {frames}\n{loads}"
        )
    }
}

const CUBE: &str = "phantom = \"cube\"\nspacing = 10.0";
const BEAM: &str = "phantom = \"beam\"\nspacing = 10.0";

const SOFT: &str = "youngs_modulus = 5e3\ndensity = 1060\ndamping_ratio = 0.2";
const VISCOUS: &str = "youngs_modulus = 5e3\ndensity = 1060\nviscosity = 20.0";
const SYRUP: &str = "youngs_modulus = 5e3\ndensity = 1060\nviscosity = 100.0";
const WET: &str = "youngs_modulus = 5e3\npoissons_ratio = 0.45\ndensity = 1060\nviscosity = 20.0";
const UNDAMPED: &str = "youngs_modulus = 5e3\ndensity = 1060\ndamping_ratio = 0";
const FIBRES: &str =
    "youngs_modulus = 5e3\ndensity = 1060\ndamping_ratio = 0.3\nfibres = { direction = [1, 0, 1], modulus = 1e4 }";
const RUBBER: &str = "youngs_modulus = 2e5\ndensity = 1060\nviscosity = 100.0";
const LIQUID: &str =
    "youngs_modulus = 5e3\ndensity = 1060\nviscosity = 20.0\nrelaxation = { ratio = 1.0, time = 0.05 }";
const PAPER: &str = "stiffness = 3.75\ndamping = 5e-4\nmass = 2.86e-5";

macro_rules! on_table {
    ($($more:literal),*) => {
        concat!("[[fix]]\nname = \"table\"\nregion = { half_space = { point = [0, 0, -29.9], normal = [0, 0, -1] } }\n", $($more),*)
    };
}
macro_rules! clamped {
    ($($more:literal),*) => {
        concat!("[[fix]]\nname = \"clamp\"\nregion = { half_space = { point = [-79.9, 0, 0], normal = [-1, 0, 0] } }\n", $($more),*)
    };
}
const PRESSED: &str = on_table!(
    "[[push]]\nregion = { half_space = { point = [0, 0, 29.9], normal = [0, 0, 1] } }\npath = [[0, 0, 0], [0, 0, -8]]\nto = 0.2\n"
);
const SHEARED: &str = on_table!(
    "[[push]]\nregion = { half_space = { point = [0, 0, 29.9], normal = [0, 0, 1] } }\npath = [[0, 0, 0], [12, 0, 0]]\nto = 0.2\n"
);
const HEAVY: &str = on_table!("[gravity]\nacceleration = [0.5, 0, -3]\n[drag]\nrate = 20\n");
const LOADED: &str = on_table!(
    "[[push]]\nregion = { half_space = { point = [0, 0, 29.9], normal = [0, 0, 1] } }\nforce = [0.1, 0, -0.3]\nramp = 0.05\n"
);
const HALVED: &str = on_table!(
    "[[cut]]\nblade = [[-40, 0, 0], [40, 0, 0]]\npath = [[0, 0, 40], [0, 0, 0]]\nfrom = 0.0\nto = 0.05\n",
    "[[push]]\nregion = { box = { min = [-31, 9, 29], max = [31, 31, 31] } }\nforce = [0, 0.05, 0]\nramp = 0.05\nfrom = 0.05\n"
);
const SQUEEZED: &str = on_table!(
    "[[pressure]]\nregion = { half_space = { point = [0, 0, 29.9], normal = [0, 0, 1] } }\npressure = 500\nramp = 0.05\n"
);
const BALL: &str = on_table!(
    "[[tool]]\nname = \"ball\"\nshape = { sphere = { center = [0, 0, 50], radius = 20 } }\npath = [[0, 0, 0], [0, 0, -10]]\nto = 0.2\n"
);
const SAGGING: &str = clamped!("[gravity]\nacceleration = [0, 0, -9.81]\n");
const SETTLING: &str = clamped!("[gravity]\nacceleration = [0, 0, -2]\n[drag]\nrate = 30\n");
const BENT: &str = clamped!(
    "[[push]]\nregion = { half_space = { point = [79.9, 0, 0], normal = [1, 0, 0] } }\npath = [[0, 0, 0], [0, 0, 20]]\nto = 0.3\n"
);
const STRETCHED: &str = clamped!(
    "[[push]]\nregion = { half_space = { point = [79.9, 0, 0], normal = [1, 0, 0] } }\nforce = [0.4, 0, 0]\nramp = 0.1\n"
);

macro_rules! cases {
    ($($name:literal, $accuracy:expr, $volume:expr, $model:literal, $pitch:expr, $material:expr, $duration:expr, $frames:expr, $loads:expr;)*) => {
        &[$(Case {
            name: $name, accuracy: $accuracy, volume: $volume, model: $model, pitch: $pitch, material: $material,
            duration: $duration, frames: $frames, loads: $loads,
        }),*]
    };
}

/// Scenes that name their pitch.
pub(super) const FIXED: &[Case] = cases! {
    "paper, pushed", 1e-3, CUBE, "paper", 0.0, PAPER, 0.05, 10, LOADED;
    "paper, heavy", 1e-4, CUBE, "paper", 0.0, PAPER, 0.1, 10, HEAVY;
    "paper, halved", 1e-3, CUBE, "paper", 0.0, PAPER, 0.1, 10, HALVED;
    "pressed, rough", 1e-2, CUBE, "tissue", 10.0, SOFT, 0.3, 10, PRESSED;
    "pressed", 1e-4, CUBE, "tissue", 5.0, SOFT, 0.3, 10, PRESSED;
    "sheared", 1e-5, CUBE, "tissue", 7.5, WET, 0.2, 10, SHEARED;
    "undamped", 1e-3, CUBE, "tissue", 5.0, UNDAMPED, 0.3, 10, LOADED;
    "undamped, fine", 1e-5, CUBE, "tissue", 5.0, UNDAMPED, 0.3, 10, LOADED;
    "squeezed", 1e-4, CUBE, "tissue", 10.0, VISCOUS, 0.2, 7, SQUEEZED;
    "fibres", 1e-4, CUBE, "tissue", 10.0, FIBRES, 0.2, 5, LOADED;
    "beam bent", 1e-4, BEAM, "tissue", 10.0, VISCOUS, 0.4, 20, BENT;
    "beam sagging", 1e-3, BEAM, "tissue", 10.0, RUBBER, 0.3, 10, SAGGING;
    "relaxing", 1e-3, CUBE, "tissue", 7.5, LIQUID, 0.2, 5, LOADED;
    "ball", 1e-3, CUBE, "tissue", 5.0, SOFT, 0.2, 5, BALL;
    "cut", 1e-3, CUBE, "tissue", 5.0, SOFT, 0.2, 5, HALVED;
};

/// Scenes that leave their pitch to the program.
pub(super) const FREE: &[Case] = cases! {
    "pressed, free", 0.02, CUBE, "tissue", 0.0, SOFT, 0.3, 6, PRESSED;
    "sheared, free", 0.02, CUBE, "tissue", 0.0, VISCOUS, 0.3, 6, SHEARED;
    "heavy, free", 0.05, CUBE, "tissue", 0.0, VISCOUS, 0.3, 6, HEAVY;
    "loaded, free", 0.05, CUBE, "tissue", 0.0, VISCOUS, 0.15, 6, LOADED;
    "squeezed, free", 0.05, CUBE, "tissue", 0.0, WET, 0.2, 6, SQUEEZED;
    "fibres, free", 0.1, CUBE, "tissue", 0.0, FIBRES, 0.2, 6, PRESSED;
    "halved, free", 0.1, CUBE, "tissue", 0.0, VISCOUS, 0.2, 6, HALVED;
    "ball, free", 0.05, CUBE, "tissue", 0.0, SOFT, 0.2, 6, BALL;
    "beam bent, free", 0.1, BEAM, "tissue", 0.0, VISCOUS, 0.4, 6, BENT;
    "beam stretched, free", 0.1, BEAM, "tissue", 0.0, VISCOUS, 0.4, 6, STRETCHED;
};

/// More of them, which take longer.
pub(super) const LONG: &[Case] = cases! {
    "beam settling, long", 0.1, BEAM, "tissue", 0.0, RUBBER, 0.3, 6, SETTLING;
    "beam sagging, long", 0.1, BEAM, "tissue", 0.0, RUBBER, 0.3, 6, SAGGING;
    "pressed, long", 0.005, CUBE, "tissue", 0.0, SYRUP, 0.3, 6, PRESSED;
    "loaded, long", 0.02, CUBE, "tissue", 0.0, SYRUP, 0.2, 6, LOADED;
};
