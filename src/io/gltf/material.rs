//! How the surface of an organ takes light, as physically based materials say it.

use gltf_json::Material;
use gltf_json::extensions;
use gltf_json::material::{PbrBaseColorFactor, StrengthFactor};
use serde_json::json;

use crate::surface::mesh::{Finish, OrganMesh};

/// Roughness of tissue under its film. Viewers without clear coats show this alone: a broad, soft highlight.
const WET_ROUGHNESS: f32 = 0.4;
/// Roughness of the film: narrower than the tissue's, wide enough to stay calm on a mesh of millimetres.
const FILM_ROUGHNESS: f64 = 0.15;
/// Share of the film that reflects.
const FILM: f64 = 0.6;
/// Refractive index of soft tissue under visible light, 1.36 to 1.40 (S. L. Jacques, Optical properties of biological
/// tissues: a review, Phys. Med. Biol. 58, 2013).
const TISSUE_IOR: f64 = 1.38;
/// Dull bone.
const DRY_ROUGHNESS: f32 = 0.85;

/// The material of an organ: one sided, not metallic. Vertices that bring their own colours stand on white, with which they
/// are multiplied.
pub(super) fn material(organ: &OrganMesh) -> Material {
    let [r, g, b] = if organ.mesh.colors.is_empty() { organ.color.map(|c| c.clamp(0.0, 1.0)) } else { [1.0; 3] };
    let mut material = Material { name: Some(organ.name.clone()), ..Material::default() };
    let surface = &mut material.pbr_metallic_roughness;
    surface.base_color_factor = PbrBaseColorFactor([r, g, b, 1.0]);
    surface.metallic_factor = StrengthFactor(0.0);
    surface.roughness_factor = StrengthFactor(if is_wet(organ.finish) { WET_ROUGHNESS } else { DRY_ROUGHNESS });
    if is_wet(organ.finish) {
        let coat = json!({ "clearcoatFactor": FILM, "clearcoatRoughnessFactor": FILM_ROUGHNESS });
        let mut extension = extensions::material::Material::default();
        extension.others.insert("KHR_materials_clearcoat".to_owned(), coat);
        extension.others.insert("KHR_materials_ior".to_owned(), json!({ "ior": TISSUE_IOR }));
        material.extensions = Some(extension);
    }
    material
}

fn is_wet(finish: Finish) -> bool {
    finish == Finish::Wet
}

/// The finish that a material of ours stands for: wet when it has a clear coat.
pub(super) fn finish(material: &Material) -> Finish {
    let coated =
        |extensions: &extensions::material::Material| extensions.others.contains_key("KHR_materials_clearcoat");
    let dull = material.pbr_metallic_roughness.roughness_factor.0 >= DRY_ROUGHNESS;
    if dull && !material.extensions.as_ref().is_some_and(coated) { Finish::Dry } else { Finish::Wet }
}
