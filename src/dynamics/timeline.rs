//! A scene's operations, applied to a world as their time comes.
//!
//! What an operation does in a step is decided before the step: a grab is told where to be at its end, and the edge of a
//! blade is already where it is to be at its end, so it runs one step ahead of the tissue it meets.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::bone_pieces::{BonePiece, Grip, bone_pieces};
use super::drive::Handle;
use super::effects::contact::{MeshShapeError, Shape, ToolMesh};
use super::effects::pressure::{Face, boundary_faces, lip_faces};
use super::world::{Moment, World};
use crate::cut::Blade;
use crate::geometry::{Point3, Vector3};
use crate::lattice::Lattice;
use crate::lattice::SeveredSpring;
use crate::scene::resolved::{Action, Operation, Pressed, ToolShape};

/// The blade is tested against the springs as soon as edge and tissue together may have moved this far [pitches]. In
/// between, the ways of the particles are taken as straight. A run that ends within a cut leaves the rest untested.
const TEST_INTERVAL: f64 = 0.125;

/// Why an operation cannot be applied to a lattice.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TimelineError {
    /// A region of a pressure holds no face.
    #[error(
        "`{operation}`: its region selects no face; faces are pressed where cells of model \"tissue\" border on nothing, and the \
         organs span ({:.1}, {:.1}, {:.1}) to ({:.1}, {:.1}, {:.1}) mm (RAS+): move or enlarge the region",
        min.x, min.y, min.z, max.x, max.y, max.z
    )]
    NoFace {
        /// Name of the operation.
        operation: String,
        /// Lowest coordinates of any particle at rest, RAS+ [mm].
        min: Point3,
        /// Highest coordinates of any particle at rest, RAS+ [mm].
        max: Point3,
    },
    /// A region holds no particle.
    #[error(
        "`{operation}`: its region selects no particle; the organs span ({:.1}, {:.1}, {:.1}) to ({:.1}, {:.1}, {:.1}) mm \
         (RAS+): move or enlarge the region",
        min.x, min.y, min.z, max.x, max.y, max.z
    )]
    EmptyRegion {
        /// Name of the operation.
        operation: String,
        /// Lowest coordinates of any particle at rest, RAS+ [mm].
        min: Point3,
        /// Highest coordinates of any particle at rest, RAS+ [mm].
        max: Point3,
    },
    /// The mesh of a tool cannot be an obstacle.
    #[error("`{operation}`: {}: {source}", file.display())]
    Mesh {
        /// Name of the operation.
        operation: String,
        /// The file of the mesh.
        file: PathBuf,
        /// Why.
        source: MeshShapeError,
    },
    /// The mesh of a tool was not handed over.
    #[error("`{operation}`: the mesh {} has not been read; hand it to Timeline::with_tools", file.display())]
    MeshNotRead {
        /// Name of the operation.
        operation: String,
        /// The file of the mesh.
        file: PathBuf,
    },
    /// Bone that tissue is to be in contact with is moved in part.
    #[error(
        "`{operation}` takes hold of {found} of the {particles} particles of a rigid organ that is moved (organ[{organ}]), and with \
         contact.bone a rigid organ moves as a whole or stays; take hold of all of it with any = [..., {{ organ = ... }}] in its region, keep it \
         out with not = {{ organ = ... }}, or leave contact.bone out"
    )]
    BoneInPart {
        /// Name of the operation that takes hold of a part.
        operation: String,
        /// Index into the scene's organs.
        organ: usize,
        /// Particles that it takes hold of.
        found: usize,
        /// Particles there are.
        particles: usize,
    },
    /// No voxel of a rigid organ is left in the lattice.
    #[error(
        "contact.bone: no voxel of a rigid organ is left in the lattice; refine lattice.pitch or leave contact.bone out"
    )]
    NoBone,
}

/// Something that happened on the time line, for logs.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// When [s].
    pub time: f64,
    /// Name of the operation.
    pub operation: String,
    /// What.
    pub what: What,
}

