//! From patient space to the picture: named views, framing, projection.
//!
//! View axes are right, up and back (towards the eye), right-handed. Inside the renderer lengths are in units of the
//! framed half extent, so that places anywhere in patient space keep their accuracy in f32.

use super::RenderError;
use crate::geometry::{Point3, Vector3};
use crate::surface::mesh::OrganMesh;

/// Angle of view across the shorter side of the picture: about that of a portrait lens.
const FIELD_OF_VIEW_DEGREES: f64 = 22.0;
/// Share of the picture that what is framed may fill.
const FILLED: f64 = 0.88;
/// Least way from the eye to what is framed [half extents of what is framed].
const LEAST_GAP: f64 = 0.5;
/// Zooms that projection keeps its accuracy for.
const ZOOMS: std::ops::RangeInclusive<f64> = 0.02..=50.0;
/// Sides of a picture [px].
const SIDES: std::ops::RangeInclusive<u32> = 16..=8192;
/// Most pixels of a picture: 7680 x 4320. Each needs 36 bytes while it is drawn.
const MOST_PIXELS: u64 = 7680 * 4320;

/// Where the eye looks from: angles round the patient [degrees].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// 0 looks from the front, 90 from the patient's left, 180 from behind, -90 from the right.
    pub azimuth: f64,
    /// 90 looks down from the head, -90 up from the feet.
    pub elevation: f64,
}

impl Direction {
    /// From the front: the patient's right is on the left of the picture.
    pub const ANTERIOR: Self = Self { azimuth: 0.0, elevation: 0.0 };
    /// From behind.
    pub const POSTERIOR: Self = Self { azimuth: 180.0, elevation: 0.0 };
    /// From the patient's left: the front is on the left of the picture.
    pub const LEFT: Self = Self { azimuth: 90.0, elevation: 0.0 };
    /// From the patient's right.
    pub const RIGHT: Self = Self { azimuth: -90.0, elevation: 0.0 };
    /// From the head, with the front up.
    pub const SUPERIOR: Self = Self { azimuth: 180.0, elevation: 90.0 };
    /// From the feet, with the front up, as axial slices are shown.
    pub const INFERIOR: Self = Self { azimuth: 0.0, elevation: -90.0 };
    /// From the front, a little from the right and above.
    pub const THREE_QUARTER: Self = Self { azimuth: -35.0, elevation: 22.0 };
    /// The same from the left.
    pub const THREE_QUARTER_LEFT: Self = Self { azimuth: 35.0, elevation: 22.0 };
    /// From the front, a little from the right and below: the underside of the liver.
    pub const THREE_QUARTER_BELOW: Self = Self { azimuth: -25.0, elevation: -35.0 };

    /// Right, up and back in patient axes (RAS+), unit vectors.
    fn axes(self) -> [Vector3; 3] {
        let (sin_a, cos_a) = turned(self.azimuth);
        let (sin_e, cos_e) = turned(self.elevation);
        let back = Vector3::new(-sin_a * cos_e, cos_a * cos_e, sin_e);
        let up = Vector3::new(sin_a * sin_e, -cos_a * sin_e, cos_e);
        [up.cross(&back), up, back]
    }
}

/// Sine and cosine of an angle [degrees], exact at right angles.
fn turned(degrees: f64) -> (f64, f64) {
    match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        angle => angle.to_radians().sin_cos(),
    }
}

/// What a picture, or every picture of a sequence, must show: bounds along the axes of a view and along its borders.
#[derive(Debug, Clone)]
pub struct Framing {
    axes: [Vector3; 3],
    size: [u32; 2],
    low: [f64; 3],
    high: [f64; 3],
    /// Farthest place beyond the left, right, lower and upper border of a pyramid of view, measured across the view.
    beyond: [f64; 4],
}

