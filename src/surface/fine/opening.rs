//! The springs of a body as blades have left them, followed from cut to cut.
//!
//! ```text
//! passed      springs of the body that the sheet passes through
//! parted      springs between points whose hosts have been parted
//! ```
//! A further cut asks only for what it touched: springs at the new quads of the sheet, and points in cells of the lattice that the
//! new quads reached or that lost a spring since. What is found is what would be found at once.

use rayon::prelude::*;

use super::Frame;
use super::hosts::{Host, Hosts, cell_of};
use super::knife::Knife;
use crate::cut::CutSheet;
use crate::geometry::{CellSet, Vector3};
use crate::lattice::neighbours::{FIRST_FORWARD, NEIGHBOURS, opposite};
use crate::lattice::{Lattice, NO_PARTICLE, SeveredSpring, Topology};

/// What is known of a body's cuts.
#[derive(Debug, Clone, Default)]
pub(super) struct Opening {
    /// What blades had done when the body was opened last; `None` before the first severed spring.
    followed: Option<Followed>,
    /// Points of the body outside every cell of the lattice, and the cells that carry them.
    strays: Option<Vec<(u32, [i32; 3])>>,
}

#[derive(Debug, Clone)]
struct Followed {
    topology: Topology,
    sheet: CutSheet,
    /// Ascending by particle and direction, as `parted` is.
    passed: Vec<SeveredSpring>,
    parted: Vec<SeveredSpring>,
}

/// Cells of the lattice, by their lowest corners.
type Cells = CellSet<[i32; 3]>;

impl Opening {
    /// The living springs of a body.
    pub(super) fn open(
        &mut self,
        fine: &Lattice,
        (lattice, topology, cuts): (&Lattice, &Topology, &CutSheet),
        knife: &Knife,
        hosts: &Hosts<'_>,
        frame: &Frame,
    ) -> Topology {
        let followed = self.followed.take().filter(|followed| followed.leads_to(topology, cuts));
        let followed = followed.unwrap_or_else(|| Followed::nothing(lattice));
        let Followed { topology: before, sheet, mut passed, mut parted } = followed;
        let known = sheet.quads.len();
        passed.extend(knife.severed(fine, 2 * known, |index| frame.to_fine(index)));
        // A spring counts where the sheet passes it first. The list is two ascending runs.
        passed.sort_by(|a, b| key(a).cmp(&key(b)).then(a.at.total_cmp(&b.at)));
        passed.dedup_by_key(|spring| key(spring));
        let mut cut = Topology::new(fine);
        for &spring in &passed {
            cut.sever(fine, spring);
        }
        // The springs of the lattice have the last word: where all of them live, nothing but the sheet parts.
        if topology.severed().is_empty() {
            return cut;
        }
        let touched = touched(lattice, &before, topology, knife.cells_of(2 * known));
        let fresh = self.hosts_in(&touched, fine, hosts, frame);
        let is_fresh = |point: u32| fresh.binary_search_by_key(&point, |entry| entry.0).is_ok();
        parted.retain(|spring| {
            let other = fine.neighbour(spring.particle, usize::from(spring.direction));
            let stays = !is_fresh(spring.particle) && !other.is_some_and(is_fresh);
            stays && passed.binary_search_by_key(&key(spring), key).is_err()
        });
        let host_of = |point: u32| match fresh.binary_search_by_key(&point, |entry| entry.0) {
            Ok(at) => (fresh[at].1, true),
            Err(_) => (hosts.host(frame.place_of(fine, point)), false),
        };
        let springs = fresh.par_iter().flat_map_iter(|&(point, host)| {
            let alive = cut.alive()[point as usize];
            let living = (0..NEIGHBOURS).filter(move |direction| alive >> direction & 1 == 1);
            let ends = living.filter_map(move |direction| Some((direction, fine.neighbour(point, direction)?)));
            ends.filter_map(move |(direction, other)| {
                let (far, both) = host_of(other);
                // Between two such points the spring is asked for from its lower end.
                let asked = direction >= FIRST_FORWARD || !both;
                let (particle, direction) =
                    if direction >= FIRST_FORWARD { (point, direction) } else { (other, opposite(direction)) };
                let spring = SeveredSpring { particle, direction: direction as u8, at: 0.5, time: 0.0 };
                (asked && hosts.are_parted(host, far)).then_some(spring)
            })
        });
        parted.par_extend(springs);
        parted.par_sort_unstable_by_key(key);
        for &spring in &parted {
            cut.sever(fine, spring);
        }
        self.followed = Some(Followed { topology: topology.clone(), sheet: cuts.clone(), passed, parted });
        cut
    }