/// What happened to an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// It began, on this many particles (faces for a pressure, 0 for a cut and for the lips of one).
    Began(usize),
    /// It ended, or the run did.
    Ended,
    /// The run ended before it could begin.
    NeverBegan,
    /// A cut ended, having severed this many springs; 0 means the blade missed.
    Severed(usize),
}

/// The operations of a scene and how far each has come.
#[derive(Debug)]
pub struct Timeline {
    entries: Vec<Entry>,
    /// What cuts have severed so far, for those that press on their lips: name of the cut and springs.
    severed: Vec<(String, Vec<SeveredSpring>)>,
}

#[derive(Debug)]
struct Entry {
    operation: Operation,
    particles: Vec<u32>,
    /// Of a pressure.
    faces: Vec<Face>,
    /// Severed springs whose lips it knows.
    lips: usize,
    /// Of an obstacle.
    shape: Option<Shape>,
    /// Of bone.
    bone: Vec<BonePiece>,
    state: State,
}

#[derive(Debug)]
enum State {
    Waiting,
    Acting(Handle),
    Cutting(Cutting),
    Done,
}

#[derive(Debug)]
struct Cutting {
    /// In the frame of the lattice [m].
    blade: Blade,
    /// Length of path already tested [m].
    tested: f64,
    /// Where the tissue was at the last test; `None` before the first.
    before: Option<Moment>,
    /// How far any tissue may have moved since the last test [m].
    moved: f64,
    severed: usize,
}

impl Timeline {
    /// Selects the particles of every operation.
    ///
    /// # Errors
    /// If a region selects nothing, or what tissue is to be in contact with cannot be an obstacle. Tools that are meshes need
    /// [`Timeline::with_tools`].
    pub fn new(operations: &[Operation], lattice: &Lattice) -> Result<Self, TimelineError> {
        Self::with_tools(operations, lattice, &BTreeMap::new())
    }

    /// The same with the meshes of tools [mm, RAS+], by the files the operations name.
    ///
    /// # Errors
    /// See [`Timeline::new`].
    pub fn with_tools(
        operations: &[Operation],
        lattice: &Lattice,
        meshes: &BTreeMap<PathBuf, ToolMesh>,
    ) -> Result<Self, TimelineError> {
        let mut entries = operations
            .iter()
            .map(|operation| {
                let mut pressed = Vec::new();
                let particles = match &operation.action {
                    Action::Fix { region } | Action::Force { region, .. } | Action::Grab { region, .. } => {
                        let particles = region.select(lattice);
                        if particles.is_empty() {
                            let (min, max) = extent(lattice);
                            return Err(TimelineError::EmptyRegion { operation: operation.name.clone(), min, max });
                        }
                        particles
                    }
                    Action::Pressure { on: Pressed::Border(region), .. } => {
                        pressed = boundary_faces(lattice, region);
                        if pressed.is_empty() {
                            let (min, max) = extent(lattice);
                            return Err(TimelineError::NoFace { operation: operation.name.clone(), min, max });
                        }
                        Vec::new()
                    }
                    Action::Pressure { on: Pressed::LipsOf(_), .. }
                    | Action::Cut { .. }
                    | Action::Tool { .. }
                    | Action::Plane { .. }
                    | Action::Bone { .. }
                    | Action::SelfContact { .. } => Vec::new(),
                };
                let shape = shape_of(operation, lattice, meshes)?;
                let operation = operation.clone();
                let (lips, bone, state) = (0, Vec::new(), State::Waiting);
                Ok(Entry { operation, particles, faces: pressed, lips, shape, bone, state })
            })
            .collect::<Result<Vec<Entry>, _>>()?;
        take_bone_to_pieces(&mut entries, lattice)?;
        let mut severed: Vec<(String, Vec<SeveredSpring>)> = Vec::new();
        for operation in operations {
            if let Action::Pressure { on: Pressed::LipsOf(cut), .. } = &operation.action {
                severed.push((cut.clone(), Vec::new()));
            }
        }
        severed.sort_by(|a, b| a.0.cmp(&b.0));
        severed.dedup_by(|a, b| a.0 == b.0);
        Ok(Self { entries, severed })
    }

