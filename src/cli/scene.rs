//! `yawara scene`: check a scene, or print the schema of scenes.

use super::args::SceneArguments;
use super::exit::Outcome;
use super::messages::{Messages, out};
use crate::run::label_lookup::Files;

pub(super) fn scene(arguments: &SceneArguments, messages: &Messages) -> anyhow::Result<Outcome> {
    match &arguments.scene {
        Some(path) => {
            let (scene, warnings) = crate::scene::load(path, &Files)?;
            warnings.iter().for_each(|warning| messages.warning(warning));
            out(&serde_json::to_string_pretty(&scene)?)?;
        }
        // Without a scene clap requires --schema.
        None => out(&serde_json::to_string_pretty(&crate::scene::json_schema())?)?,
    }
    Ok(Outcome::Done)
}