    /// Points of the body whose cells are among some, with their hosts, ascending.
    fn hosts_in(&mut self, cells: &Cells, fine: &Lattice, hosts: &Hosts<'_>, frame: &Frame) -> Vec<(u32, Host)> {
        let place = |point: u32| frame.place_of(fine, point);
        let strays = self.strays.get_or_insert_with(|| {
            let points = (0..fine.len() as u32).into_par_iter();
            points.filter_map(|point| Some((point, hosts.stray(place(point))?))).collect()
        });
        let strays = strays.par_iter().filter(|(_, cell)| cells.contains(cell)).map(|&(point, _)| point);
        let within = cells.par_iter().flat_map_iter(|&cell| points_in(cell, fine, frame));
        let mut found: Vec<(u32, Host)> = within.chain(strays).map(|point| (point, hosts.host(place(point)))).collect();
        found.par_sort_unstable_by_key(|entry| entry.0);
        // The blade may have reached both a stray's own cell and the one that carries it.
        found.dedup_by_key(|entry| entry.0);
        found
    }
}

impl Followed {
    fn nothing(lattice: &Lattice) -> Self {
        let (topology, sheet) = (Topology::new(lattice), CutSheet::default());
        Self { topology, sheet, passed: Vec::new(), parted: Vec::new() }
    }

    /// Whether blades came from here to a state by going on.
    fn leads_to(&self, topology: &Topology, cuts: &CutSheet) -> bool {
        let (before, after) = (self.topology.alive(), topology.alive());
        before.len() == after.len()
            && before.par_iter().zip(after).all(|(before, after)| after & !before == 0)
            && cuts.vertices.starts_with(&self.sheet.vertices)
            && cuts.quads.starts_with(&self.sheet.quads)
    }
}

fn key(spring: &SeveredSpring) -> (u32, u8) {
    (spring.particle, spring.direction)
}

/// Cells that new quads reach into, and all cells round the particles that lost a spring.
fn touched(lattice: &Lattice, before: &Topology, after: &Topology, reached: impl Iterator<Item = [i32; 3]>) -> Cells {
    let mut touched: Cells = reached.collect();
    let particles = before.alive().par_iter().zip(after.alive()).enumerate();
    let lost = particles.filter_map(|(particle, (before, after))| (before != after).then_some(particle as u32));
    for particle in lost.collect::<Vec<_>>() {
        let [i, j, k] = lattice.ijk(particle).map(|i| i as i32);
        touched.extend((0..8).map(|back| [i - (back & 1), j - (back >> 1 & 1), k - (back >> 2)]));
    }
    touched
}

/// Points of the body in a cell of the lattice.
fn points_in<'a>(cell: [i32; 3], fine: &'a Lattice, frame: &Frame) -> impl Iterator<Item = u32> + use<'a> {
    let corners: [Vector3; 8] = std::array::from_fn(|corner| {
        frame.to_fine(Vector3::from([0, 1, 2].map(|axis| f64::from(cell[axis] + (corner >> axis & 1) as i32))))
    });
    let low = corners.iter().fold(corners[0], |low, corner| low.inf(corner)).map(f64::floor);
    let high = corners.iter().fold(corners[0], |high, corner| high.sup(corner)).map(f64::ceil);
    let shape = fine.grid.shape;
    let last = shape.dims().map(|points| points as f64 - 1.0);
    let [from, to] = [low, high].map(|end| [0, 1, 2].map(|axis| end[axis].clamp(0.0, last[axis]) as usize));
    let frame = *frame;
    let indices = (from[2]..=to[2])
        .flat_map(move |k| (from[1]..=to[1]).flat_map(move |j| (from[0]..=to[0]).map(move |i| [i, j, k])));
    let particles = indices.map(move |ijk| fine.particle_at[shape.linear(ijk)]);
    particles.filter(move |&particle| particle != NO_PARTICLE && cell_of(frame.place_of(fine, particle)) == cell)
}
