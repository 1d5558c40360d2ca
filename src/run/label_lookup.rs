//! Where a scene's label names come from: text tables, and the phantoms' own.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;

use crate::io::label_names::LabelNames;
use crate::phantom;
use crate::scene::LabelLookup;
use crate::scene::resolved::PhantomKind;

/// Label names from files on disk and from the phantoms.
#[derive(Debug, Clone, Copy, Default)]
pub struct Files;

impl LabelLookup for Files {
    fn in_file(&self, path: &Path) -> Result<BTreeMap<String, u16>, Box<dyn Error + Send + Sync>> {
        Ok(LabelNames::read(path)?.iter().map(|(label, name)| (name.to_owned(), label)).collect())
    }

    fn of_phantom(&self, kind: PhantomKind) -> BTreeMap<String, u16> {
        let names = match kind {
            PhantomKind::Abdomen => phantom::ABDOMEN_NAMES,
            PhantomKind::Cube => phantom::CUBE_NAMES,
            PhantomKind::Beam => phantom::BEAM_NAMES,
        };
        names.iter().map(|&(label, name)| (name.to_owned(), label)).collect()
    }
}
