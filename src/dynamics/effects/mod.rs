//! What a scene may add to springs, volume and gravity, and what costs nothing when it does not.

pub mod contact;
