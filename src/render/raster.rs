//! Which triangle is seen at each sample of the picture.
//!
//! ```text
//! for each run of triangles:  list the tiles each one touches
//! for each band of tiles, for each tile:
//!     for each organ, for each of its triangles in the tile:
//!         for each pixel, for each sample inside all three edges:  keep the nearest; count walls along the ray
//!         where more walls were left than entered behind the clip plane:  the section is seen
//!     for each pixel:  colour of each triangle seen in it, once, by the number of its samples
//! ```
//! Corners lie on a grid of 1/256 pixel and edges are whole numbers, with the top-left rule, so a sample on an edge shared
//! by two triangles belongs to exactly one of them. Of two triangles at the same depth the earlier one is seen.

use rayon::prelude::*;

use super::Lines;
use super::camera::{Camera, ViewPlane};
use super::drawing::{Corner, Drawing, Part, SUBPIXELS};
use super::light::Shader;

/// Edge of a tile [px]: its samples, 64 KiB, stay in the second-level cache.
const TILE: usize = 32;
/// Triangles that are put into bins together.
const RUN: usize = 1 << 14;
/// A triangle in more tiles than this is offered to all of them, so that bins stay short.
const MOST_TILES: i64 = 64;
/// Samples of a pixel.
pub(super) const SAMPLES: usize = 8;
/// Their places from the middle of the pixel [1/16 px]: no two in a row, column or diagonal, as graphics cards have it
/// (Direct3D 11.3 specification, 19.2.4.1).
const PATTERN: [[i32; 2]; SAMPLES] = [[1, -3], [-1, 3], [5, 1], [-3, -5], [-5, 5], [-7, -1], [3, 7], [7, -7]];
const PATTERN_STEP: i32 = SUBPIXELS / 16;
/// Reach of the pattern from the middle of a pixel [1/256 px].
const REACH: i64 = 7 * PATTERN_STEP as i64;

/// Nothing is seen.
const NOTHING: u32 = u32::MAX;
/// From here on numbers are those of sections, by part.
const SECTION: u32 = 1 << 31;

/// A pixel of the picture before background and tone.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Pixel {
    /// Linear RGB times coverage.
    pub(super) color: [f32; 3],
    /// Share of samples that see something.
    pub(super) coverage: f32,
    /// Of the triangle seen in most samples, along right, up and back.
    pub(super) normal: [f32; 3],
    /// Of that triangle, in the middle of its samples.
    pub(super) nearness: f32,
    /// Number of the section plus 1, if one is seen; 0 elsewhere.
    pub(super) section: u16,
    /// Samples that see the section.
    pub(super) section_samples: u16,
}

/// Draws everything. One pixel per pixel of the picture, row by row.
pub(super) fn draw(drawing: &Drawing, camera: &Camera, plane: Option<&ViewPlane>, lines: Lines) -> Vec<Pixel> {
    let [width, height] = camera.size().map(|side| side as usize);
    let grid = [width.div_ceil(TILE), height.div_ceil(TILE)];
    let bins = bins(drawing, [width, height], grid);
    let shader = Shader::new(drawing, camera, plane, lines);
    let mut pixels = vec![Pixel::default(); width * height];
    pixels.par_chunks_mut(TILE * width).enumerate().for_each(|(row, band)| {
        let mut tile = Tile::new(plane.is_some());
        let rows = band.len() / width;
        for column in 0..grid[0] {
            let columns = TILE.min(width - column * TILE);
            tile.begin([(column * TILE) as i32, (row * TILE) as i32], [columns as i32, rows as i32]);
            match plane {
                None => tile.fill::<false>(drawing, &bins, (row * grid[0] + column) as u32, camera, None),
                Some(plane) => tile.fill::<true>(drawing, &bins, (row * grid[0] + column) as u32, camera, Some(plane)),
            }
            tile.shade(&shader, &mut band[column * TILE..], width);
        }
    });
    pixels
}

/// A run of triangles of one part, sorted into tiles.
struct Bin {
    part: usize,
    /// Tile and triangle, ascending.
    entries: Vec<(u32, u32)>,
    /// Triangles that may touch any tile, ascending.
    everywhere: Vec<u32>,
}

