//! `yawara render`: pictures of runs and meshes.

use std::path::PathBuf;

use anyhow::bail;
use image::{DynamicImage, RgbaImage};

use super::exit::Outcome;
use super::mesh::{frames_of, make_crisp, open};
use super::messages::{Messages, out};
use super::paint::frame as painted;
use super::pictures::{Pictures, delays, is_animation};
use super::progress;
use super::render_arguments::{RenderArguments, StyleChoice};
use super::source::Source;
use super::surface::mesher;
use crate::io::apng::write_apng;
use crate::io::gltf::GltfReader;
use crate::io::mesh_format::MeshFormat;
use crate::io::png::write_png_rgba;
use crate::render::annotate::annotate;
use crate::render::camera::{Camera, Framing, Lens};
use crate::render::cubes::cubes;
use crate::render::normals::{CREASE_DEGREES, creased};
use crate::render::{Background, Lines, Look, render as draw};
use crate::run::meshes::{MeshRunError, RunMesher, scene_of};
use crate::run::paint::Painter;
use crate::scene::resolved::Scene;
use crate::store::RunReader;
use crate::surface::mesh::{Finish, OrganMesh};

/// What meshes without colour are made of, linear RGB.
const CLAY: [f32; 3] = [0.40, 0.37, 0.34];