    /// When operations begin and end after the start, latest first [s].
    pub fn turns(&self) -> Vec<f64> {
        let all = self.entries.iter().flat_map(|entry| [entry.operation.from, entry.operation.until]);
        let mut turns: Vec<f64> = all.filter(|turn| *turn > 0.0 && turn.is_finite()).collect();
        turns.sort_by(|a, b| b.total_cmp(a));
        turns
    }

    /// Applies everything that is due before the world's next step. To be called before every step.
    pub fn advance(&mut self, world: &mut World) -> Vec<Event> {
        let mut events = Vec::new();
        for entry in &mut self.entries {
            let before = world.topology().severed().len();
            entry.advance(world, &mut events);
            let name = &entry.operation.name;
            for (_, springs) in self.severed.iter_mut().filter(|(cut, _)| cut == name) {
                springs.extend_from_slice(&world.topology().severed()[before..]);
            }
        }
        if !self.severed.is_empty() {
            self.entries.iter_mut().for_each(|entry| entry.follow_lips(world, &self.severed));
        }
        // All grabs know by now where they lead.
        self.entries.iter().flat_map(|entry| &entry.bone).for_each(|piece| piece.follow(world));
        events
    }

    /// Finishes cuts that are still going on, and reports what has not ended or never began, when the run is over.
    pub fn finish(&mut self, world: &mut World) -> Vec<Event> {
        let report = |entry: &mut Entry| {
            let what = match std::mem::replace(&mut entry.state, State::Done) {
                State::Waiting => What::NeverBegan,
                State::Acting(_) => What::Ended,
                State::Cutting(mut cutting) => {
                    // What moved over the edge since the last test.
                    let (from, until) = (entry.operation.from, entry.operation.until);
                    let share = ((world.time() - from) / (until - from)).clamp(0.0, 1.0);
                    cutting.advance(world, share, true);
                    What::Severed(cutting.severed)
                }
                State::Done => return None,
            };
            Some(Event { time: world.time(), operation: entry.operation.name.clone(), what })
        };
        self.entries.iter_mut().filter_map(report).collect()
    }
}

