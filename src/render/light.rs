//! The colour of a point: three soft lights and the sky, fixed to the camera, on a wet or a dry surface.

use super::Lines;
use super::camera::{Camera, ViewPlane};
use super::drawing::{Corner, Drawing, SUBPIXELS};
use super::raster::twice_area;
use crate::surface::mesh::Finish;
use crate::surface::sharp_edges::SHARP_EDGE;

/// A light far away.
struct Light {
    /// Towards it, along right, up and back; unit length.
    towards: [f32; 3],
    /// Linear RGB.
    color: [f32; 3],
    /// Strength of its highlights. Those of several lights, or coloured ones, make tissue look like metal.
    gloss: f32,
    /// How far its light reaches round a surface that turns away from it, 0 to 1: large lights are soft.
    wrap: f32,
}

/// Key from the upper left, fill from the right, rim from behind above.
const LIGHTS: [Light; 3] = [
    Light { towards: [-0.442_34, 0.589_79, 0.675_80], color: [1.62, 1.56, 1.48], gloss: 1.6, wrap: 0.15 },
    Light { towards: [0.842_15, 0.105_27, 0.528_87], color: [0.24, 0.26, 0.29], gloss: 0.06, wrap: 0.4 },
    Light { towards: [0.301_51, 0.603_02, -0.738_55], color: [0.36, 0.37, 0.40], gloss: 0.3, wrap: 0.2 },
];
/// Light from all of the upper and the lower half.
const SKY: [f32; 3] = [0.34, 0.355, 0.38];
const GROUND: [f32; 3] = [0.15, 0.14, 0.135];
/// What is left of the colour on the inside of a surface.
const INSIDE: f32 = 0.42;
/// Narrow and broad highlight of wet tissue: strength; exponents are 32 and 8.
const GLOSS: f32 = 0.13;
const SHEEN: f32 = 0.035;
/// Sections are lit evenly, and a little paler than the organ: this much white in them.
const SECTION_PALER: f32 = 0.05;
const SECTION_LIGHT: f32 = 1.35;
/// Lines: linear RGB, how much of it, half their width for a picture 1000 px high [px].
const LINE: [f32; 3] = [0.012, 0.014, 0.018];
const LINE_STRENGTH: f32 = 0.72;
const LINE_HALF_WIDTH: f32 = 0.55;

/// A point of a surface as it is seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub(super) color: [f32; 3],
    pub(super) normal: [f32; 3],
    pub(super) nearness: f32,
}

/// Colours points of a drawing.
pub(super) struct Shader<'a> {
    drawing: &'a Drawing,
    camera: &'a Camera,
    plane: Option<&'a ViewPlane>,
    lines: Lines,
    half_line: f32,
}

impl<'a> Shader<'a> {
    pub(super) fn new(drawing: &'a Drawing, camera: &'a Camera, plane: Option<&'a ViewPlane>, lines: Lines) -> Self {
        let shorter = camera.size().into_iter().min().unwrap_or(0) as f32;
        let half_line = LINE_HALF_WIDTH * (shorter / 1000.0).max(0.8);
        Self { drawing, camera, plane, lines, half_line }
    }

    /// A triangle at a place of the picture [px].
    pub(super) fn triangle(&self, number: usize, at: [f32; 2]) -> Point {
        let drawing = self.drawing;
        let vertices = drawing.triangles[number].map(|vertex| vertex as usize);
        let corners = vertices.map(|vertex| drawing.corners[vertex]);
        let on_picture = barycentric(&corners, at);
        let weights = if self.camera.is_orthographic() { on_picture } else { in_space(&corners, on_picture) };
        let blend = |values: &[[f32; 3]]| {
            let [a, b, c] = vertices.map(|vertex| values[vertex]);
            [0, 1, 2].map(|axis| weights[0] * a[axis] + weights[1] * b[axis] + weights[2] * c[axis])
        };
        let [a, b, c] = vertices.map(|vertex| drawing.places[vertex]);
        let flat = unit(cross(minus(b, a), minus(c, a)));
        let normals = vertices.map(|vertex| match (drawing.normals[vertex], flat) {
            (normal, Some(flat)) if dot(normal, flat) < SHARP_EDGE => flat,
            (normal, _) => normal,
        });
        let mixed = [0, 1, 2].map(|axis| (0..3).map(|i| weights[i] * normals[i][axis]).sum());
        let mut normal = unit(mixed).or(flat).unwrap_or([0.0, 0.0, 1.0]);
        let part = drawing.parts[drawing.part_of(number)];
        let mut albedo = blend(&drawing.colors).map(|c| c.clamp(0.0, 1.0));
        let inside = twice_area(corners.map(|corner| [corner.x, corner.y].map(i64::from))) > 0;
        let eye = self.camera.towards_eye(at[0], at[1]);
        let finish = if inside { Finish::Dry } else { part.finish };
        if inside {
            normal = normal.map(|x| -x);
            albedo = albedo.map(|c| c * INSIDE);
        }
        // Interpolated normals may turn away from the eye at the rim; bent back, they do not catch stray highlights.
        let towards = dot(normal, eye);
        if towards < 0.02 {
            let bent = [0, 1, 2].map(|axis| normal[axis] + (0.02 - towards) * eye[axis]);
            normal = unit(bent).unwrap_or(normal);
        }
        let mut color = lit(normal, eye, albedo, finish);
        let line = self.line(number, &corners, on_picture);
        (0..3).for_each(|c| color[c] += line * (LINE[c] - color[c]));
        let nearness = (0..3).map(|i| on_picture[i] * corners[i].nearness).sum();
        Point { color, normal, nearness }
    }

