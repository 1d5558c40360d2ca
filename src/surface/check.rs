//! The oracle: is a triangle mesh closed, manifold and oriented, and what does it measure.
//!
//! It reads indices and places alone and knows nothing of how a mesh was made. It does not look for triangles that pass through
//! each other. Time and memory are linear in the number of triangles (edges are sorted among the few that share
//! their lower vertex).

use super::mesh::TriangleMesh;

/// A triangle with a smaller angle is a sliver \[degrees\].
pub const SLIVER_DEG: f64 = 5.0;

/// What a mesh is like. Counts of 0 in every "bad" field, a positive volume and at least one triangle make it sound.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshReport {
    /// Vertices, used or not.
    pub vertices: usize,
    /// Vertices no triangle uses.
    pub unused_vertices: usize,
    /// Triangles.
    pub triangles: usize,
    /// Triangles that name a vertex the mesh does not have; nothing below counts them.
    pub dangling_triangles: usize,
    /// Triangles that name a vertex twice; edges, fans and parts below do not count them.
    pub collapsed_triangles: usize,
    /// Triangles with three vertices but no area (less than 1e-10 of the square of their longest side).
    pub flat_triangles: usize,
    /// Triangles beyond the first on the same three vertices, in either direction.
    pub duplicate_triangles: usize,
    /// Edges with one triangle.
    pub open_edges: usize,
    /// Edges with more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles run along them in the same direction.
    pub inconsistent_edges: usize,
    /// Vertices whose triangles form more than one fan.
    pub non_manifold_vertices: usize,
    /// Vertices with a NaN or infinite coordinate.
    pub non_finite_vertices: usize,
    /// Euler characteristic V - E + F over used vertices: 2 - 2 genus per closed part.
    pub euler: i64,
    /// Surface area [mm^2].
    pub area_mm2: f64,
    /// Signed volume [mm^3]; positive when triangles look outward. Means something for a closed mesh only.
    pub volume_mm3: f64,
    /// Smallest angle of a triangle with area \[degrees\]; 180 when there is none.
    pub min_angle_deg: f64,
    /// Triangles with area and an angle below [`SLIVER_DEG`].
    pub slivers: usize,
    /// Lowest and highest corner of the box round all finite vertices, RAS+ [mm]; `None` when there is none.
    pub bounds: Option<[[f32; 3]; 2]>,
    /// Connected parts, largest number of triangles first.
    pub components: Vec<ComponentReport>,
}

/// One connected part of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComponentReport {
    /// Vertices.
    pub vertices: usize,
    /// Edges.
    pub edges: usize,
    /// Triangles.
    pub triangles: usize,
    /// Euler characteristic V - E + F.
    pub euler: i64,
    /// Surface area [mm^2].
    pub area_mm2: f64,
    /// Signed volume [mm^3]; negative for the wall of a cavity.
    pub volume_mm3: f64,
}

impl MeshReport {
    /// No edge is open.
    pub fn is_closed(&self) -> bool {
        self.open_edges == 0
    }

    /// Every edge has at most two triangles and every vertex one fan.
    pub fn is_manifold(&self) -> bool {
        self.non_manifold_edges == 0 && self.non_manifold_vertices == 0 && self.duplicate_triangles == 0
    }

    /// Neighbouring triangles agree about their outside.
    pub fn is_oriented(&self) -> bool {
        self.inconsistent_edges == 0
    }

    /// Signed volume \[mL\].
    pub fn volume_ml(&self) -> f64 {
        self.volume_mm3 / 1000.0
    }

    /// Closed, manifold, oriented outward, every triangle with area, every coordinate finite, and not empty.
    pub fn passes(&self) -> bool {
        let bad = self.dangling_triangles + self.collapsed_triangles + self.flat_triangles + self.non_finite_vertices;
        let sound = self.is_closed() && self.is_manifold() && self.is_oriented();
        sound && bad == 0 && self.triangles > 0 && self.volume_mm3 > 0.0
    }
}