impl Entry {
    /// What it takes hold of, if it does.
    fn grip(&self) -> Option<Grip<'_>> {
        let moves = match self.operation.action {
            Action::Grab { .. } => true,
            Action::Fix { .. } => false,
            _ => return None,
        };
        Some(Grip { operation: &self.operation.name, particles: &self.particles, moves })
    }

    /// Presses on the lips of a cut as far as it has come.
    fn follow_lips(&mut self, world: &mut World, severed: &[(String, Vec<SeveredSpring>)]) {
        let (State::Acting(handle), Action::Pressure { on: Pressed::LipsOf(cut), .. }) =
            (&self.state, &self.operation.action)
        else {
            return;
        };
        if let Some((_, springs)) = severed.iter().find(|(name, _)| name == cut)
            && springs.len() > self.lips
        {
            self.lips = springs.len();
            world.press_instead(*handle, &lip_faces(world.lattice(), world.topology(), springs));
        }
    }

    fn advance(&mut self, world: &mut World, events: &mut Vec<Event>) {
        let (now, dt) = (world.time(), world.dt());
        // Times are multiples of dt only up to rounding.
        let due = |time: f64| now >= time - 1e-6 * dt;
        let (from, until) = (self.operation.from, self.operation.until);
        let name = &self.operation.name;
        let mut report = |what| events.push(Event { time: now, operation: name.clone(), what });

        if matches!(self.state, State::Waiting) && due(from) {
            self.state = match &self.operation.action {
                Action::Fix { .. } => State::Acting(world.hold(&self.particles)),
                Action::Force { .. } => State::Acting(world.push(&self.particles)),
                Action::Pressure { .. } => State::Acting(world.press(&self.faces)),
                Action::Grab { .. } => State::Acting(world.grab(&self.particles)),
                Action::Bone { friction, .. } => {
                    let added: Vec<Handle> =
                        self.bone.iter_mut().map(|piece| piece.add(world, name, *friction)).collect();
                    State::Acting(added[0])
                }
                Action::Tool { friction, .. } | Action::Plane { friction, .. } => {
                    let shape = self.shape.take().expect("an obstacle has a shape");
                    let handle = world.add_obstacle(name, shape, *friction);
                    if let Action::Tool { path, arrive, .. } = &self.operation.action {
                        world.place_obstacle(handle, along(path, (now - from) / (arrive - from)));
                    }
                    State::Acting(handle)
                }
                Action::SelfContact { organs, friction } => {
                    world.set_self_contact(organs, *friction);
                    // It lasts to the end of the run, and nothing about it changes.
                    State::Done
                }
                Action::Cut { blade, path } => State::Cutting(Cutting {
                    blade: blade_in_lattice(world.lattice(), blade, path),
                    tested: 0.0,
                    before: None,
                    moved: 0.0,
                    severed: 0,
                }),
            };
            report(What::Began(self.particles.len() + self.faces.len()));
        }

        match (&mut self.state, &self.operation.action) {
            (State::Acting(handle), _) if due(until) => {
                world.release(*handle);
                report(What::Ended);
                self.state = State::Done;
            }
            (State::Acting(handle), Action::Force { force, ramp, .. }) => {
                let over_step = [now, now + dt].map(|time| force * ramped(time - from, *ramp));
                world.set_force_over_step(*handle, over_step);
            }
            (State::Acting(handle), Action::Pressure { pressure, ramp, .. }) => {
                let over_step = [now, now + dt].map(|time| pressure * ramped(time - from, *ramp));
                world.set_pressure_over_step(*handle, over_step);
            }
            (State::Acting(handle), Action::Grab { path, arrive, .. }) => {
                world.move_grab(*handle, along(path, (now + dt - from) / (arrive - from)));
            }
            (State::Acting(handle), Action::Tool { path, arrive, .. }) => {
                world.move_obstacle(*handle, along(path, (now + dt - from) / (arrive - from)));
            }
            (State::Cutting(cutting), _) => {
                // The edge arrives a step before the end, and waits for the tissue of that step.
                let arrived = due(until - dt);
                let share = if arrived { 1.0 } else { ((now + dt - from) / (until - from)).clamp(0.0, 1.0) };
                cutting.advance(world, share, arrived);
                if due(until) {
                    report(What::Severed(cutting.severed));
                    self.state = State::Done;
                }
            }
            _ => {}
        }
    }
}

impl Cutting {
    /// Moves the edge to a share of its path and severs what it passed through since the last test.
    fn advance(&mut self, world: &mut World, share: f64, arrived: bool) {
        // Never back: the edge leads the tissue by a step.
        let reached = (share * self.blade.path_length()).max(self.tested);
        let sweep = |tested: f64| self.blade.sweep(tested, reached);
        self.severed += match &mut self.before {
            // The edge takes its lead over tissue that has not moved yet.
            None => {
                let severed = world.cut(&sweep(0.0));
                self.before = Some(world.moment());
                severed
            }
            Some(before) => {
                self.moved += world.longest_move();
                if !arrived && reached - self.tested + self.moved < TEST_INTERVAL * world.lattice().pitch {
                    return;
                }
                world.cut_and_remember(before, &sweep(self.tested))
            }
        };
        self.tested = reached;
        self.moved = 0.0;
    }
}

/// Share of a load that grows from zero over a time [s].
fn ramped(since: f64, ramp: f64) -> f64 {
    if ramp > 0.0 { (since / ramp).clamp(0.0, 1.0) } else { 1.0 }
}

