//! Where a cut ends inside the tissue, its sides come together.
//!
//! A vertex on one side of a cut is carried by the corners of that side alone, and one beyond its end by all corners of its cell. Were that
//! all, the sides would part by a leap where the cut ends, of another height in every cell that the blade slants through: a ragged
//! ledge along the bottom of a cut that is drawn open. So a vertex near the end is carried by both: the nearer it is, the more by
//! all corners of the cell in which the cut ends, as far as that cell holds together.
//!
//! Source: Organ, Fleming, Terry and Belytschko, Continuous meshless approximations for nonconvex bodies by diffraction and transparency,
//! 1996: what carries over the end of a crack must fade away from it, not stop.

use rayon::prelude::*;

use super::host_cells::ALL;
use super::hosts::{Host, Hosts, cell_of};
use crate::geometry::{CellMap, Vector3};

/// How far from its end a cut is drawn together [cells].
const REACH: f64 = 1.0;

/// A vertex near the end of a cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ending<H> {
    pub(super) vertex: u32,
    /// The cell in which the cut ends, with all corners there are.
    pub(super) all: H,
    /// Where the vertex is in it, in coordinates of that cell.
    pub(super) local: [f32; 3],
    /// How much of it they carry.
    pub(super) share: f32,
    /// How that share changes along the axes of the cell.
    pub(super) slope: [f32; 3],
}

impl<H> Ending<H> {
    /// The same with another name for its host.
    pub(super) fn with<N>(self, all: N) -> Ending<N> {
        let Self { vertex, local, share, slope, .. } = self;
        Ending { vertex, all, local, share, slope }
    }
}

/// The vertices near the ends of cuts, ascending.
///
/// - `hosts_of`: host of each vertex; `places`: its index coordinates in the lattice; `ends`: vertices where cuts end.
pub(super) fn endings(hosts: &Hosts<'_>, hosts_of: &[Host], places: &[Vector3], ends: &[u32]) -> Vec<Ending<Host>> {
    let cell = |place: Vector3| cell_of(place / REACH);
    let mut near = CellMap::<[i32; 3], Vec<(Vector3, Host)>>::default();
    for &end in ends {
        let place = places[end as usize];
        let all = hosts.all_of(cell_of(place));
        if let Some(all) = all {
            near.entry(cell(place)).or_default().push((place, all));
        }
    }
    if near.is_empty() {
        return Vec::new();
    }
    let ending = |(vertex, (&host, &place)): (usize, (&Host, &Vector3))| {
        if host.carrying == ALL {
            return None;
        }
        let own = cell(place);
        let around = (0..27).map(|at| [at % 3, at / 3 % 3, at / 9].map(|step: i32| step - 1));
        let ends = around.filter_map(|step| near.get(&[0, 1, 2].map(|axis| own[axis] + step[axis]))).flatten();
        let distance = |(end, _): &&(Vector3, Host)| (end - place).norm_squared();
        let &(end, all) = ends.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let away = place - end;
        let left = 1.0 - away.norm() / REACH;
        if left <= 0.0 || all == host {
            return None;
        }
        let slope = away.try_normalize(1e-9).map_or(Vector3::zeros(), |away| away * (-2.0 * left / REACH));
        let local = place - Vector3::from(all.cell.map(f64::from));
        let [local, slope] = [local, slope].map(|vector| vector.map(|x| x as f32).into());
        Some(Ending { vertex: vertex as u32, all, local, share: (left * left) as f32, slope })
    };
    hosts_of.par_iter().zip(places).enumerate().filter_map(ending).collect()
}
