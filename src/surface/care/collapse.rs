//! Edges that shrink to a point, the cheapest first.
//!
//! ```text
//! every edge has a price: the quadric at the best place, or its length
//! take the cheapest; for each place it may shrink to, the best first:
//!     link condition, shape of the triangles around, clearance, distance to the original -> shrink, price the edges around anew
//!     none holds -> leave it until one of its neighbours changes
//! ```

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use super::clearance::Clearance;
use super::features::Target;
use super::halves::Halves;
use super::origin::{Bound, Homes, Origin, samples};
use super::quadric::Quadric;
use super::volumes::{Volumes, behind};
use super::{CareError, RestMesh, shape};
use crate::geometry::{Matrix3, Vector3};
use crate::surface::normals::Sheet;

/// Weight of the planes that stand on a rim, against those of the triangles at it.
const RIM_WEIGHT: f64 = 10.0;

/// A place may be shifted by this share of its edge to keep the volume.
const VOLUME_SHIFT: f64 = 0.5;

/// The order in which edges shrink, and when that ends.
#[derive(Debug, Clone, Copy)]
pub(super) enum Order {
    /// By the quadric, down to a count.
    Error { triangles: usize },
    /// The shortest first, below a length [mm].
    Shortest { below: f64 },
}

/// A mesh that is being changed.
#[derive(Debug)]
pub(super) struct Worker<'a> {
    pub(super) halves: Halves,
    pub(super) places: Vec<Vector3>,
    /// For each vertex the original one it came from.
    pub(super) parents: Vec<u32>,
    pub(super) sheets: Vec<Sheet>,
    pub(super) organs: Vec<u8>,
    pub(super) origin: Origin<'a>,
    pub(super) bound: Option<Bound>,
    max_error: f64,
    pub(super) volumes: Volumes,
    quadrics: Vec<Quadric>,
    clearance: Clearance,
    /// Quadrics are summed round this: far from the origin they would cancel.
    middle: Vector3,
}

/// An edge in the queue.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Entry {
    price: f64,
    half: u32,
    /// Number of the price; an older one of the same edge does not count.
    serial: u32,
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    /// The cheapest is the greatest; ties go to the lower half-edge.
    fn cmp(&self, other: &Self) -> Ordering {
        other.price.total_cmp(&self.price).then(other.half.cmp(&self.half)).then(other.serial.cmp(&self.serial))
    }
}

/// A place an edge may shrink to.
#[derive(Debug, Clone, Copy)]
struct Choice {
    place: Vector3,
    /// The end whose place it is.
    of: Option<u32>,
}

impl<'a> Worker<'a> {
    pub(super) fn new(mesh: RestMesh<'a>, clearance: f64, max_error_mm: Option<f64>) -> Result<Self, CareError> {
        let halves = Halves::new(mesh.positions.len(), mesh.triangles)?;
        let places: Vec<Vector3> = mesh.positions.iter().map(|&place| Vector3::from(place)).collect();
        let low = places.iter().copied().reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let high = places.iter().copied().reduce(|a, b| a.sup(&b)).unwrap_or_default();
        let middle = (low + high) / 2.0;
        let origin = Origin::new(mesh);
        let mut worker = Self {
            clearance: Clearance::new(clearance, &places, |vertex| halves.used(vertex)),
            bound: max_error_mm.map(|max_error| Bound::new(&origin, max_error)),
            max_error: max_error_mm.unwrap_or(f64::INFINITY),
            parents: (0..places.len() as u32).collect(),
            sheets: mesh.sheets.to_vec(),
            organs: mesh.organs.to_vec(),
            quadrics: Vec::new(),
            volumes: Volumes::new(&halves, &places, middle),
            middle,
            halves,
            places,
            origin,
        };
        worker.quadrics =
            (0..worker.places.len() as u32).into_par_iter().map(|vertex| worker.quadric_at(vertex)).collect();
        Ok(worker)
    }

    pub(super) fn corners(&self, triangle: u32) -> [Vector3; 3] {
        self.halves.corners(triangle).map(|vertex| self.places[vertex as usize])
    }

    /// Planes of the triangles at a vertex, and those that stand on its rims.
    fn quadric_at(&self, vertex: u32) -> Quadric {
        if !self.halves.used(vertex) {
            return Quadric::default();
        }
        let place = self.places[vertex as usize];
        let mut sum = Quadric::default();
        for half in self.halves.ring(vertex) {
            let normal = shape::normal(self.corners(half / 3));
            let area = normal.norm();
            if area == 0.0 {
                continue;
            }
            sum = sum.plus(&Quadric::plane(place - self.middle, normal / area, area / 6.0));
            if self.along_rim(half) {
                let along = self.places[self.halves.to(half) as usize] - place;
                for side in [half, self.halves.twin(half)] {
                    let across = along.cross(&shape::normal(self.corners(side / 3)));
                    if let Some(across) = across.try_normalize(0.0) {
                        let weight = RIM_WEIGHT * along.norm_squared();
                        sum = sum.plus(&Quadric::plane(place - self.middle, across, weight));
                    }
                }
            }
        }
        sum
    }