impl std::fmt::Display for MeshReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{} vertices, {} triangles, {} {}, Euler characteristic {}, area {:.2} mm2, volume {:.4} mL",
            self.vertices,
            self.triangles,
            self.components.len(),
            if self.components.len() == 1 { "part" } else { "parts" },
            self.euler,
            self.area_mm2,
            self.volume_ml()
        )?;
        let counts = [
            ("open edges", self.open_edges),
            ("non-manifold edges", self.non_manifold_edges),
            ("inconsistent edges", self.inconsistent_edges),
            ("non-manifold vertices", self.non_manifold_vertices),
            ("duplicate triangles", self.duplicate_triangles),
            ("collapsed triangles", self.collapsed_triangles),
            ("flat triangles", self.flat_triangles),
            ("dangling triangles", self.dangling_triangles),
            ("non-finite vertices", self.non_finite_vertices),
            ("unused vertices", self.unused_vertices),
        ];
        let found: Vec<String> =
            counts.iter().filter(|(_, count)| *count > 0).map(|(name, count)| format!("{count} {name}")).collect();
        let verdict = if found.is_empty() { "no defect".to_owned() } else { found.join(", ") };
        write!(
            f,
            "{verdict}; smallest angle {:.3} degrees, {} of {} triangles below {SLIVER_DEG}",
            self.min_angle_deg, self.slivers, self.triangles
        )
    }
}