/// The point at a share (0..=1) of the length of a polyline.
fn along(path: &[Vector3], share: f64) -> Vector3 {
    let lengths: Vec<f64> = path.windows(2).map(|pair| (pair[1] - pair[0]).norm()).collect();
    let mut left = share.clamp(0.0, 1.0) * lengths.iter().sum::<f64>();
    for (pair, &length) in path.windows(2).zip(&lengths) {
        if left <= length && length > 0.0 {
            return pair[0] + (pair[1] - pair[0]) * (left / length);
        }
        left -= length;
    }
    path.last().copied().unwrap_or_default()
}

/// The shape of an obstacle; `None` for operations that are none.
fn shape_of(
    operation: &Operation,
    lattice: &Lattice,
    meshes: &BTreeMap<PathBuf, ToolMesh>,
) -> Result<Option<Shape>, TimelineError> {
    let name = || operation.name.clone();
    let mesh = |file: &Path| {
        let not_read = || TimelineError::MeshNotRead { operation: name(), file: file.to_owned() };
        let mesh = meshes.get(file).ok_or_else(not_read)?;
        let shape = Shape::mesh(mesh, lattice.pitch);
        shape.map_err(|source| TimelineError::Mesh { operation: name(), file: file.to_owned(), source })
    };
    Ok(Some(match &operation.action {
        Action::Fix { .. }
        | Action::Force { .. }
        | Action::Grab { .. }
        | Action::Pressure { .. }
        | Action::Cut { .. }
        | Action::Bone { .. }
        | Action::SelfContact { .. } => return Ok(None),
        Action::Tool { shape, .. } => match shape {
            ToolShape::Sphere { center, radius } => Shape::sphere(*center, *radius),
            ToolShape::Capsule { from, to, radius } => Shape::capsule(*from, *to, *radius),
            ToolShape::Box { min, max } => Shape::block(*min, *max),
            ToolShape::Mesh { file } => mesh(file)?,
        },
        Action::Plane { point, normal, .. } => Shape::plane(*point, *normal),
    }))
}

/// Finds which bone moves together.
fn take_bone_to_pieces(entries: &mut [Entry], lattice: &Lattice) -> Result<(), TimelineError> {
    let grips: Vec<Grip<'_>> = entries.iter().filter_map(Entry::grip).collect();
    let of_entry = |entry: &Entry| match &entry.operation.action {
        Action::Bone { organs, .. } => bone_pieces(lattice, organs, &grips),
        _ => Ok(Vec::new()),
    };
    let pieces = entries.iter().map(of_entry).collect::<Result<Vec<_>, _>>()?;
    entries.iter_mut().zip(pieces).for_each(|(entry, pieces)| entry.bone = pieces);
    Ok(())
}

/// From patient space [mm] to the frame of the lattice [m].
fn blade_in_lattice(lattice: &Lattice, edge: &[Point3], path: &[Vector3]) -> Blade {
    let affine = &lattice.grid.affine;
    let edge = edge.iter().map(|&point| affine.index_of(point) * lattice.pitch).collect();
    let path: Vec<Vector3> = path.iter().map(|&offset| affine.index_vector_of(offset) * lattice.pitch).collect();
    Blade::new(edge, &path)
}

/// Box around all particles at rest, RAS+ [mm].
fn extent(lattice: &Lattice) -> (Point3, Point3) {
    let start = (Point3::from([f64::MAX; 3]), Point3::from([f64::MIN; 3]));
    (0..lattice.len() as u32)
        .map(|particle| lattice.rest_place(particle))
        .fold(start, |(min, max), place| (min.inf(&place), max.sup(&place)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_a_path_follow_its_length() {
        let path = [Vector3::zeros(), Vector3::new(1.0, 0.0, 0.0), Vector3::new(1.0, 3.0, 0.0)];
        assert_eq!(along(&path, 0.125), Vector3::new(0.5, 0.0, 0.0));
        assert_eq!(along(&path, 0.5), Vector3::new(1.0, 1.0, 0.0));
        assert_eq!(along(&path, 7.0), Vector3::new(1.0, 3.0, 0.0));
        assert_eq!(along(&path[..1], 0.5), Vector3::zeros());
    }
}