    /// Shrinks edges until the order is done.
    pub(super) fn collapse(&mut self, order: Order) {
        let mut serials = vec![0_u32; self.halves.len() as usize];
        let halves = 0..self.halves.len();
        let first = halves.into_par_iter().filter(|&half| self.halves.lives(half) && half < self.halves.twin(half));
        let entry = |half| self.price(half, order).map(|price| Entry { price, half, serial: 0 });
        let mut queue: BinaryHeap<Entry> = first.filter_map(entry).collect::<Vec<_>>().into();
        let mut serial = 0;
        let enough = match order {
            Order::Error { triangles } => triangles,
            Order::Shortest { .. } => 0,
        };
        while self.halves.triangles > enough {
            let Some(Entry { half, serial: given, .. }) = queue.pop() else { break };
            if !self.halves.lives(half) || serials[half as usize] != given || !self.halves.may_collapse(half) {
                continue;
            }
            let Some(kept) = self.shrink(half) else { continue };
            for out in self.halves.ring(kept) {
                let edge = out.min(self.halves.twin(out));
                serial += 1;
                serials[out as usize] = serial;
                serials[self.halves.twin(out) as usize] = serial;
                if let Some(price) = self.price(edge, order) {
                    queue.push(Entry { price, half: edge, serial });
                }
            }
        }
    }

    /// What an edge costs; `None` when it must stay or is out of the order.
    fn price(&self, half: u32, order: Order) -> Option<f64> {
        let target = self.target(half)?;
        let [from, to] = self.ends(half);
        if let Order::Shortest { below } = order {
            let length = (self.places[to as usize] - self.places[from as usize]).norm();
            return (length < below).then_some(length);
        }
        let quadric = self.quadric_of(half);
        let at = |place: Vector3| quadric.at(place - self.middle);
        let [start, end] = [from, to].map(|vertex| self.places[vertex as usize]);
        let price = match target {
            Target::Free => {
                let middle = (start + end) / 2.0 - self.middle;
                quadric.at(quadric.least(middle).map_or(middle, |least| least.0))
            }
            Target::Ends => at(start).min(at(end)),
            Target::Start => at(start),
            Target::End => at(end),
        };
        price.is_finite().then_some(price)
    }

    fn ends(&self, half: u32) -> [u32; 2] {
        [self.halves.from(half), self.halves.to(half)]
    }

    fn quadric_of(&self, half: u32) -> Quadric {
        let [from, to] = self.ends(half);
        self.quadrics[from as usize].plus(&self.quadrics[to as usize])
    }

    /// Places an edge may shrink to, the best first.
    fn choices(&self, half: u32) -> Vec<Choice> {
        let Some(target) = self.target(half) else { return Vec::new() };
        let [start, end] =
            self.ends(half).map(|vertex| Choice { place: self.places[vertex as usize], of: Some(vertex) });
        let quadric = self.quadric_of(half);
        let mut ends = match target {
            Target::Start => vec![start],
            Target::End => vec![end],
            Target::Free | Target::Ends => vec![start, end],
        };
        ends.sort_by(|one, two| quadric.at(one.place - self.middle).total_cmp(&quadric.at(two.place - self.middle)));
        let middle = (start.place + end.place) / 2.0;
        let least = if target == Target::Free { quadric.least(middle - self.middle) } else { None };
        let Some((least, inverse)) = least else { return ends };
        let least = least + self.middle;
        let mut choices = Vec::with_capacity(4);
        if let Some(place) = self.keeping_volume(half, least, &inverse) {
            choices.push(Choice { place, of: None });
        }
        choices.push(Choice { place: least, of: None });
        choices.extend(ends);
        choices
    }

    /// Shifts a place, by the least growth of the quadric, so that the volume stays what it is.
    fn keeping_volume(&self, half: u32, place: Vector3, inverse: &Matrix3) -> Option<Vector3> {
        let [from, to] = self.ends(half);
        // The volume behind the fan is linear in the place: normal . place = sum of the triple products, all from `place`.
        let normal: Vector3 = self.around(from, to).map(|triangle| shape::normal(self.corners(triangle))).sum();
        let lacking = -self.growth(half, place) + self.volumes.owed([from, to]);
        let way = inverse * normal;
        let shift = way * (lacking / normal.dot(&way));
        let length = (self.places[to as usize] - self.places[from as usize]).norm();
        (shift.norm() < VOLUME_SHIFT * length).then_some(place + shift)
    }

