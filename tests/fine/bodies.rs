//! Worlds and the bodies drawn over them.

use yawara::cut::Blade;
use yawara::dynamics::World;
use yawara::geometry::{Affine, Grid, GridShape, Point3, Vector3};
use yawara::lattice::build::NO_ORGAN;
use yawara::surface::fine::{Body, FineSurface};
use yawara::surface::mesh::TriangleMesh;

use crate::support::{PAPER, TISSUE, organ_map, paper_lattice, tissue_lattice, world};

/// Voxels of 3 mm along each edge.
pub(crate) const SIDE: usize = 10;
/// Radius of the ball [mm].
pub(crate) const RADIUS: f64 = 12.0;

/// Middle of the ball, RAS+ [mm]: that of the grid of [`organ_map`].
pub(crate) fn middle() -> Point3 {
    Point3::new(-10.0, 5.0, 20.0) + Vector3::repeat(3.0 * (SIDE as f64 - 1.0) / 2.0)
}

/// A ball of voxels as tissue or as the paper's particles.
pub(crate) fn ball(tissue: bool) -> World {
    let inside = |ijk: [usize; 3]| {
        let place = Point3::new(-10.0, 5.0, 20.0) + Vector3::from(ijk.map(|i| 3.0 * i as f64));
        if (place - middle()).norm() <= RADIUS { 0 } else { NO_ORGAN }
    };
    let map = organ_map([SIDE; 3], inside);
    world(if tissue { tissue_lattice(&map, &[Some(TISSUE)]) } else { paper_lattice(&map, &[Some(PAPER)]) })
}

/// The ball itself, sampled at a spacing [mm] on a grid that has nothing to do with the lattice's.
pub(crate) fn fine_ball(spacing: f64) -> Body {
    fine_body(spacing, RADIUS + 3.0, |place| RADIUS - (place - middle()).norm())
}

/// What lies where `depth` [mm] is above zero, in a box that reaches so far [mm] from the middle.
pub(crate) fn fine_body(spacing: f64, reach: f64, depth: impl Fn(Point3) -> f64) -> Body {
    let count = (2.0 * reach / spacing) as usize + 1;
    let first = middle() - Vector3::repeat(reach - 0.1);
    let affine = Affine::from_spacing([spacing; 3], first.coords.into()).unwrap();
    let grid = Grid { shape: GridShape::new(count, count, count), affine };
    let values = (0..grid.shape.len()).map(|point| depth(grid.place(point)) as f32).collect();
    Body::new(grid, values).unwrap()
}

/// A blade whose edge runs through the middle along `edge`, swept through the ball along `way` from outside to `depth` [mm] past
/// the middle.
pub(crate) fn cut(world: &mut World, offset: Vector3, edge: Vector3, way: Vector3, depth: f64) -> usize {
    let blade = blade(world, offset, edge, way, depth);
    world.cut(&blade.sweep(0.0, blade.path_length()))
}

/// The blade of [`cut`], before it moves.
pub(crate) fn blade(world: &World, offset: Vector3, edge: Vector3, way: Vector3, depth: f64) -> Blade {
    let to_lattice = |place: Point3| {
        let lattice = world.lattice();
        lattice.grid.affine.index_of(place) * lattice.pitch
    };
    let (edge, way) = (edge.normalize() * 40.0, way.normalize());
    let start = middle() + offset - way * 30.0;
    let ends = vec![to_lattice(start - edge), to_lattice(start + edge)];
    let stroke = world.to_lattice_axes(way * (30.0 + depth) * 1e-3);
    Blade::new(ends, &[Vector3::zeros(), stroke])
}

/// Extracts the surface of a body as the world is cut now.
pub(crate) fn surface(world: &World, body: &Body) -> FineSurface {
    FineSurface::extract(body, world.lattice(), world.topology(), world.cut_sheet()).unwrap()
}

/// That surface where the world has moved it.
pub(crate) fn mesh(world: &World, body: &Body) -> TriangleMesh {
    surface(world, body).carry(world.lattice(), &world.displacements_mm())
}

/// Moves every particle by a function of its rest place (mm to mm).
pub(crate) fn displace(world: &mut World, by: impl Fn(Point3) -> Vector3) {
    for particle in 0..world.lattice().len() as u32 {
        let moved = world.to_lattice_axes(by(world.lattice().rest_place(particle)) * 1e-3);
        world.set_displacement(particle, moved);
    }
}