impl Framing {
    /// Nothing yet, to be seen from a direction on a picture of this width and height [px].
    ///
    /// # Errors
    /// If an angle is not finite or no picture of this size can be drawn.
    pub fn new(direction: Direction, size: [u32; 2]) -> Result<Self, RenderError> {
        let [width, height] = size;
        if size.iter().any(|side| !SIDES.contains(side)) || u64::from(width) * u64::from(height) > MOST_PIXELS {
            return Err(RenderError::Size { width, height });
        }
        for (what, found) in [("azimuth", direction.azimuth), ("elevation", direction.elevation)] {
            if !found.is_finite() {
                return Err(RenderError::Camera { what, found, expected: "a finite number of degrees" });
            }
        }
        let (none, all) = (f64::INFINITY, f64::NEG_INFINITY);
        Ok(Self { axes: direction.axes(), size, low: [none; 3], high: [all; 3], beyond: [all; 4] })
    }

    /// Focal length of a zoom of 1 [px], and the slopes of the borders of what may be filled.
    fn lens(&self) -> (f64, [f64; 2]) {
        let [width, height] = self.size.map(f64::from);
        let focal = 0.5 * width.min(height) / (0.5 * FIELD_OF_VIEW_DEGREES).to_radians().tan();
        (focal, [width, height].map(|side| 0.5 * FILLED * side / focal))
    }

    /// Makes room for meshes: vertices that are not finite are passed over, drawing will refuse them.
    pub fn include(&mut self, organs: &[OrganMesh]) {
        let (_, slopes) = self.lens();
        for position in organs.iter().flat_map(|organ| &organ.mesh.positions) {
            let place = Vector3::from(position.map(f64::from));
            let along @ [x, y, back] = self.axes.map(|axis| axis.dot(&place));
            if along.iter().all(|x| x.is_finite()) {
                for axis in 0..3 {
                    self.low[axis] = self.low[axis].min(along[axis]);
                    self.high[axis] = self.high[axis].max(along[axis]);
                }
                let [right, up] = slopes.map(|slope| slope * back);
                for (beyond, found) in self.beyond.iter_mut().zip([right - x, right + x, up - y, up + y]) {
                    *beyond = beyond.max(found);
                }
            }
        }
    }

    /// A camera from the direction of this framing that shows all of it at a zoom of 1, as large as it can be.
    ///
    /// # Errors
    /// If nothing was included, or a number of the lens cannot be used.
    pub fn camera(&self, lens: &Lens) -> Result<Camera, RenderError> {
        if !ZOOMS.contains(&lens.zoom) {
            return Err(RenderError::Camera { what: "zoom", found: lens.zoom, expected: "a factor from 0.02 to 50" });
        }
        if (0..3).any(|axis| self.low[axis] > self.high[axis]) {
            return Err(RenderError::Empty);
        }
        let half = [0, 1, 2].map(|axis| 0.5 * (self.high[axis] - self.low[axis]));
        // A single point still needs a scale: 1 mm.
        let unit = half.iter().fold(0.0_f64, |a, &b| a.max(b));
        let unit = if unit > 0.0 { unit } else { 1.0 };
        let mut target = [0, 1, 2].map(|axis| 0.5 * (self.low[axis] + self.high[axis]));
        let (mut focal, slopes) = self.lens();
        let mut distance = None;
        if lens.orthographic {
            let [width, height] = self.size.map(|side| 0.5 * FILLED * f64::from(side));
            focal = (width * unit / half[0].max(1e-3 * unit)).min(height * unit / half[1].max(1e-3 * unit));
        } else {
            // The nearest eye that has everything within its four borders.
            let [left, right, lower, upper] = self.beyond;
            (target[0], target[1]) = (0.5 * (right - left), 0.5 * (upper - lower));
            let eye = (0.5 * (left + right) / slopes[0]).max(0.5 * (lower + upper) / slopes[1]);
            distance = Some((eye - target[2]) / unit);
        }
        let patient = |along: [f64; 3]| (0..3).map(|axis| self.axes[axis] * along[axis]).sum::<Vector3>();
        let mut place = Point3::from(patient(target));
        if let Some(center) = lens.center {
            if let Some(&found) = center.iter().find(|x| !x.is_finite()) {
                return Err(RenderError::Camera { what: "center", found, expected: "finite places in mm" });
            }
            place = Point3::from(center);
        }
        // The eye stays in front of everything, wherever the centre is.
        let ahead = (self.high[2] - self.axes[2].dot(&place.coords)) / unit;
        let distance = distance.map(|distance| distance.max(ahead + LEAST_GAP));
        Ok(Camera { axes: self.axes, target: place, unit, distance, focal: focal * lens.zoom, size: self.size })
    }
}

