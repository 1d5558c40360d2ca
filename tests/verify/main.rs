//! Every case of the page that `yawara verify` writes, as a test of its own.

use std::collections::BTreeSet;

use yawara::verify::cases;

/// Runs the case with this name (with hyphens) and shows what came of it.
fn keep(name: &str) {
    let name = name.replace('_', "-");
    let case = cases().into_iter().find(|case| case.name == name).unwrap_or_else(|| panic!("no case is named {name}"));
    let finding = (case.run)();
    println!("{name}: {} (error {:.2e}, allowed {:.1e})", finding.happened, finding.error, finding.allowed);
    assert!(finding.passed(), "{}: {} (error {:e})", case.asked, finding.happened, finding.error);
    assert!(finding.error.is_finite() && finding.allowed.is_finite() && !finding.happened.is_empty());
}

macro_rules! cases {
    ($($name:ident)*) => {
        $(
            #[test]
            fn $name() {
                keep(stringify!($name));
            }
        )*

        const TESTED: &[&str] = &[$(stringify!($name)),*];
    };
}

cases! {
    // Solids at rest.
    uniaxial
    affine_patch_f64
    affine_patch_f32
    bars_in_series
    bars_in_parallel
    partly_filled
    cantilever
    hanging_column
    volume_at_small_strain
    volume_when_pressed
    // Waves and vibrations.
    p_wave
    s_wave
    bending_frequency
    // Free bodies.
    linear_momentum
    angular_momentum
    energy_without_dampers
    energy_with_dampers
    rigid_rotation
    spin_with_strong_dampers
    // The stable step.
    stability_pair
    random_scenes
    every_cut
    // Hard cases.
    stiffness_contrast
    mass_contrast
    lone_voxels
    million_steps_at_rest
    rotation_without_ghost_forces
    far_from_the_origin
    zero_length_springs
    particles_at_random_places
    block_flattened_to_a_plane
    one_cell_inside_out
    block_inside_out
    cut_leaves_one_particle
    cut_leaves_a_chain
    cut_leaves_a_sliver
    cutting_twice
    cutting_while_moving
    step_1000_times_too_large
    fast_tool
    nan_in_a_ct
    nan_in_a_scene
    nan_in_a_state
}

#[test]
fn every_case_has_a_test() {
    let names: Vec<String> = cases().iter().map(|case| case.name.to_owned()).collect();
    let all: BTreeSet<String> = names.iter().cloned().collect();
    let tested: BTreeSet<String> = TESTED.iter().map(|name| name.replace('_', "-")).collect();
    assert_eq!(all, tested);
    assert_eq!(all.len(), names.len(), "no name is used twice");
    for case in cases() {
        let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        assert!(case.name.chars().all(plain) && !case.asked.ends_with('.'), "{}", case.name);
        assert!(!case.asked.contains('|') && !case.asked.contains('\n'), "{} breaks the table", case.name);
    }
}
