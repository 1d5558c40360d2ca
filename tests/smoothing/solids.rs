//! Solids whose distance is known everywhere, as a scanner and as a label map would see them.

use yawara::geometry::GridShape;

/// Distance to the surface in voxels, negative inside.
pub(crate) type Distance = Box<dyn Fn([f64; 3]) -> f64>;

/// A solid in the middle of a grid.
pub(crate) struct Solid {
    pub(crate) name: String,
    pub(crate) shape: GridShape,
    pub(crate) distance: Distance,
    /// Volume \[voxels\].
    pub(crate) volume: f64,
    /// Area \[voxel faces\].
    pub(crate) area: f64,
}

/// Off the grid points, so that no symmetry flatters a figure.
const OFF: [f64; 3] = [0.137, 0.311, 0.423];

pub(crate) fn ball(radius: f64) -> Solid {
    let size = 2 * (radius.ceil() as usize + 6);
    let middle = OFF.map(|off| size as f64 / 2.0 + off);
    Solid {
        name: format!("ball {radius}"),
        shape: GridShape::new(size, size, size),
        distance: Box::new(move |place| norm(minus(place, middle)) - radius),
        volume: 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3),
        area: 4.0 * std::f64::consts::PI * radius.powi(2),
    }
}

/// A tilted tube with round ends.
pub(crate) fn tube(radius: f64) -> Solid {
    let length = 40.0;
    let along = unit([0.36, 0.48, 0.8]);
    let size = length as usize + 2 * (radius.ceil() as usize + 5);
    let middle = OFF.map(|off| size as f64 / 2.0 + off);
    let distance = move |place: [f64; 3]| {
        let from = minus(place, middle);
        let reach = dot(from, along).clamp(-length / 2.0, length / 2.0);
        norm(minus(from, along.map(|part| part * reach))) - radius
    };
    Solid {
        name: format!("tube {radius}"),
        shape: GridShape::new(size, size, size),
        distance: Box::new(distance),
        volume: std::f64::consts::PI * radius.powi(2) * (length + 4.0 / 3.0 * radius),
        area: std::f64::consts::TAU * radius * (length + 2.0 * radius),
    }
}

/// What the surface separates.
pub(crate) struct Seen {
    /// Share of the solid in every voxel.
    pub(crate) cover: Vec<f32>,
    /// Voxels whose centre is inside.
    pub(crate) mask: Vec<bool>,
}

pub(crate) fn see(solid: &Solid) -> Seen {
    const FINE: usize = 8;
    let step = |at: usize| (at as f64 + 0.5) / FINE as f64 - 0.5;
    let centre = |at: usize| solid.shape.ijk(at).map(|index| index as f64);
    let cover = |at: usize| {
        let [x, y, z] = centre(at);
        let far = (solid.distance)([x, y, z]);
        if far.abs() > 1.0 {
            return f32::from(far < 0.0);
        }
        let fine = (0..FINE.pow(3)).map(|n| [step(n % FINE), step(n / FINE % FINE), step(n / FINE / FINE)]);
        let inside = fine.filter(|[i, j, k]| (solid.distance)([x + i, y + j, z + k]) < 0.0).count();
        inside as f32 / FINE.pow(3) as f32
    };
    let all = 0..solid.shape.len();
    Seen { cover: all.clone().map(cover).collect(), mask: all.map(|at| (solid.distance)(centre(at)) < 0.0).collect() }
}

/// A CT of the solid: tissue of 60 HU in fat of -100 HU, with Gaussian noise \[HU\].
pub(crate) fn hu(cover: &[f32], noise: f32) -> Vec<f32> {
    let mut state = 7_u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1_u64 << 24) as f32
    };
    cover.iter().map(|cover| 160.0 * cover - 100.0 + noise * ((0..12).map(|_| uniform()).sum::<f32>() - 6.0)).collect()
}

/// Direction in which the distance grows.
pub(crate) fn outward(solid: &Solid, place: [f64; 3]) -> [f64; 3] {
    let step = 1e-4;
    unit([0, 1, 2].map(|axis| {
        let beside = |by: f64| {
            let mut place = place;
            place[axis] += by;
            (solid.distance)(place)
        };
        beside(step) - beside(-step)
    }))
}

pub(crate) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

pub(crate) fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = norm(a);
    a.map(|part| part / length)
}