fn bins(drawing: &Drawing, size: [usize; 2], grid: [usize; 2]) -> Vec<Bin> {
    let ends = drawing.parts.iter().skip(1).map(|part| part.first).chain([drawing.triangles.len()]);
    let runs: Vec<(usize, usize, usize)> = drawing
        .parts
        .iter()
        .zip(ends)
        .enumerate()
        .flat_map(|(part, (Part { first, .. }, end))| {
            (*first..end).step_by(RUN).map(move |from| (part, from, (from + RUN).min(end)))
        })
        .collect();
    runs.into_par_iter()
        .map(|(part, from, to)| {
            let mut bin = Bin { part, entries: Vec::new(), everywhere: Vec::new() };
            for triangle in from..to {
                let corners = drawing.triangles[triangle].map(|corner| drawing.corners[corner as usize]);
                let Some([low, high]) = pixel_box(&corners, size) else { continue };
                let (low, high) = (low.map(|x| x / TILE as i64), high.map(|x| x / TILE as i64));
                if (high[0] - low[0] + 1) * (high[1] - low[1] + 1) > MOST_TILES {
                    bin.everywhere.push(triangle as u32);
                    continue;
                }
                for row in low[1]..=high[1] {
                    for column in low[0]..=high[0] {
                        bin.entries.push(((row * grid[0] as i64 + column) as u32, triangle as u32));
                    }
                }
            }
            bin.entries.sort_unstable();
            bin
        })
        .collect()
}

/// First and last pixel, along x and y, that a triangle may have samples in; `None` when it has none on the picture.
fn pixel_box(corners: &[Corner; 3], size: [usize; 2]) -> Option<[[i64; 2]; 2]> {
    if corners.iter().any(|corner| corner.x == Corner::OUTSIDE) {
        return None;
    }
    let along = |at: [i32; 3], side: usize| {
        let middle = i64::from(SUBPIXELS / 2);
        let low = at.into_iter().min().map_or(0, i64::from);
        let high = at.into_iter().max().map_or(0, i64::from);
        // The outermost samples of pixel p lie at 256 p + 128 -+ REACH.
        let first = (low - middle - REACH).div_euclid(i64::from(SUBPIXELS)).max(0);
        let last = (high - middle + REACH).div_euclid(i64::from(SUBPIXELS)).min(side as i64 - 1);
        [first, last]
    };
    let x = along(corners.map(|corner| corner.x), size[0]);
    let y = along(corners.map(|corner| corner.y), size[1]);
    (x[0] <= x[1] && y[0] <= y[1]).then_some([[x[0], y[0]], [x[1], y[1]]])
}

/// What is seen in one tile.
struct Tile {
    origin: [i32; 2],
    size: [i32; 2],
    /// Of what is seen at each sample; shape `[TILE * TILE][SAMPLES]`, as the next two.
    nearness: Vec<[f32; SAMPLES]>,
    seen: Vec<[u32; SAMPLES]>,
    /// Along each sample's ray, walls left minus walls entered: behind the clip plane, and in all.
    walls: Vec<[[i16; 2]; SAMPLES]>,
}

impl Tile {
    fn new(clipped: bool) -> Self {
        let pixels = TILE * TILE;
        Self {
            origin: [0; 2],
            size: [0; 2],
            nearness: vec![[0.0; SAMPLES]; pixels],
            seen: vec![[NOTHING; SAMPLES]; pixels],
            walls: vec![[[0; 2]; SAMPLES]; if clipped { pixels } else { 0 }],
        }
    }

    fn begin(&mut self, origin: [i32; 2], size: [i32; 2]) {
        (self.origin, self.size) = (origin, size);
        self.nearness.fill([f32::NEG_INFINITY; SAMPLES]);
        self.seen.fill([NOTHING; SAMPLES]);
        self.walls.fill([[0; 2]; SAMPLES]);
    }

    fn fill<const CLIP: bool>(
        &mut self,
        drawing: &Drawing,
        bins: &[Bin],
        number: u32,
        camera: &Camera,
        plane: Option<&ViewPlane>,
    ) {
        let mut part = None;
        for bin in bins {
            let first = bin.entries.partition_point(|entry| entry.0 < number);
            let own = bin.entries[first..].iter().take_while(|entry| entry.0 == number).map(|entry| entry.1);
            let mut touched = false;
            for triangle in own.chain(bin.everywhere.iter().copied()) {
                if CLIP && !touched && part != Some(bin.part) {
                    self.close_sections(part.replace(bin.part), camera, plane);
                }
                touched = true;
                let corners = drawing.triangles[triangle as usize].map(|corner| drawing.corners[corner as usize]);
                self.add::<CLIP>(triangle, &corners);
            }
        }
        if CLIP {
            self.close_sections(part, camera, plane);
        }
    }

