//! Kidneys, spleen, stomach, pancreas, bowel and the great vessels.

use super::noise::{Lumps, Stream};
use super::sdf::{FAR, capsule, ellipse, ellipsoid, smooth_max, smooth_min};
use super::torso;
use crate::geometry::{Point3, Vector3};

/// Gas collects above this height in a patient who lies on the back: the level in the stomach [mm].
const STOMACH_LEVEL: f64 = 52.0;

/// One kidney.
pub(super) struct Kidney {
    center: Point3,
    /// +1 for the right kidney, -1 for the left.
    side: f64,
    radii: [f64; 3],
    /// Lean of the long axis away from the spine at the lower pole [rad].
    lean: f64,
    /// Pyramids of the medulla, in the kidney's own frame.
    pyramids: Vec<Vector3>,
}

/// Distances to the parts of a kidney.
pub(super) struct KidneyParts {
    /// Fat of the sinus, open towards the spine.
    pub(super) sinus: f64,
    /// Pyramids.
    pub(super) medulla: f64,
    /// The whole kidney, sinus included.
    pub(super) outer: f64,
}

impl Kidney {
    pub(super) fn new(seed: u64, right: bool) -> Self {
        let mut stream = Stream::new(seed, if right { 2 } else { 3 });
        let size = stream.between(0.95, 1.05);
        let (side, z) = if right { (1.0, -24.0) } else { (-1.0, -15.0) };
        // Three rows of pyramids around the sinus, none where the sinus opens.
        let pyramids = [-22.0, 0.0, 22.0]
            .into_iter()
            .flat_map(|row| (0..5).map(move |turn| (row, f64::from(turn) * 1.0 - 2.0)))
            .map(|(row, turn): (f64, f64)| {
                let turn = turn + stream.between(-0.12, 0.12);
                let narrow = (1.0 - (row / 46.0).powi(2)).sqrt();
                Vector3::new(12.5 * narrow * turn.cos(), 12.0 * narrow * turn.sin(), row + stream.between(-2.0, 2.0))
            })
            .chain([Vector3::new(0.0, 0.0, 35.0), Vector3::new(0.0, 0.0, -35.0)])
            .collect();
        let radii = [26.0 * size, 24.0 * size, 48.0 * size];
        Self { center: Point3::new(69.0 * side, -35.0, z), side, radii, lean: 0.17, pyramids }
    }

    /// The kidney's own frame: x away from the spine, y forwards, z along its long axis.
    fn own(&self, p: Point3) -> Vector3 {
        let from = p - self.center;
        let (sin, cos) = self.lean.sin_cos();
        let out = from.x * self.side;
        // The lower pole leans outwards, and the hilum looks a little forwards.
        let (x, z) = (cos * out + sin * from.z, cos * from.z - sin * out);
        let (s, c) = 0.35_f64.sin_cos();
        Vector3::new(c * x - s * from.y, s * x + c * from.y, z)
    }

    /// Distance to the bean without its inside, for neighbours that give way to it.
    pub(super) fn outer(&self, p: Point3) -> f64 {
        if (p - self.center).norm_squared() > 90.0 * 90.0 {
            return FAR;
        }
        let q = self.own(p);
        let hilum = ellipsoid(q + Vector3::new(30.0, 0.0, 0.0), [13.0, 12.0, 17.0]);
        smooth_max(ellipsoid(q, self.radii), -hilum, 8.0)
    }

    pub(super) fn parts(&self, p: Point3) -> KidneyParts {
        let outer = self.outer(p);
        if outer > 20.0 {
            return KidneyParts { sinus: FAR, medulla: FAR, outer: FAR };
        }
        let q = self.own(p);
        let sinus = ellipsoid(q + Vector3::new(10.0, 0.0, 0.0), [17.0, 6.5, 25.0]);
        let pyramids = self.pyramids.iter().map(|pyramid| (q - pyramid).norm() - 6.2).fold(FAR, f64::min);
        KidneyParts { sinus: sinus.max(outer - 2.0), medulla: smooth_max(pyramids, outer + 5.0, 2.0), outer }
    }
}

