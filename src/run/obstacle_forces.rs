//! What tissue did to tools, planes and bone between frames.

use super::drive::Frame;
use crate::geometry::Vector3;
use crate::scene::resolved::Scene;

/// Axes of the patient, as series are named.
const AXES: [char; 3] = ['x', 'y', 'z'];

/// The forces on the obstacles of a scene, frame by frame.
#[derive(Debug)]
pub(super) struct ObstacleForces {
    obstacles: Vec<Felt>,
    /// When the last frame was [s].
    last: f64,
}

/// What one obstacle has felt.
#[derive(Debug)]
struct Felt {
    name: String,
    /// Impulse until the last frame, RAS+ [N s].
    impulse: Vector3,
    /// Mean force between the last two frames, RAS+ [N].
    force: Vector3,
    /// The largest such force [N], and its frame.
    largest: (f64, u64),
}

impl ObstacleForces {
    /// Before the first frame.
    pub(super) fn new(scene: &Scene) -> Self {
        let obstacles = scene.operations.iter().filter(|operation| operation.action.is_obstacle());
        let zero = Vector3::zeros();
        let felt = obstacles.map(|o| Felt { name: o.name.clone(), impulse: zero, force: zero, largest: (0.0, 0) });
        Self { obstacles: felt.collect(), last: 0.0 }
    }

    /// The series of a frame: name, unit, value. Obstacles count from 1, in the order they appear; before they do, the force is
    /// zero, and it is the mean since the frame before.
    pub(super) fn of_frame(&mut self, frame: &Frame<'_>) -> Vec<(String, &'static str, f64)> {
        let time = frame.world.time();
        let passed = time - std::mem::replace(&mut self.last, time);
        let mut values = Vec::new();
        for (number, felt) in (1..).zip(&mut self.obstacles) {
            // Bone that is moved in pieces is as many obstacles of one name.
            let own = frame.world.obstacles().filter(|facts| facts.name == felt.name);
            let impulse: Vector3 = own.map(|facts| facts.impulse).sum();
            let gained = impulse - std::mem::replace(&mut felt.impulse, impulse);
            felt.force = if passed > 0.0 { gained / passed } else { Vector3::zeros() };
            if felt.force.norm() > felt.largest.0 {
                felt.largest = (felt.force.norm(), frame.number);
            }
            values.extend(AXES.iter().zip(&felt.force).map(|(axis, &part)| (series(number, *axis), "N", part)));
        }
        values
    }

    /// A line for each obstacle.
    pub(super) fn lines(&self) -> Vec<String> {
        let line = |(number, felt): (usize, &Felt)| {
            let Felt { name, force, largest: (largest, frame), .. } = felt;
            let [x, y, z] = [force.x, force.y, force.z];
            format!(
                "`{name}`: force of the tissue on it ({x:.3e}, {y:.3e}, {z:.3e}) N in the last frame, at most {largest:.3e} N \
                 (frame {frame}); series obstacle_{number}_force_x, _y, _z"
            )
        };
        (1..).zip(&self.obstacles).map(line).collect()
    }
}

fn series(number: usize, axis: char) -> String {
    format!("obstacle_{number}_force_{axis}")
}