    fn add<const CLIP: bool>(&mut self, number: u32, corners: &[Corner; 3]) {
        let Some(triangle) = Triangle::new::<CLIP>(corners) else { return };
        let limits = [(self.origin[0] + self.size[0]) as usize, (self.origin[1] + self.size[1]) as usize];
        let Some([low, high]) = pixel_box(corners, limits) else { return };
        let first = [0, 1].map(|axis| low[axis].max(i64::from(self.origin[axis])));
        let middle = |pixel: i64| pixel * i64::from(SUBPIXELS) + i64::from(SUBPIXELS / 2);
        for y in first[1]..=high[1] {
            let mut edges = triangle.edges.map(|edge| edge.at([middle(first[0]), middle(y)]));
            let row = (y - i64::from(self.origin[1])) as usize * TILE;
            for x in first[0]..=high[0] {
                let inside = triangle.samples(edges);
                if inside != 0 {
                    let place = row + (x - i64::from(self.origin[0])) as usize;
                    let from = [middle(x), middle(y)].map(|at| at as f64);
                    let nearness = triangle.nearness.at(from);
                    let beyond = triangle.beyond.as_ref().map(|beyond| (beyond.at(from), &beyond.steps));
                    for sample in (0..SAMPLES).filter(|sample| inside >> sample & 1 == 1) {
                        if let (true, Some((beyond, steps))) = (CLIP, beyond) {
                            let walls = &mut self.walls[place][sample];
                            walls[1] += triangle.turn;
                            if beyond + steps[sample] > 0.0 {
                                continue;
                            }
                            walls[0] += triangle.turn;
                        }
                        let nearness = triangle.nearness.clamped(nearness + triangle.nearness.steps[sample]);
                        if nearness > self.nearness[place][sample] {
                            self.nearness[place][sample] = nearness;
                            self.seen[place][sample] = number;
                        }
                    }
                }
                for (edge, value) in triangle.edges.iter().zip(&mut edges) {
                    *value += edge.across[0] * i64::from(SUBPIXELS);
                }
            }
        }
    }

    /// Fills the section of a part whose triangles have all been added. What is behind the plane starts inside the part
    /// where more walls are left than entered from there on; a ray that does not leave as often as it enters in all goes
    /// through a hole, and shows no section.
    fn close_sections(&mut self, part: Option<usize>, camera: &Camera, plane: Option<&ViewPlane>) {
        let (Some(part), Some(plane)) = (part, plane) else { return };
        if plane.faces_eye() {
            for y in 0..self.size[1] {
                for x in 0..self.size[0] {
                    let place = (y as usize) * TILE + x as usize;
                    for sample in 0..SAMPLES {
                        let [behind, all] = self.walls[place][sample];
                        if behind <= 0 || all != 0 {
                            continue;
                        }
                        let offset = PATTERN[sample].map(|at| f64::from(at) / 16.0 + 0.5);
                        let [x, y] =
                            [f64::from(self.origin[0] + x) + offset[0], f64::from(self.origin[1] + y) + offset[1]];
                        let nearness = plane.nearness(camera.ray(x, y)) as f32;
                        if nearness > self.nearness[place][sample] {
                            self.nearness[place][sample] = nearness;
                            self.seen[place][sample] = SECTION | part as u32;
                        }
                    }
                }
            }
        }
        self.walls.fill([[0; 2]; SAMPLES]);
    }

    /// Colours the tile's pixels: every triangle seen in a pixel once, in the middle of its samples.
    fn shade(&self, shader: &Shader<'_>, band: &mut [Pixel], width: usize) {
        for y in 0..self.size[1] as usize {
            for x in 0..self.size[0] as usize {
                let seen = &self.seen[y * TILE + x];
                if *seen == [NOTHING; SAMPLES] {
                    continue;
                }
                let middle = [self.origin[0] + x as i32, self.origin[1] + y as i32].map(|at| at as f32 + 0.5);
                let pixel = &mut band[y * width + x];
                let (mut done, mut most) = (0_u32, 0);
                for first in 0..SAMPLES {
                    let number = seen[first];
                    if done >> first & 1 == 1 || number == NOTHING {
                        continue;
                    }
                    let (mut count, mut sum) = (0, [0_i32; 2]);
                    for sample in (first..SAMPLES).filter(|&sample| seen[sample] == number) {
                        done |= 1 << sample;
                        count += 1;
                        sum = [0, 1].map(|axis| sum[axis] + PATTERN[sample][axis]);
                    }
                    let at = [0, 1].map(|axis| middle[axis] + sum[axis] as f32 / (16 * count) as f32);
                    let point = match number & SECTION {
                        0 => shader.triangle(number as usize, at),
                        _ => shader.section((number & !SECTION) as usize, at),
                    };
                    let share = count as f32 / SAMPLES as f32;
                    pixel.coverage += share;
                    (0..3).for_each(|c| pixel.color[c] += share * point.color[c]);
                    if count > most {
                        most = count;
                        (pixel.normal, pixel.nearness) = (point.normal, point.nearness);
                    }
                    if number & SECTION != 0 && count as u16 > pixel.section_samples {
                        pixel.section = (number & !SECTION) as u16 + 1;
                        pixel.section_samples = count as u16;
                    }
                }
            }
        }
    }
}

