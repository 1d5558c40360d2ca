//! `yawara bench care`: a surface tidied and decimated.

use std::time::Instant;

use anyhow::bail;
use serde_json::json;

use super::super::args::BenchCareArguments;
use super::super::messages::out;
use super::surface::bumpy_ball;
use crate::geometry::{Affine, GridShape};
use crate::surface::care::{Care, RestMesh};
use crate::surface::check::{MeshReport, check};
use crate::surface::field_normals::GradientOf;
use crate::surface::marching_cubes;
use crate::surface::mesh::TriangleMesh;

pub(super) fn care(arguments: &BenchCareArguments) -> anyhow::Result<()> {
    let BenchCareArguments { n, percent, tidy, max_error, json } = *arguments;
    if !(2..=1024).contains(&n) || !(1..=100).contains(&percent) {
        bail!("--n is {n} and --percent {percent}; expected n from 2 to 1024 and a percentage from 1 to 100");
    }
    let shape = GridShape::new(n, n, n);
    let affine = Affine::from_spacing([1.0; 3], [0.0; 3])?;
    let given = marching_cubes(shape, &affine, &bumpy_ball(shape), GradientOf::Field)?;
    let places: Vec<[f64; 3]> = given.positions.iter().map(|place| place.map(f64::from)).collect();
    let rest = RestMesh { positions: &places, triangles: &given.triangles, sheets: &[], organs: &[] };
    let triangles = Some(given.triangles.len() * percent / 100);
    let began = Instant::now();
    let cared = Care { spacing_mm: 1.0, tidy, triangles, max_error_mm: max_error }.apply(rest)?;
    let seconds = began.elapsed().as_secs_f64();
    let positions = cared.positions.iter().map(|place| place.map(|c| c as f32)).collect();
    let left = TriangleMesh { positions, triangles: cared.triangles, ..TriangleMesh::default() };
    let [before, after]: [MeshReport; 2] = [&given, &left].map(check);
    let change = after.volume_mm3 / before.volume_mm3 - 1.0;
    if json {
        let report = json!({
            "peer": concat!("yawara ", env!("CARGO_PKG_VERSION")),
            "n": n,
            "threads": rayon::current_num_threads(),
            "seconds": seconds,
            "triangles": before.triangles,
            "triangles_left": after.triangles,
            "volume_change": change,
            "min_angle_deg": after.min_angle_deg,
            "passed": after.passes(),
        });
        return out(&report.to_string());
    }
    out(&format!(
        "{seconds:.2} s from {} to {} triangles, volume {:+.4} %\n{after}",
        before.triangles,
        after.triangles,
        100.0 * change
    ))
}