    /// The section of a part at a place of the picture [px].
    pub(super) fn section(&self, part: usize, at: [f32; 2]) -> Point {
        let plane = self.plane.expect("sections are seen through a clip plane");
        let base = self.drawing.parts[part].color;
        let color = base.map(|c| SECTION_LIGHT * (c.clamp(0.0, 1.0) * (1.0 - SECTION_PALER) + SECTION_PALER));
        let nearness = plane.nearness(self.camera.ray(f64::from(at[0]), f64::from(at[1]))) as f32;
        Point { color, normal: plane.across.map(|x| x as f32), nearness }
    }

    /// How much of a line is seen at a place of a triangle, 0 to 1: by the distance to its drawn edges on the picture.
    fn line(&self, number: usize, corners: &[Corner; 3], on_picture: [f32; 3]) -> f32 {
        // Edges by the corner opposite to them.
        let drawn: &[usize] = match self.lines {
            Lines::None => return 0.0,
            Lines::Triangles => &[0, 1, 2],
            // Of the pair (a, b, c), (a, c, d) all but (a, c).
            Lines::Quads => {
                let first = self.drawing.parts[self.drawing.part_of(number)].first;
                if (number - first).is_multiple_of(2) { &[0, 2] } else { &[0, 1] }
            }
        };
        let places = corners.map(|corner| [corner.x, corner.y].map(|x| x as f32 / SUBPIXELS as f32));
        let area = twice_area(corners.map(|corner| [corner.x, corner.y].map(i64::from))).unsigned_abs() as f32
            / (SUBPIXELS * SUBPIXELS) as f32;
        drawn.iter().fold(0.0_f32, |most, &opposite| {
            let [a, b] = [places[(opposite + 1) % 3], places[(opposite + 2) % 3]];
            let length = (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-6);
            let height = area / length;
            // Where triangles are as small as lines are wide, lines fade instead of covering everything.
            let strength = LINE_STRENGTH * ((height - 1.0) / 6.0).clamp(0.0, 1.0);
            let distance = on_picture[opposite] * height;
            most.max(strength * (self.half_line + 0.5 - distance).clamp(0.0, 1.0))
        })
    }
}

/// Light that a point sends to the eye, linear RGB. All directions have unit length.
fn lit(normal: [f32; 3], eye: [f32; 3], albedo: [f32; 3], finish: Finish) -> [f32; 3] {
    let up = 0.5 + 0.5 * normal[1];
    let mut diffuse: [f32; 3] = std::array::from_fn(|c| GROUND[c] + up * (SKY[c] - GROUND[c]));
    let mut gloss = 0.0;
    for light in &LIGHTS {
        let facing = dot(normal, light.towards);
        let soft = ((facing + light.wrap) / (1.0 + light.wrap)).max(0.0);
        (0..3).for_each(|c| diffuse[c] += 0.72 * soft * light.color[c]);
        if finish == Finish::Wet && facing > 0.0 {
            let half = unit([0, 1, 2].map(|axis| eye[axis] + light.towards[axis])).unwrap_or(normal);
            let aligned = dot(normal, half).max(0.0);
            let broad = aligned.powi(8);
            let strength = (GLOSS * broad.powi(4) + SHEEN * broad) * facing.min(1.0);
            gloss += strength * light.gloss;
        }
    }
    [0, 1, 2].map(|c| albedo[c] * diffuse[c] + gloss)
}

/// Shares of the corners at a place of the picture [px]; of the nearest place of the triangle when it lies outside.
fn barycentric(corners: &[Corner; 3], at: [f32; 2]) -> [f32; 3] {
    let places = corners.map(|corner| {
        let from = [corner.x, corner.y].map(|x| f64::from(x) / f64::from(SUBPIXELS));
        [(from[0] - f64::from(at[0])) as f32, (from[1] - f64::from(at[1])) as f32]
    });
    let opposite = |i: usize| {
        let (a, b) = (places[(i + 1) % 3], places[(i + 2) % 3]);
        a[0] * b[1] - a[1] * b[0]
    };
    let areas = [0, 1, 2].map(opposite);
    let sign = if areas.iter().sum::<f32>() < 0.0 { -1.0 } else { 1.0 };
    normalized(areas.map(|area| (sign * area).max(0.0)))
}

/// The same shares in space, where what is near takes less than it seems to: nearness weighs them.
fn in_space(corners: &[Corner; 3], on_picture: [f32; 3]) -> [f32; 3] {
    normalized([0, 1, 2].map(|i| on_picture[i] * corners[i].nearness))
}

fn normalized(weights: [f32; 3]) -> [f32; 3] {
    let sum: f32 = weights.iter().sum();
    if sum > 0.0 { weights.map(|weight| weight / sum) } else { [1.0 / 3.0; 3] }
}

fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `None` for a vector without length, or not finite.
fn unit(v: [f32; 3]) -> Option<[f32; 3]> {
    let squared = dot(v, v);
    (squared > 1e-30 && squared.is_finite()).then(|| v.map(|x| x / squared.sqrt()))
}