/// A directed edge: not negative on its inner side.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// Change per 1/256 px along x and y.
    across: [i64; 2],
    from: [i64; 2],
    /// -1 where the edge itself belongs to the neighbour: all but top and left edges.
    bias: i64,
    /// Change from the middle of a pixel to its samples.
    steps: [i64; SAMPLES],
    /// Smallest and largest of them.
    range: [i64; 2],
}

impl Edge {
    #[inline]
    fn new(from: [i64; 2], to: [i64; 2]) -> Self {
        let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
        let top_or_left = dy < 0 || (dy == 0 && dx > 0);
        let across = [-dy, dx];
        let steps =
            PATTERN.map(|[x, y]| (across[0] * i64::from(x) + across[1] * i64::from(y)) * i64::from(PATTERN_STEP));
        let range = steps.iter().fold([0, 0], |[low, high], &step| [step.min(low), step.max(high)]);
        Self { across, from, bias: if top_or_left { 0 } else { -1 }, steps, range }
    }

    fn at(&self, place: [i64; 2]) -> i64 {
        (0..2).map(|axis| self.across[axis] * (place[axis] - self.from[axis])).sum::<i64>() + self.bias
    }
}

/// A quantity that is linear on the picture.
#[derive(Debug, Clone, Copy)]
struct Slope {
    from: [f64; 2],
    value: f64,
    across: [f64; 2],
    range: [f32; 2],
    steps: [f32; SAMPLES],
}

impl Slope {
    #[inline]
    fn new(places: [[i64; 2]; 3], values: [f32; 3], area: i64) -> Self {
        let [[ax, ay], [bx, by], [cx, cy]] = places.map(|place| place.map(|x| x as f64));
        let [a, b, c] = values.map(f64::from);
        let area = area as f64;
        let across =
            [((b - a) * (cy - ay) - (c - a) * (by - ay)) / area, ((c - a) * (bx - ax) - (b - a) * (cx - ax)) / area];
        let step = f64::from(PATTERN_STEP);
        let steps = PATTERN.map(|[x, y]| ((across[0] * f64::from(x) + across[1] * f64::from(y)) * step) as f32);
        let range = values.iter().fold([values[0]; 2], |[low, high], &value| [value.min(low), value.max(high)]);
        Self { from: [ax, ay], value: a, across, range, steps }
    }

    fn at(&self, place: [f64; 2]) -> f32 {
        (self.value + self.across[0] * (place[0] - self.from[0]) + self.across[1] * (place[1] - self.from[1])) as f32
    }

    /// Slivers seen from their edge have no slope to speak of.
    fn clamped(&self, value: f32) -> f32 {
        value.clamp(self.range[0], self.range[1])
    }
}

/// A triangle ready to be filled.
struct Triangle {
    edges: [Edge; 3],
    nearness: Slope,
    /// With a clip plane.
    beyond: Option<Slope>,
    /// 1 for a back face (a ray leaves there), -1 for a front face.
    turn: i16,
}

impl Triangle {
    /// `None` when it covers no area.
    fn new<const CLIP: bool>(corners: &[Corner; 3]) -> Option<Self> {
        let mut corners = *corners;
        let place = |corner: &Corner| [i64::from(corner.x), i64::from(corner.y)];
        let area = twice_area(corners.each_ref().map(place));
        if area == 0 {
            return None;
        }
        // Rows of the picture run downwards, so a front face, counter-clockwise to the eye, has a negative area.
        let front = area < 0;
        if front {
            corners.swap(1, 2);
        }
        let [a, b, c] = corners.each_ref().map(place);
        Some(Self {
            edges: [Edge::new(a, b), Edge::new(b, c), Edge::new(c, a)],
            nearness: Slope::new([a, b, c], corners.map(|corner| corner.nearness), area.abs()),
            beyond: CLIP.then(|| Slope::new([a, b, c], corners.map(|corner| corner.beyond), area.abs())),
            turn: if front { -1 } else { 1 },
        })
    }