/// Examines a mesh.
pub fn check(mesh: &TriangleMesh) -> MeshReport {
    let vertices = mesh.positions.len();
    let within = |t: &&[u32; 3]| t.iter().all(|&v| (v as usize) < vertices);
    let whole = |t: &&[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    let named: Vec<[u32; 3]> = mesh.triangles.iter().filter(within).copied().collect();
    let proper: Vec<[u32; 3]> = named.iter().filter(whole).copied().collect();
    let bounds = bounds(&mesh.positions);
    let edges = Edges::new(vertices, &proper);
    let parts = Parts::new(&mesh.positions, &proper, &edges, centre(bounds));
    MeshReport {
        vertices,
        unused_vertices: parts.unused,
        triangles: mesh.triangles.len(),
        dangling_triangles: mesh.triangles.len() - named.len(),
        collapsed_triangles: named.len() - proper.len(),
        flat_triangles: parts.flat,
        duplicate_triangles: duplicates(vertices, &proper),
        open_edges: edges.open,
        non_manifold_edges: edges.non_manifold,
        inconsistent_edges: edges.inconsistent,
        non_manifold_vertices: edges.non_manifold_vertices,
        non_finite_vertices: mesh.positions.iter().filter(|p| !p.iter().all(|c| c.is_finite())).count(),
        euler: parts.components.iter().map(|c| c.euler).sum(),
        area_mm2: parts.components.iter().map(|c| c.area_mm2).sum(),
        volume_mm3: parts.components.iter().map(|c| c.volume_mm3).sum(),
        min_angle_deg: parts.min_angle.to_degrees(),
        slivers: parts.slivers,
        bounds,
        components: parts.components,
    }
}

fn bounds(positions: &[[f32; 3]]) -> Option<[[f32; 3]; 2]> {
    let mut finite = positions.iter().filter(|p| p.iter().all(|c| c.is_finite()));
    let first = *finite.next()?;
    Some(finite.fold([first; 2], |[low, high], p| {
        [[0, 1, 2].map(|axis| low[axis].min(p[axis])), [0, 1, 2].map(|axis| high[axis].max(p[axis]))]
    }))
}

/// Volumes are summed round the middle of the box: far from the origin their terms would cancel.
fn centre(bounds: Option<[[f32; 3]; 2]>) -> [f64; 3] {
    bounds.map_or([0.0; 3], |[low, high]| [0, 1, 2].map(|axis| (f64::from(low[axis]) + f64::from(high[axis])) / 2.0))
}

/// Joins things that belong together; finds a representative in nearly constant time.
struct UnionFind(Vec<u32>);

impl UnionFind {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn find(&mut self, mut at: u32) -> u32 {
        while self.0[at as usize] != at {
            let up = self.0[self.0[at as usize] as usize];
            self.0[at as usize] = up;
            at = up;
        }
        at
    }

    fn join(&mut self, one: u32, two: u32) {
        let (one, two) = (self.find(one), self.find(two));
        self.0[one.max(two) as usize] = one.min(two);
    }
}

/// Items grouped by a vertex: a counting sort.
struct Grouped<T> {
    starts: Vec<u32>,
    items: Vec<T>,
}

impl<T: Copy + Default + Ord> Grouped<T> {
    fn new(vertices: usize, items: impl Iterator<Item = (u32, T)> + Clone) -> Self {
        let mut starts = vec![0_u32; vertices + 1];
        let mut count = 0;
        for (vertex, _) in items.clone() {
            starts[vertex as usize + 1] += 1;
            count += 1;
        }
        for vertex in 0..vertices {
            starts[vertex + 1] += starts[vertex];
        }
        let mut next = starts.clone();
        let mut sorted = vec![T::default(); count];
        for (vertex, item) in items {
            sorted[next[vertex as usize] as usize] = item;
            next[vertex as usize] += 1;
        }
        for pair in starts.windows(2) {
            sorted[pair[0] as usize..pair[1] as usize].sort_unstable();
        }
        Self { starts, items: sorted }
    }

    fn groups(&self) -> impl Iterator<Item = (u32, &[T])> {
        self.starts.windows(2).zip(0..).map(|(pair, vertex)| (vertex, &self.items[pair[0] as usize..pair[1] as usize]))
    }
}

/// What the edges tell.
struct Edges {
    /// Lower vertex of every edge, once per edge.
    lows: Vec<u32>,
    open: usize,
    non_manifold: usize,
    inconsistent: usize,
    non_manifold_vertices: usize,
}

impl Edges {
    fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        // Half-edge 3 t + c runs from corner c of triangle t to the next corner.
        let halves = (0_u32..).zip(triangles).flat_map(|(t, triangle)| {
            (0..3).map(move |c| {
                let (from, to) = (triangle[c], triangle[(c + 1) % 3]);
                (from.min(to), (from.max(to), 3 * t + c as u32))
            })
        });
        let grouped = Grouped::new(vertices, halves);
        let mut edges = Self { lows: Vec::new(), open: 0, non_manifold: 0, inconsistent: 0, non_manifold_vertices: 0 };
        // Corners of one vertex that share an edge belong to one fan.
        let mut fans = UnionFind::new(3 * triangles.len());
        let corner_at = |half: u32, vertex: u32| {
            let (t, c) = (half / 3, half as usize % 3);
            let here = triangles[t as usize][c] == vertex;
            3 * t + if here { c } else { (c + 1) % 3 } as u32
        };
        for (low, group) in grouped.groups() {
            for edge in group.chunk_by(|a, b| a.0 == b.0) {
                let high = edge[0].0;
                let upward = edge.iter().filter(|(_, half)| triangles[*half as usize / 3][*half as usize % 3] == low);
                match (edge.len(), upward.count()) {
                    (1, _) => edges.open += 1,
                    (2, 1) => {}
                    (2, _) => edges.inconsistent += 1,
                    _ => edges.non_manifold += 1,
                }
                for pair in edge.windows(2) {
                    for vertex in [low, high] {
                        fans.join(corner_at(pair[0].1, vertex), corner_at(pair[1].1, vertex));
                    }
                }
                edges.lows.push(low);
            }
        }
        let mut count = vec![0_u8; vertices];
        for corner in 0..3 * triangles.len() as u32 {
            if fans.find(corner) == corner {
                let vertex = triangles[corner as usize / 3][corner as usize % 3] as usize;
                count[vertex] = count[vertex].saturating_add(1);
            }
        }
        edges.non_manifold_vertices = count.iter().filter(|&&fans| fans > 1).count();
        edges
    }
}