/// Aorta (left of the midline) and inferior vena cava (right), in front of the spine.
pub(super) fn great_vessels(p: Point3) -> [f64; 2] {
    let end = p.z.abs() - torso::CONTENT_HEIGHT + 1.0;
    let front = 0.0006 * p.z * p.z;
    let aorta = ellipse(p.x + 9.0, p.y + 10.0 - front, 9.5, 9.5);
    // The vena cava turns forwards and to the right on its way up to the liver.
    let up = ((p.z + 20.0) / 60.0).clamp(0.0, 1.0);
    let cava = ellipse(p.x - 17.0 - 5.0 * up, p.y + 9.0 - 6.0 * up, 12.0, 9.0);
    [smooth_max(aorta, end, 2.0), smooth_max(cava, end, 2.0)]
}

/// Distance to the heart, which rests on the diaphragm and is cut by the top of the section.
pub(super) fn heart(p: Point3, cavity: f64) -> f64 {
    if p.z < 40.0 {
        return FAR;
    }
    let q = p - Point3::new(-18.0, 34.0, 92.0);
    let shape = ellipsoid(Vector3::new(0.9 * q.x - 0.4 * q.y, 0.4 * q.x + 0.9 * q.y, q.z), [58.0, 38.0, 36.0]);
    smooth_max(smooth_max(shape, cavity + 4.0, 6.0), p.z - torso::CONTENT_HEIGHT + 1.0, 3.0)
}

/// Where the fat behind the right kidney keeps the liver away.
pub(super) fn renal_bed(p: Point3) -> f64 {
    ellipsoid(p - Point3::new(66.0, -62.0, -28.0), [36.0, 44.0, 44.0])
}

/// Distance to the spleen, under the left dome.
pub(super) fn spleen(p: Point3, cavity: f64, kidney_left: f64) -> f64 {
    let q = p - Point3::new(-99.0, -22.0, 22.0);
    let (s, c) = 0.45_f64.sin_cos();
    let turned = Vector3::new(c * q.x + s * q.y, -s * q.x + c * q.y, q.z);
    let shape = smooth_max(
        ellipsoid(turned, [25.0, 48.0, 40.0]),
        -(ellipsoid(turned - Vector3::new(34.0, 4.0, -4.0), [22.0, 30.0, 30.0])),
        10.0,
    );
    smooth_max(smooth_max(shape, 4.0 - kidney_left, 5.0), cavity + 3.0, 6.0)
}

/// Distance to the pancreas, a lobulated band from the duodenum across to the spleen.
pub(super) fn pancreas(p: Point3, lumps: &Lumps) -> f64 {
    if p.z < -50.0 || p.z > 25.0 || p.y < -20.0 || p.y > 50.0 {
        return FAR;
    }
    let way = [[34.0, 16.0, -30.0], [12.0, 22.0, -18.0], [-14.0, 18.0, -10.0], [-44.0, 2.0, -4.0], [-66.0, -8.0, 4.0]];
    let girth = [11.0, 8.0, 8.5, 8.0, 6.0];
    let band = (0..4)
        .map(|at| capsule(p, Point3::from(way[at]), Point3::from(way[at + 1]), girth[at], girth[at + 1]))
        .fold(FAR, |a, b| smooth_min(a, b, 4.0));
    band + 0.6 * lumps.at(p)
}

/// A hollow organ: distances to its gas, to gas and content together, and to the outside of its wall.
pub(super) struct Hollow {
    pub(super) gas: f64,
    pub(super) content: f64,
    pub(super) outer: f64,
}

impl Hollow {
    /// Wall of the given thickness around a content whose gas lies above `level`.
    fn new(outer: f64, y: f64, wall: f64, level: f64) -> Self {
        let content = outer + wall;
        Self { gas: content.max(level - y), content, outer }
    }

    /// The union with another one.
    fn union(self, other: Self) -> Self {
        Self {
            gas: self.gas.min(other.gas),
            content: self.content.min(other.content),
            outer: self.outer.min(other.outer),
        }
    }
}

/// The stomach, with its air-fluid level; it gives way to `clear`.
pub(super) fn stomach(p: Point3, cavity: f64, clear: f64) -> Hollow {
    if p.x > 40.0 || p.z < -60.0 {
        return Hollow { gas: FAR, content: FAR, outer: FAR };
    }
    let fundus = ellipsoid(p - Point3::new(-62.0, 22.0, 16.0), [36.0, 40.0, 40.0]);
    let antrum = capsule(p, Point3::new(-52.0, 44.0, -10.0), Point3::new(4.0, 52.0, -30.0), 22.0, 13.0);
    let shape = smooth_max(smooth_min(fundus, antrum, 14.0), cavity + 4.0, 6.0);
    Hollow::new(smooth_max(shape, 3.0 - clear, 6.0), p.y, 3.5, STOMACH_LEVEL)
}