pub(super) fn render(arguments: &RenderArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    is_animation(&arguments.output)?;
    let mut subject = Subject::open(arguments, messages)?;
    let count = subject.frames();
    let what = if matches!(subject, Subject::File { .. }) { "the mesh" } else { "the run" };
    let numbers = frames_of(arguments.frame, count, &arguments.source, what)?;
    let pictures = Pictures::of(&arguments.output, numbers.len())?;
    let camera = camera(arguments, &mut subject, &numbers, count - 1)?;
    let bar = progress::bar(messages, "frames", numbers.len() as u64);
    let mut written = Vec::new();
    if let Pictures::Animation(path) = &pictures {
        let times: Vec<f64> = numbers.iter().filter_map(|&number| subject.time(number)).collect();
        let delays = delays(path, &times, arguments.slow)?;
        // With an alpha channel or without, but all frames alike.
        let transparent = arguments.background == Background::Transparent;
        write_apng(path, &delays, None, |at| {
            let picture = DynamicImage::from(draw_one(arguments, &subject.frame(numbers[at])?, &camera)?);
            bar.inc(1);
            anyhow::Ok(if transparent { picture } else { picture.to_rgb8().into() })
        })?;
        written.push(path.clone());
    } else {
        for &number in &numbers {
            let path = pictures.path(number, count - 1);
            write_png_rgba(&path, draw_one(arguments, &subject.frame(number)?, &camera)?)?;
            written.push(path);
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    for path in written {
        out(&path.display().to_string())?;
    }
    Ok(Outcome::Done)
}

/// One camera for all frames, so that a sequence of pictures does not jump.
fn camera(
    arguments: &RenderArguments,
    subject: &mut Subject,
    numbers: &[usize],
    last: usize,
) -> anyhow::Result<Camera> {
    let mut framing = Framing::new(arguments.direction(), arguments.size)?;
    let mut shown = numbers.to_vec();
    shown.extend([0, last]);
    shown.sort_unstable();
    shown.dedup();
    for number in shown {
        framing.include(&subject.frame(number)?);
    }
    let lens = Lens { zoom: arguments.zoom, center: arguments.center, orthographic: arguments.orthographic };
    Ok(framing.camera(&lens)?)
}

fn draw_one(arguments: &RenderArguments, organs: &[OrganMesh], camera: &Camera) -> anyhow::Result<RgbaImage> {
    let lines = match arguments.style {
        StyleChoice::Surface => Lines::None,
        StyleChoice::Voxels => Lines::Quads,
        StyleChoice::Wireframe => Lines::Triangles,
    };
    let background = arguments.background;
    let look = Look { background, lines, occlusion: !arguments.no_occlusion, clip: arguments.clip_plane() };
    let picture = draw(organs, camera, &look)?;
    let letters = !arguments.plain && background != Background::Transparent;
    Ok(if letters { annotate(picture, camera, background) } else { picture })
}

/// What is drawn, frame by frame.
enum Subject {
    Surfaces { mesher: Box<RunMesher>, painter: Option<Box<Painter>> },
    Voxels { reader: Box<RunReader>, scene: Box<Scene>, organs: Vec<usize> },
    File { path: PathBuf, kind: FileKind, organs: Vec<String> },
}

enum FileKind {
    Still(Vec<OrganMesh>),
    Animation(Box<GltfReader>),
}

impl Subject {
    fn open(arguments: &RenderArguments, messages: &Messages) -> anyhow::Result<Self> {
        let (path, names) = (&arguments.source, &arguments.organ);
        let format = match Source::of(path)? {
            Source::Run => None,
            Source::Mesh(format) => Some(format),
            other => return Err(other.refuse(path, "a run directory or a mesh")),
        };
        match (format, arguments.style) {
            (Some(_), StyleChoice::Voxels) => {
                bail!("{}: a mesh has no voxels; give the run directory, or another --style", path.display())
            }
            (Some(MeshFormat::Glb), _) => {
                let kind = FileKind::Animation(Box::new(GltfReader::open(path)?));
                Ok(Self::File { path: path.clone(), kind, organs: names.clone() })
            }
            (Some(format), _) => {
                let mut meshes = format.read(path)?;
                // These formats have no colour; the one for viewers is too bright for our lights.
                meshes.iter_mut().for_each(|organ| (organ.color, organ.finish) = (CLAY, Finish::Dry));
                let kind = FileKind::Still(meshes);
                Ok(Self::File { path: path.clone(), kind, organs: names.clone() })
            }
            (None, StyleChoice::Voxels) => {
                let reader = open(path, messages)?;
                let scene = scene_of(&reader)?;
                let known: Vec<String> = scene.organs.iter().map(|organ| organ.name.clone()).collect();
                if let Some(found) = names.iter().find(|name| !known.contains(name)) {
                    return Err(MeshRunError::UnknownOrgan { found: found.clone(), expected: known }.into());
                }
                let organs = (0..known.len()).filter(|&n| names.is_empty() || names.contains(&known[n])).collect();
                Ok(Self::Voxels { reader: Box::new(reader), scene: Box::new(scene), organs })
            }
            (None, _) => {
                let mesher = mesher(path, names, &arguments.surface.options(), messages)?;
                let painter = arguments.paint.painter(&mesher, messages)?;
                Ok(Self::Surfaces { mesher: Box::new(mesher), painter: painter.map(Box::new) })
            }
        }
    }

    fn frames(&self) -> usize {
        match self {
            Self::Surfaces { mesher, .. } => mesher.reader().frames(),
            Self::Voxels { reader, .. } => reader.frames(),
            Self::File { kind: FileKind::Animation(reader), .. } => reader.frames(),
            Self::File { .. } => 1,
        }
    }

    /// Time of a frame [s].
    fn time(&self, number: usize) -> Option<f64> {
        match self {
            Self::Surfaces { mesher, .. } => mesher.reader().times().get(number).copied(),
            Self::Voxels { reader, .. } => reader.times().get(number).copied(),
            Self::File { kind: FileKind::Animation(reader), .. } => reader.time(number),
            Self::File { .. } => None,
        }
    }

    fn frame(&mut self, number: usize) -> anyhow::Result<Vec<OrganMesh>> {
        match self {
            Self::Surfaces { mesher, painter } => {
                let (_, mut meshes) = painted(mesher, painter.as_deref(), number)?;
                make_crisp(mesher, &mut meshes);
                Ok(meshes)
            }
            Self::Voxels { reader, scene, organs } => {
                let frame = reader.frame(number)?;
                let voxels = |&organ: &usize| {
                    let mesh = cubes(reader.lattice(), &frame.topology, &frame.displacements_mm, organ as u8);
                    let organ = &scene.organs[organ];
                    OrganMesh { name: organ.name.clone(), color: organ.color, finish: Finish::Dry, mesh }
                };
                Ok(organs.iter().map(voxels).collect())
            }
            Self::File { path, kind, organs } => {
                let mut meshes = match kind {
                    FileKind::Still(meshes) => meshes.clone(),
                    FileKind::Animation(reader) => reader.read_frame(number)?,
                };
                if let Some(found) = organs.iter().find(|name| meshes.iter().all(|mesh| mesh.name != **name)) {
                    let known: Vec<&str> = meshes.iter().map(|mesh| mesh.name.as_str()).collect();
                    bail!("{}: there is no mesh `{found}`; there are {}", path.display(), known.join(", "));
                }
                meshes.retain(|mesh| organs.is_empty() || organs.contains(&mesh.name));
                for organ in meshes.iter_mut().filter(|organ| organ.mesh.normals.is_empty()) {
                    organ.mesh = creased(&organ.mesh, CREASE_DEGREES);
                }
                Ok(meshes)
            }
        }
    }
}