/// How a framing is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// 1 shows all that is framed; larger numbers show less of it, larger. From 0.02 to 50.
    pub zoom: f64,
    /// Place in the middle of the picture, RAS+ [mm]; the middle of what is framed when `None`.
    pub center: Option<[f64; 3]>,
    /// Parallel rays: lengths across the view are true at every depth.
    pub orthographic: bool,
}

impl Default for Lens {
    fn default() -> Self {
        Self { zoom: 1.0, center: None, orthographic: false }
    }
}

/// A place on the picture and how near it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Projected {
    /// From the left and top edge [px].
    pub(super) x: f64,
    pub(super) y: f64,
    /// Grows towards the eye and is linear on the picture across any plane: 1 / depth, or minus depth for parallel rays.
    pub(super) nearness: f64,
}

/// A finished camera. Made by [`Framing::camera`].
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    axes: [Vector3; 3],
    target: Point3,
    /// One unit of the view [mm].
    unit: f64,
    /// From the eye to the target [units]; `None` with parallel rays.
    distance: Option<f64>,
    /// Pixels per unit at depth 1, or everywhere with parallel rays.
    focal: f64,
    size: [u32; 2],
}

impl Camera {
    /// Width and height of the picture [px].
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Edge of a pixel at the depth of the target [mm].
    pub fn pixel_mm(&self) -> f64 {
        self.unit * self.distance.unwrap_or(1.0) / self.focal
    }

    /// Right, up and back in patient axes (RAS+), unit vectors.
    pub fn axes(&self) -> [Vector3; 3] {
        self.axes
    }

    /// True with parallel rays.
    pub(super) fn is_orthographic(&self) -> bool {
        self.distance.is_none()
    }

    /// A place relative to the target, along right, up and back [units].
    pub(super) fn view_place(&self, place: [f32; 3]) -> [f64; 3] {
        let from = (Vector3::from(place.map(f64::from)) - self.target.coords) / self.unit;
        self.axes.map(|axis| axis.dot(&from))
    }

    /// A direction along right, up and back.
    pub(super) fn view_direction(&self, direction: [f32; 3]) -> [f32; 3] {
        let direction = Vector3::from(direction.map(f64::from));
        self.axes.map(|axis| axis.dot(&direction) as f32)
    }

    /// Where a place of the view falls on the picture; `None` when the eye is not clearly in front of it.
    pub(super) fn project(&self, [x, y, back]: [f64; 3]) -> Option<Projected> {
        let nearness = match self.distance {
            None => back,
            Some(distance) => {
                let depth = distance - back;
                if depth.is_nan() || depth <= 1e-3 {
                    return None;
                }
                1.0 / depth
            }
        };
        let scale = self.scale(nearness);
        let [width, height] = self.size.map(f64::from);
        Some(Projected { x: 0.5 * width + scale * x, y: 0.5 * height - scale * y, nearness })
    }

    /// Pixels per unit at a nearness.
    pub(super) fn scale(&self, nearness: f64) -> f64 {
        if self.distance.is_some() { self.focal * nearness } else { self.focal }
    }

    /// The way from the target's depth (or the eye) through a pixel, per unit of depth: right and up.
    pub(super) fn ray(&self, x: f64, y: f64) -> [f64; 2] {
        let [width, height] = self.size.map(f64::from);
        [(x - 0.5 * width) / self.focal, (0.5 * height - y) / self.focal]
    }

    /// A point of the picture back in the view [units], along right, up and back; the eye (or target) is the origin.
    pub(super) fn unproject(&self, x: f32, y: f32, nearness: f32) -> [f32; 3] {
        let [width, height] = self.size.map(|side| side as f32);
        let (depth, back) = if self.distance.is_some() { (1.0 / nearness, -1.0 / nearness) } else { (1.0, nearness) };
        let per_pixel = depth / self.focal as f32;
        [(x - 0.5 * width) * per_pixel, (0.5 * height - y) * per_pixel, back]
    }