    /// By how much (six times) the volume grows when an edge shrinks to a place.
    fn growth(&self, half: u32, place: Vector3) -> f64 {
        let [from, to] = self.ends(half);
        // The new triangles all have a corner at the place: nothing lies between them and it.
        -behind(self.around(from, to).map(|triangle| self.corners(triangle)), place)
    }

    /// Triangles at one vertex or the other.
    fn around(&self, one: u32, two: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.halves.ring(one).map(|half| half / 3);
        let others = self.halves.ring(two).filter(move |&half| !self.halves.corners(half / 3).contains(&one));
        first.chain(others.map(|half| half / 3))
    }

    /// Shrinks an edge to the first place that everything allows; the vertex that is left.
    fn shrink(&mut self, half: u32) -> Option<u32> {
        let choices = self.choices(half);
        let (choice, homes) = choices.into_iter().find_map(|choice| Some((choice, self.allows(half, choice)?)))?;
        let [from, to] = self.ends(half);
        let (half, gone, kept) =
            if choice.of == Some(from) { (self.halves.twin(half), to, from) } else { (half, from, to) };
        let old: Vec<u32> = if self.bound.is_some() { self.around(from, to).collect() } else { Vec::new() };
        let left: Vec<u32> = old.iter().copied().filter(|&triangle| !self.at_both(triangle, [from, to])).collect();
        self.volumes.grow(kept, self.growth(half, choice.place));
        self.volumes.pass_on(gone, kept);
        self.clearance.remove(gone, self.places[gone as usize]);
        if choice.of.is_none() {
            let places = [gone, kept].map(|vertex| self.origin.place(self.parents[vertex as usize]));
            if (places[0] - choice.place).norm_squared() < (places[1] - choice.place).norm_squared() {
                self.parents[kept as usize] = self.parents[gone as usize];
            }
            self.clearance.shift(kept, self.places[kept as usize], choice.place);
            self.places[kept as usize] = choice.place;
        }
        self.quadrics[kept as usize] = self.quadrics[gone as usize].plus(&self.quadrics[kept as usize]);
        self.halves.collapse(half);
        if let Some(bound) = &mut self.bound {
            bound.replace(&old, &left, &homes);
        }
        if self.sheet(kept) != Sheet::Skin {
            // Faces and rims of cuts keep their places: the skin beside them makes up for what they lose.
            let skin = |vertex: &u32| self.sheet(*vertex) == Sheet::Skin;
            if let Some(beside) = self.halves.ring(kept).map(|out| self.halves.to(out)).filter(skin).min() {
                self.volumes.pass_on(kept, beside);
            }
        }
        Some(kept)
    }

    fn at_both(&self, triangle: u32, ends: [u32; 2]) -> bool {
        let corners = self.halves.corners(triangle);
        ends.iter().all(|end| corners.contains(end))
    }

    /// Whether an edge may shrink to a place; where the attached vertices go then (nowhere without a bound).
    fn allows(&self, half: u32, choice: Choice) -> Option<Homes> {
        let [from, to] = self.ends(half);
        let place = choice.place;
        if choice.of.is_none() && !self.clearance.is_clear(place, &self.places, [from, to]) {
            return None;
        }
        if self.bound.is_some() && self.quadric_of(half).distance(place - self.middle) > self.max_error {
            return None;
        }
        if !self.volumes.allow(from, self.growth(half, place)) {
            return None;
        }
        let mut worst = f64::INFINITY;
        for triangle in self.around(from, to) {
            worst = worst.min(shape::quality(self.corners(triangle)));
        }
        let mut new = Vec::with_capacity(16);
        for triangle in self.around(from, to).filter(|&triangle| !self.at_both(triangle, [from, to])) {
            let old = self.corners(triangle);
            let vertices = self.halves.corners(triangle);
            let moved = [0, 1, 2].map(|at| if [from, to].contains(&vertices[at]) { place } else { old[at] });
            if moved != old {
                let stays = shape::fair(shape::quality(moved), worst);
                if !(stays && shape::same_way(shape::normal(old), shape::normal(moved))) {
                    return None;
                }
            }
            new.push(moved);
        }
        let Some(bound) = &self.bound else { return Some(Homes::new()) };
        let old: Vec<u32> = self.around(from, to).collect();
        // Sides across from the place are as they were; of the two at it, one belongs to the neighbour.
        let own = |corners: &[Vector3; 3]| {
            let at = corners.iter().position(|corner| *corner == place).unwrap_or(0);
            samples(*corners).filter(move |(weights, _)| weights[at] > 0 && weights[(at + 1) % 3] > 0)
        };
        let samples: Vec<Vector3> = new.iter().flat_map(own).map(|(_, sample)| sample).chain([place]).collect();
        bound.allows(&self.origin, &old, &new, &samples)
    }
}