    /// One bit per sample inside all edges, from their values in the middle of a pixel.
    #[inline]
    fn samples(&self, middle: [i64; 3]) -> u32 {
        let reach = |edge: usize, end: usize| middle[edge] + self.edges[edge].range[end];
        if (0..3).any(|edge| reach(edge, 1) < 0) {
            return 0;
        }
        if (0..3).all(|edge| reach(edge, 0) >= 0) {
            return (1 << SAMPLES) - 1;
        }
        (0..SAMPLES).fold(0, |bits, sample| {
            let outside = (0..3).fold(0, |sign, edge| sign | (middle[edge] + self.edges[edge].steps[sample]));
            bits | u32::from(outside >= 0) << sample
        })
    }
}

/// Twice the area of a triangle on the picture [1/256 px, squared]; negative when it is seen from its front.
pub(super) fn twice_area([a, b, c]: [[i64; 2]; 3]) -> i64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(x: i32, y: i32) -> Corner {
        Corner { x, y, nearness: 1.0, beyond: 0.0 }
    }

    /// Samples of a square of pixels that triangles cover, counted.
    fn count(triangles: &[[[i32; 2]; 3]]) -> Vec<u32> {
        let mut counts = vec![0; TILE * TILE * SAMPLES];
        for places in triangles {
            let mut tile = Tile::new(false);
            tile.begin([0, 0], [TILE as i32; 2]);
            tile.add::<false>(0, &places.map(|[x, y]| corner(x, y)));
            for (count, seen) in counts.iter_mut().zip(tile.seen.iter().flatten()) {
                *count += u32::from(*seen == 0);
            }
        }
        counts
    }

    #[test]
    fn samples_on_shared_edges_are_covered_once() {
        // A fan round a sample's own place, and two triangles of a square whose diagonal goes through samples.
        let side = TILE as i32 * SUBPIXELS;
        let (x, y) = (10 * SUBPIXELS + 128 + PATTERN_STEP, 12 * SUBPIXELS + 128 - 3 * PATTERN_STEP);
        let rim = [[0, 0], [x, 0], [side, 0], [side, y], [side, side], [x, side], [0, side], [0, y]];
        for turned in [false, true] {
            let fan: Vec<_> = (0..8)
                .map(|i| {
                    let (a, b) = (rim[i], rim[(i + 1) % 8]);
                    if turned { [[x, y], b, a] } else { [[x, y], a, b] }
                })
                .collect();
            assert!(count(&fan).iter().all(|&count| count == 1));
        }
        let halves = [[[0, 0], [side, 0], [side, side]], [[0, 0], [side, side], [0, side]]];
        assert!(count(&halves).iter().all(|&count| count == 1));
    }

    #[test]
    fn coverage_is_the_area() {
        // A triangle of 8 x 16 / 2 pixels: eight samples each, to within those along its edges.
        let places = [[1024 + 3, 1024 + 7], [1024 + 8 * 256 + 3, 1024 + 7], [1024 + 3, 1024 + 16 * 256 + 7]];
        let covered: u32 = count(&[places]).iter().sum();
        assert!((i64::from(covered) - 8 * 64).abs() < 16, "{covered}");
        assert_eq!(twice_area(places.map(|p| p.map(i64::from))), 2 * 64 * 256 * 256);
    }

    #[test]
    fn the_nearer_triangle_is_seen_in_any_order() {
        let near = [[0, 0], [4096, 0], [0, 4096]].map(|[x, y]| Corner { nearness: 2.0, ..corner(x, y) });
        let far = [[0, 0], [4096, 0], [0, 4096]].map(|[x, y]| Corner { nearness: 1.0, ..corner(x, y) });
        for order in [[0, 1], [1, 0]] {
            let mut tile = Tile::new(false);
            tile.begin([0, 0], [TILE as i32; 2]);
            order.iter().for_each(|&number| tile.add::<false>(number, [&near, &far][number as usize]));
            assert_eq!(tile.seen[0], [0; SAMPLES]);
        }
    }
}