    /// Unit direction from a pixel towards the eye.
    pub(super) fn towards_eye(&self, x: f32, y: f32) -> [f32; 3] {
        if self.distance.is_none() {
            return [0.0, 0.0, 1.0];
        }
        let [right, up] = self.ray(f64::from(x), f64::from(y));
        let length = (right * right + up * up + 1.0).sqrt();
        [-right, -up, 1.0].map(|part| (part / length) as f32)
    }

    /// A plane in patient space, as this camera sees it.
    pub(super) fn view_plane(&self, point: Point3, normal: Vector3) -> ViewPlane {
        let normal = normal.normalize();
        let across = self.axes.map(|axis| axis.dot(&normal));
        let at_target = normal.dot(&(self.target - point)) / self.unit;
        ViewPlane { across, at_target, eye: self.distance.map(|distance| at_target + across[2] * distance) }
    }
}

/// A plane in the view.
#[derive(Debug, Clone, Copy)]
pub(super) struct ViewPlane {
    /// Its unit normal along right, up and back.
    pub(super) across: [f64; 3],
    /// Signed distance of the target [units].
    at_target: f64,
    /// Signed distance of the eye [units]; `None` with parallel rays.
    eye: Option<f64>,
}

impl ViewPlane {
    /// Signed distance of a place of the view [units], positive on the side of the normal.
    pub(super) fn distance(&self, place: [f64; 3]) -> f64 {
        (0..3).map(|axis| self.across[axis] * place[axis]).sum::<f64>() + self.at_target
    }

    /// True when the eye is on the side of the normal, which is taken away, so that the plane can be seen.
    pub(super) fn faces_eye(&self) -> bool {
        self.eye.unwrap_or(self.across[2]) > 1e-9
    }

    /// Nearness of the plane along a ray of [`Camera::ray`]; only for a plane that faces the eye.
    pub(super) fn nearness(&self, [right, up]: [f64; 2]) -> f64 {
        let slope = self.across[0] * right + self.across[1] * up;
        match self.eye {
            Some(eye) => (self.across[2] - slope) / eye,
            None => -(self.at_target + slope) / self.across[2],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn named_views_have_the_patient_the_right_way_round() {
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        for (direction, right, up, back) in [
            (Direction::ANTERIOR, -x, z, y),
            (Direction::POSTERIOR, x, z, -y),
            (Direction::LEFT, -y, z, -x),
            (Direction::RIGHT, y, z, x),
            (Direction::SUPERIOR, x, y, z),
            (Direction::INFERIOR, -x, y, -z),
        ] {
            assert_eq!(direction.axes(), [right, up, back], "{direction:?}");
        }
        let [right, up, back] = Direction::THREE_QUARTER.axes();
        assert!((right.cross(&up) - back).norm() < 1e-12 && back.x > 0.0 && back.y > 0.0 && back.z > 0.0);
    }

    #[test]
    fn projection_and_its_inverse_agree_and_a_plane_is_where_its_points_are() {
        let mut framing = Framing::new(Direction::THREE_QUARTER, [800, 600]).unwrap();
        let mut organ =
            OrganMesh { name: String::new(), color: [0.5; 3], finish: Default::default(), mesh: Default::default() };
        organ.mesh.positions = vec![[-40.0, 100.0, 1000.0], [60.0, 150.0, 1080.0]];
        framing.include(&[organ]);
        for orthographic in [false, true] {
            let camera = framing.camera(&Lens { orthographic, ..Lens::default() }).unwrap();
            let (place, normal) = ([10.0_f32, 120.0, 1040.0], Vector3::new(0.2, 0.9, 0.4));
            let view = camera.view_place(place);
            let seen = camera.project(view).unwrap();
            let [x, y, back] = camera.unproject(seen.x as f32, seen.y as f32, seen.nearness as f32).map(f64::from);
            let back = camera.distance.unwrap_or(0.0) + back;
            assert!([x - view[0], y - view[1], back - view[2]].iter().all(|d| d.abs() < 1e-5), "{orthographic}");
            let plane = camera.view_plane(Point3::from(place.map(f64::from)), normal);
            assert!(plane.faces_eye() && plane.distance(view).abs() < 1e-12);
            assert!((plane.nearness(camera.ray(seen.x, seen.y)) - seen.nearness).abs() < 1e-9, "{orthographic}");
        }
    }
}