fn duplicates(vertices: usize, triangles: &[[u32; 3]]) -> usize {
    let keys = triangles.iter().map(|triangle| {
        let mut key = *triangle;
        key.sort_unstable();
        (key[0], (key[1], key[2]))
    });
    let grouped = Grouped::new(vertices, keys);
    grouped.groups().map(|(_, group)| group.windows(2).filter(|pair| pair[0] == pair[1]).count()).sum()
}

/// Connected parts and the sums over their triangles.
struct Parts {
    components: Vec<ComponentReport>,
    unused: usize,
    flat: usize,
    min_angle: f64,
    slivers: usize,
}

impl Parts {
    fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]], edges: &Edges, centre: [f64; 3]) -> Self {
        let mut joined = UnionFind::new(positions.len());
        let mut used = vec![false; positions.len()];
        for &[a, b, c] in triangles {
            joined.join(a, b);
            joined.join(b, c);
            [a, b, c].iter().for_each(|&v| used[v as usize] = true);
        }
        let empty = ComponentReport { vertices: 0, edges: 0, triangles: 0, euler: 0, area_mm2: 0.0, volume_mm3: 0.0 };
        let mut part_of = vec![u32::MAX; positions.len()];
        let mut components = Vec::new();
        for vertex in (0..positions.len() as u32).filter(|&v| used[v as usize]) {
            // Representatives are the lowest vertices of their parts, so they come first.
            let root = joined.find(vertex) as usize;
            if part_of[root] == u32::MAX {
                part_of[root] = components.len() as u32;
                components.push(empty);
            }
            part_of[vertex as usize] = part_of[root];
            components[part_of[root] as usize].vertices += 1;
        }
        for &low in &edges.lows {
            components[part_of[low as usize] as usize].edges += 1;
        }
        let (mut flat, mut min_angle, mut slivers) = (0, std::f64::consts::PI, 0);
        for triangle in triangles {
            let component = &mut components[part_of[triangle[0] as usize] as usize];
            let places = triangle.map(|v| {
                let place = positions[v as usize];
                nalgebra::Vector3::from([0, 1, 2].map(|axis| f64::from(place[axis]) - centre[axis]))
            });
            let measure = Measure::of(places);
            component.triangles += 1;
            component.area_mm2 += measure.area;
            component.volume_mm3 += measure.volume;
            match measure.angle {
                Some(angle) => {
                    min_angle = min_angle.min(angle);
                    slivers += usize::from(angle < SLIVER_DEG.to_radians());
                }
                None => flat += 1,
            }
        }
        for component in &mut components {
            component.euler = component.vertices as i64 - component.edges as i64 + component.triangles as i64;
        }
        components.sort_by_key(|component| std::cmp::Reverse(component.triangles));
        Self { components, unused: used.iter().filter(|used| !**used).count(), flat, min_angle, slivers }
    }
}

/// A triangle with less of its longest side squared has no area: far below any sliver, far above rounding in f64.
const FLAT: f64 = 1e-10;

struct Measure {
    area: f64,
    volume: f64,
    /// Smallest angle [radians]; `None` when the triangle is flat.
    angle: Option<f64>,
}