/// Places tried for the loops of the small bowel.
const ATTEMPTS: u32 = 10_000;

/// A loop of bowel.
struct Loop {
    ends: [Point3; 2],
    radius: f64,
    /// Centre and half length, to skip the loop from afar.
    center: Point3,
    half: f64,
    /// Gas above this height [mm].
    level: f64,
}

impl Loop {
    fn new(ends: [Point3; 2], radius: f64, level: f64) -> Self {
        let half = 0.5 * (ends[1] - ends[0]).norm();
        Self { ends, radius, center: nalgebra::center(&ends[0], &ends[1]), half, level }
    }

    /// Distance to the loop, or [`FAR`] when it is more than `reach` away.
    fn distance(&self, p: Point3, reach: f64) -> f64 {
        if (p - self.center).norm_squared() > (self.half + self.radius + reach).powi(2) {
            return FAR;
        }
        capsule(p, self.ends[0], self.ends[1], self.radius, self.radius)
    }
}

/// The colon's frame and the loops of the small bowel in front of the spine.
pub(super) struct Bowel {
    loops: Vec<Loop>,
}

impl Bowel {
    /// Packs loops where `free(place, room)` says that every other organ and the wall are farther away than `room`.
    pub(super) fn new(seed: u64, free: impl Fn(Point3, f64) -> bool) -> Self {
        let mut stream = Stream::new(seed, 4);
        let mut loops: Vec<Loop> = Vec::new();
        let colon: [&[[f64; 3]]; 2] = [
            &[[-112.0, -8.0, 2.0], [-115.0, -6.0, -25.0], [-112.0, -2.0, -50.0], [-108.0, 2.0, -68.0]],
            &[
                [108.0, 10.0, -66.0],
                [98.0, 42.0, -62.0],
                [58.0, 62.0, -62.0],
                [16.0, 70.0, -54.0],
                [-30.0, 70.0, -50.0],
                [-74.0, 56.0, -42.0],
            ],
        ];
        for way in colon {
            for pair in way.windows(2) {
                let ends = [Point3::from(pair[0]), Point3::from(pair[1])];
                let radius = stream.between(13.0, 15.0);
                let level = 0.5 * (ends[0].y + ends[1].y) + stream.between(-2.0, 8.0);
                loops.push(Loop::new(ends, radius, level));
            }
        }
        // Random sequential packing: big loops first, then ever smaller ones into what is left.
        for attempt in 0..ATTEMPTS {
            let radius = 14.5 - 8.5 * f64::from(attempt) / f64::from(ATTEMPTS);
            let place =
                Point3::new(stream.between(-110.0, 112.0), stream.between(-35.0, 74.0), stream.between(-68.0, 20.0));
            let along = stream.direction() * stream.between(2.0, 12.0);
            let ends = [place - along, place + along];
            let gas = stream.between(0.0, 1.0) < 0.22;
            let fits =
                |p: Point3| loops.iter().all(|l| l.distance(p, radius + 2.0) > radius + 0.5) && free(p, radius + 1.0);
            let height = ends[0].z.abs().max(ends[1].z.abs());
            if height < 72.0 - radius && fits(place) && fits(ends[0]) && fits(ends[1]) {
                let level = if gas { place.y + 0.3 * radius } else { FAR };
                loops.push(Loop::new(ends, radius, level));
            }
        }
        Self { loops }
    }

    /// Distances at a place; the bowel gives way to `clear`.
    pub(super) fn at(&self, p: Point3, cavity: f64, clear: f64) -> Hollow {
        let mut all = Hollow { gas: FAR, content: FAR, outer: FAR };
        if cavity > 4.0 || p.z > 42.0 || clear < -4.0 {
            return all;
        }
        for one in &self.loops {
            let near = one.distance(p, 8.0);
            if near < 8.0 {
                let outer = smooth_max(smooth_max(near, cavity + 2.0, 4.0), 1.5 - clear, 4.0);
                all = all.union(Hollow::new(outer, p.y, 2.0, one.level));
            }
        }
        all
    }
}
