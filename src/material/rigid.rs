//! Which particles belong to rigid parts, and which of these parts may move.

/// How a particle moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RigidKind {
    /// By itself, as its springs let it.
    Soft,
    /// Only while something grabs it: a rigid organ that is fixed in space. Its mass counts nowhere.
    Anchored,
    /// With all particles it is joined to, as one rigid body.
    Free,
}

/// The rigid particles of an assembly.
///
/// The mass of a [`RigidKind::Free`] particle stands in [`super::Assembly::mass`], is positive and holds everything it
/// carries: its own voxel and its shares of the partly soft cells around it. It sizes the body and, particle by particle,
/// the stable step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RigidParts {
    kind: Vec<RigidKind>,
}

impl RigidParts {
    /// - `kind` of each particle. Shape `[particles]`.
    ///
    /// `None` when nothing is free, which is how assemblies without moving rigid parts say so.
    pub fn new(kind: Vec<RigidKind>) -> Option<Self> {
        kind.contains(&RigidKind::Free).then_some(Self { kind })
    }

    /// Kind of each particle. Shape `[particles]`.
    pub fn kind(&self) -> &[RigidKind] {
        &self.kind
    }
}