impl Measure {
    fn of([a, b, c]: [nalgebra::Vector3<f64>; 3]) -> Self {
        let cross = (b - a).cross(&(c - a));
        let area = cross.norm() / 2.0;
        let sides = [b - c, c - a, a - b];
        let squares = sides.map(|side| side.norm_squared());
        let longest = squares[0].max(squares[1]).max(squares[2]);
        // The smallest angle lies opposite the shortest side, between the other two.
        let shortest = (0..3).fold(0, |best, at| if squares[at] < squares[best] { at } else { best });
        let (one, two) = (sides[(shortest + 1) % 3], sides[(shortest + 2) % 3]);
        let angle = (2.0 * area).atan2(-one.dot(&two));
        // False for NaN too: a triangle without finite corners has no area.
        let has_area = 2.0 * area > FLAT * longest;
        Self { area, volume: a.dot(&cross) / 6.0, angle: has_area.then_some(angle) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> TriangleMesh {
        let positions = (0..8).map(|c| [(c & 1) as f32, (c >> 1 & 1) as f32, (c >> 2) as f32]).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        TriangleMesh { positions, triangles, ..TriangleMesh::default() }
    }

    #[test]
    fn a_cube_passes_and_measures_right() {
        let report = check(&cube());
        assert!(report.passes(), "{report}");
        assert_eq!((report.euler, report.components.len(), report.components[0].edges), (2, 1, 18));
        assert!((report.volume_mm3 - 1.0).abs() < 1e-12 && (report.area_mm2 - 6.0).abs() < 1e-12);
        assert!((report.min_angle_deg - 45.0).abs() < 1e-9 && report.slivers == 0);
        let mut squashed = cube();
        // Of the four upright sides two triangles each have an angle of 2.9 degrees.
        squashed.positions.iter_mut().for_each(|p| p[2] *= 0.05);
        assert_eq!(check(&squashed).slivers, 8);
        assert_eq!(report.bounds, Some([[0.0; 3], [1.0; 3]]));
    }

    #[test]
    fn each_defect_is_counted_and_named() {
        type Damage = (fn(&mut TriangleMesh), fn(&MeshReport) -> usize, usize, &'static str);
        let damages: [Damage; 9] = [
            (|m| _ = m.triangles.pop(), |r| r.open_edges, 3, "3 open edges"),
            (|m| m.triangles[0].swap(0, 1), |r| r.inconsistent_edges, 3, "3 inconsistent edges"),
            (|m| m.triangles.push(m.triangles[0]), |r| r.duplicate_triangles, 1, "1 duplicate"),
            (|m| m.triangles.push(m.triangles[0]), |r| r.non_manifold_edges, 3, "3 non-manifold edges"),
            (|m| m.triangles.push([1, 1, 2]), |r| r.collapsed_triangles, 1, "1 collapsed"),
            (|m| m.triangles.push([1, 2, 8]), |r| r.dangling_triangles, 1, "1 dangling"),
            (|m| m.positions[3][0] = f32::NAN, |r| r.non_finite_vertices, 1, "1 non-finite"),
            (|m| m.positions.push([0.0; 3]), |r| r.unused_vertices, 1, "1 unused"),
            (|m| m.positions[2] = m.positions[3], |r| r.flat_triangles, 2, "2 flat"),
        ];
        for (damage, count, expected, text) in damages {
            let mut mesh = cube();
            damage(&mut mesh);
            let report = check(&mesh);
            assert_eq!(count(&report), expected, "{text}: {report}");
            assert!(report.to_string().contains(text), "{text}: {report}");
            assert_eq!(report.passes(), text.contains("unused"), "{text}");
        }
    }

    #[test]
    fn two_fans_at_one_vertex_are_not_manifold() {
        let mut mesh = cube();
        let other = cube();
        // A second cube that touches the first in its corner 7 alone.
        mesh.positions.extend(other.positions.iter().map(|p| p.map(|c| c + 1.0)));
        mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|v| if v == 0 { 7 } else { v + 8 })));
        let report = check(&mesh);
        assert_eq!((report.non_manifold_vertices, report.non_manifold_edges, report.open_edges), (1, 0, 0));
        assert!(!report.is_manifold() && report.is_closed());
    }

    #[test]
    fn parts_are_counted_and_an_inside_out_mesh_fails() {
        let mut mesh = cube();
        let second = cube();
        mesh.positions.extend(second.positions.iter().map(|p| p.map(|c| 3.0 * c + 1e4)));
        mesh.triangles.extend(second.triangles.iter().map(|t| t.map(|v| v + 8)));
        let report = check(&mesh);
        assert_eq!((report.components.len(), report.euler), (2, 4));
        assert!((report.volume_mm3 - 28.0).abs() < 1e-3, "{}", report.volume_mm3);
        mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert!(check(&mesh).is_oriented() && !check(&mesh).passes());
        assert!(!check(&TriangleMesh::default()).passes());
    }
}
