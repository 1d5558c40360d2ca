//! What an animation shows when: nodes that appear and vanish, and the weights of morph targets.

use gltf_json::accessor::Type;
use gltf_json::animation::{Interpolation, Property};
use gltf_json::validation::Checked;
use gltf_json::{Index, Node};

use super::GltfReader;
use crate::io::mesh_error::ReadMeshError;

/// Values of a node over time.
pub(super) struct Track {
    /// Key times [s], in order.
    times: Vec<f32>,
    /// `width` for each key.
    values: Vec<f32>,
    width: usize,
    /// Held until the next key, or straight lines.
    steps: bool,
}

impl Track {
    /// Values at a time [s]; before the first key those of the first, after the last those of the last.
    pub(super) fn at(&self, time: f32) -> Vec<f32> {
        let after = self.times.partition_point(|&key| key <= time);
        let key = after.saturating_sub(1);
        let values = |key: usize| &self.values[key * self.width..][..self.width];
        let span = self.times.get(after).map_or(0.0, |next| next - self.times[key]);
        if self.steps || after == 0 || span <= 0.0 {
            return values(key).to_vec();
        }
        let share = (time - self.times[key]) / span;
        values(key).iter().zip(values(after)).map(|(a, b)| a + share * (b - a)).collect()
    }

    /// Times at which something is new [s].
    fn changes(&self) -> impl Iterator<Item = f32> {
        let keys = (0..self.times.len()).zip(self.values.chunks(self.width));
        let mut before: Option<&[f32]> = None;
        keys.filter_map(move |(key, values)| {
            let new = before.is_none_or(|before| before != values);
            before = Some(values);
            new.then(|| self.times[key])
        })
    }
}

impl GltfReader {
    /// Collects the tracks, and from them the times of the frames: when something comes into sight, or changes its shape.
    pub(super) fn read_animations(&mut self) -> Result<(), ReadMeshError> {
        let mut numbers = 0;
        for animation in self.root.animations.clone() {
            for channel in &animation.channels {
                let Checked::Valid(property) = channel.target.path else { continue };
                let Some(sampler) = animation.samplers.get(channel.sampler.value()) else {
                    let what = format!("an animation has no sampler {}", channel.sampler.value());
                    return Err(self.source.malformed(what));
                };
                let Checked::Valid(interpolation) = sampler.interpolation else { continue };
                let steps = interpolation == Interpolation::Step;
                let weights = match (property, interpolation) {
                    (Property::Scale, Interpolation::Step) => false,
                    (Property::MorphTargetWeights, Interpolation::Step | Interpolation::Linear) => true,
                    _ => continue,
                };
                let times: Vec<f32> =
                    self.source.numbers::<1>(&self.root, sampler.input, Type::Scalar)?.into_iter().flatten().collect();
                let values: Vec<f32> = if weights {
                    let weights = self.source.numbers::<1>(&self.root, sampler.output, Type::Scalar)?;
                    weights.into_iter().flatten().collect()
                } else {
                    let scales = self.source.numbers::<3>(&self.root, sampler.output, Type::Vec3)?;
                    scales.iter().map(|scale| scale[0]).collect()
                };
                numbers += (times.len() + values.len()) as u64;
                let width = values.len().checked_div(times.len()).unwrap_or(0);
                let fits = width > 0 && width * times.len() == values.len() && (weights || width == 1);
                // A track that several channels share would take more memory than the file has bytes.
                if !fits || numbers > self.source.bytes() {
                    let (times, values) = (times.len(), values.len());
                    return Err(self.source.malformed(format!("an animation has {times} times for {values} values")));
                }
                if let Some(value) = times.iter().chain(&values).find(|value| !value.is_finite()) {
                    return Err(self.source.malformed(format!("an animation has the number {value}")));
                }
                if !times.is_sorted() {
                    return Err(self.source.malformed("the times of an animation do not grow"));
                }
                let track = Track { times, values, width, steps };
                let node = channel.target.node.value();
                if weights {
                    self.times.extend(track.changes());
                    self.weights.insert(node, track);
                } else {
                    let seen = |time: &f32| track.at(*time)[0] > 0.0;
                    self.times.extend(track.changes().filter(seen));
                    self.shown.insert(node, track);
                }
            }
        }
        self.times.sort_by(f32::total_cmp);
        self.times.dedup();
        Ok(())
    }

    /// The scale of a node at a time: animated, or its own.
    pub(super) fn scale(&self, index: Index<Node>, node: &Node, time: Option<f32>) -> [f32; 3] {
        match (time, self.shown.get(&index.value())) {
            (Some(time), Some(track)) => [track.at(time)[0]; 3],
            _ => node.scale.unwrap_or([1.0; 3]),
        }
    }

    /// The weights of a node's morph targets at a time, if anything but its mesh says some.
    pub(super) fn weights(&self, index: Index<Node>, node: &Node, time: Option<f32>) -> Option<Vec<f32>> {
        match (time, self.weights.get(&index.value())) {
            (Some(time), Some(track)) => Some(track.at(time)),
            _ => node.weights.clone(),
        }
    }
}
