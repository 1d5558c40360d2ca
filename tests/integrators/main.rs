//! The integrators: their orders, what they conserve, how far they may step, and where each pays.

#[path = "../support/mod.rs"]
mod support;

mod conserved;
mod implicit;
mod limits;
mod orders;
mod prices;

use support::*;
use yawara::dynamics::integrator::{Integrator, Method, Precision};
use yawara::dynamics::{Handle, World};
use yawara::geometry::Vector3;
use yawara::material::tissue::{Damping, TissueBody};

/// All methods that go through time.
const MOVING: [Method; 5] =
    [Method::SymplecticEuler, Method::Verlet, Method::Rk4, Method::BogackiShampine, Method::BackwardEuler];

/// A small beam of tissue with a volume term, held at one end, grabbed at the other and moved there.
struct Beam {
    world: World,
    grab: Handle,
}

/// Where its grabbed end is led to in the long run, per second, RAS+ [mm/s].
const DRAWN: [f64; 3] = [150.0, 60.0, 0.0];

impl Beam {
    /// Under gravity and a force, with dampers and drag if there is damping.
    fn new(damping: f64, integrator: Integrator, dt: f64) -> Self {
        let body = TissueBody { poissons_ratio: 0.4, damping: Damping::Ratio(damping), ..TISSUE };
        let (lattice, assembly) = tissue_lattice(&block([5, 2, 3]), &[Some(body)]);
        let mut world = World::new(lattice, assembly, dt);
        world.set_integrator(integrator);
        world.set_gravity(Vector3::new(0.0, -30.0, -98.1));
        if damping > 0.0 {
            world.set_drag(30.0);
        }
        let column = |p: u32| world.lattice().ijk(p)[0];
        let first = particles(&world).into_iter().map(column).min().unwrap();
        let at = |x: usize| particles(&world).into_iter().filter(|&p| column(p) == first + x).collect::<Vec<_>>();
        let (held, pushed, grabbed) = (at(0), at(2), at(5));
        assert!(!pushed.is_empty() && !grabbed.is_empty());
        world.hold(&held);
        let push = world.push(&pushed);
        world.set_force(push, Vector3::new(2e-2, 4e-2, 0.0));
        let grab = world.grab(&grabbed);
        Self { world, grab }
    }

    fn step(&mut self) {
        let there = self.world.time() + self.world.dt();
        self.world.move_grab(self.grab, Vector3::from(DRAWN) * there);
        self.world.step().unwrap();
    }
}

/// An integrator in f64 with a tolerance below all that is measured.
fn precise(method: Method) -> Integrator {
    let tolerance = if method == Method::BogackiShampine { 1.0 } else { 1e-14 };
    Integrator { tolerance, precision: Precision::Double, ..Integrator::new(method) }
}

/// Root of the mean square of the lengths of differences.
fn difference(a: &[Vector3], b: &[Vector3]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum::<f64>() / a.len() as f64).sqrt()
}

/// Runs something in a pool of so many threads.
fn among<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}
