//! Transfer functions, detail and paint.

use yawara::geometry::{Point3, Vector3};
use yawara::lattice::Topology;
use yawara::lattice::cells::build_cells;
use yawara::look::colormap::Colormap;
use yawara::look::detail::{AMPLITUDE, Detail};
use yawara::look::paint::{ColorBy, Legend, Paint, add_detail, colors};
use yawara::look::rest::RestSurface;
use yawara::look::transfer::{Capsule, HuSpread, TransferFunction, tissue_colors, window_of};
use yawara::surface::mesh::TriangleMesh;

use crate::support::{Random, block};
use crate::{deformed, middle, on_threads, surface};

/// Names of organs with the CT numbers one may find in them, and a colour of their own (linear RGB).
const ORGANS: [(&str, [f32; 2], [f32; 3]); 9] = [
    ("liver", [55.0, 16.0], [0.26, 0.04, 0.03]),
    ("liver, portal phase", [105.0, 11.0], [0.26, 0.04, 0.03]),
    ("kidney_right", [35.0, 25.0], [0.35, 0.08, 0.07]),
    ("lung_lower_lobe_left", [-725.0, 135.0], [0.69, 0.38, 0.35]),
    ("colon", [-233.0, 370.0], [0.56, 0.27, 0.19]),
    ("fat", [-100.0, 12.0], [0.77, 0.58, 0.19]),
    ("gluteus muscle", [10.0, 25.0], [0.3, 0.06, 0.05]),
    ("vertebrae_L3", [220.0, 148.0], [0.79, 0.72, 0.55]),
    ("something", [0.0, 0.0], [0.1, 0.4, 0.8]),
];

fn in_range(color: [f32; 3]) -> bool {
    color.iter().all(|channel| (0.0..=1.0).contains(channel))
}

/// CIE luminance of linear sRGB.
fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

#[test]
fn tissue_grows_brighter_through_its_window_and_is_itself_at_its_median() {
    for (name, [median, deviation], color) in ORGANS {
        let window = window_of(name, HuSpread { median, deviation });
        let transfer = tissue_colors(name, color, window);
        let own = transfer.rgb(median);
        assert!(
            own.iter().zip(color).all(|(a, b)| (a - b).abs() < 2e-3),
            "{name}: {own:?} at its median, not {color:?}"
        );
        let at = |share: f32| window[0] + share * (window[1] - window[0]);
        // Vessels are darker than the lung around them to the eye: its shades go down.
        let sign = if name.starts_with("lung") { -1.0 } else { 1.0 };
        let upper: Vec<f32> = (40..=100).map(|n| sign * luminance(transfer.rgb(at(n as f32 / 100.0)))).collect();
        let lower: Vec<f32> = (0..=40).map(|n| luminance(transfer.rgb(at(n as f32 / 100.0)))).collect();
        assert!(upper.is_sorted() && lower.is_sorted(), "{name}");
        // Enough to see: one deviation is a visible step, and not the whole range.
        let step = luminance(transfer.rgb(median + deviation.clamp(9.0, 40.0))) / luminance(own);
        assert!(name.starts_with("lung") || step > 1.01, "{name}: {step}");
        for hu in (-2000..3000).map(|hu| hu as f32).chain([f32::NEG_INFINITY, f32::INFINITY, f32::NAN]) {
            assert!(in_range(transfer.rgb(hu)), "{name} at {hu} HU");
        }
    }
}

#[test]
fn air_fat_and_bone_look_like_themselves_inside_any_soft_organ() {
    let transfer = tissue_colors("liver", [0.26, 0.04, 0.03], [0.0, 130.0]);
    let [r, g, b] = transfer.rgb(-100.0);
    assert!(r > 0.5 && g > 0.4 && b < 0.3, "fat is yellow: {r} {g} {b}");
    assert!(luminance(transfer.rgb(-900.0)) < 0.02, "air is dark");
    let [r, g, b] = transfer.rgb(900.0);
    assert!(r > 0.7 && g > 0.7 && b > 0.5, "bone is ivory: {r} {g} {b}");
    // Lung reaches below air and fat: neither stands in its way.
    let lung = tissue_colors("lung", [0.69, 0.38, 0.35], [-1100.0, -100.0]);
    assert!(luminance(lung.rgb(-700.0)) > 0.3);
}

#[test]
fn points_are_met_and_constant_beyond() {
    let points = [(100.0, [1.0, 0.0, 0.0]), (-50.0, [0.0, 0.0, 1.0]), (0.0, [0.2, 0.2, 0.2])];
    let transfer = TransferFunction::new(&points);
    let close = |hu: f32, expected: [f32; 3]| {
        let found = transfer.rgb(hu);
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{found:?} at {hu}, not {expected:?}");
    };
    for (hu, color) in points {
        close(hu, color);
    }
    close(-1e9, [0.0, 0.0, 1.0]);
    close(f32::NAN, [0.0, 0.0, 1.0]);
    close(1e9, [1.0, 0.0, 0.0]);
}

#[test]
fn the_capsule_veils_noise_and_hides_what_is_no_organ() {
    let capsule = Capsule { median: 50.0, window: [0.0, 125.0] };
    assert_eq!(capsule.hu(50.0), 50.0);
    let seen: Vec<f32> = (-1000..1000).map(|hu| capsule.hu(hu as f32)).collect();
    assert!(seen.is_sorted() && seen.iter().all(|hu| (0.0..=125.0).contains(hu)));
    assert!((capsule.hu(60.0) - 50.0).abs() < 5.0);
    assert!(capsule.hu(-1000.0) > 20.0, "air behind the border does not show");
    // A median outside a window of the user's.
    assert_eq!(Capsule { median: 500.0, window: [0.0, 125.0] }.hu(60.0), 125.0);
}

#[test]
fn detail_is_bounded_varied_and_fades_where_a_mesh_cannot_show_it() {
    for name in ["liver", "pancreas", "muscle", "fat", "spleen", "bone", "?"] {
        let detail = Detail::of_organ(name);
        let mut random = Random::new(3);
        let places: Vec<Point3> = (0..4000).map(|_| Point3::from(random.vector() * 300.0)).collect();
        let fine: Vec<f32> = places.iter().map(|&place| detail.at(place, 0.1)).collect();
        assert!(fine.iter().all(|value| value.abs() <= 1.0), "{name}");
        let mean = fine.iter().sum::<f32>() / fine.len() as f32;
        let spread = (fine.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / fine.len() as f32).sqrt();
        assert!(spread > 0.1, "{name}: {spread}");
        assert!(places.iter().all(|&place| detail.at(place, 10.0) == 0.0), "{name}: edges of 10 mm show nothing");
        assert!(places.iter().all(|&place| detail.at(place, f64::INFINITY) == 0.0), "{name}");
        // Continuous: a hundredth of a millimetre is not seen.
        let near = places
            .iter()
            .zip(&fine)
            .all(|(&place, value)| (detail.at(place + Vector3::new(0.004, -0.006, 0.006), 0.1) - value).abs() < 0.1);
        assert!(near, "{name}");
    }
}

/// A mesh with every attribute, some of them odd.
fn attributed() -> (TriangleMesh, Vec<bool>) {
    let lattice = build_cells(&block([7, 6, 5]), None).unwrap();
    let gradient = nalgebra::Matrix3::from_diagonal(&Vector3::new(1.4, 0.9, 1.0));
    let displacements = deformed(&lattice, gradient, middle(&lattice));
    let (mut mesh, on_cut) = surface(&lattice, &Topology::new(&lattice), &displacements);
    let count = mesh.positions.len();
    mesh.labels = (0..count).map(|n| (n % 3) as u16 * 30_000).collect();
    mesh.hu = (0..count).map(|n| n as f32 * 7.0 - 1000.0).collect();
    mesh.strains = (0..count).map(|n| n as f32 / count as f32).collect();
    mesh.speeds = (0..count).map(|n| if n == 3 { f32::NAN } else { n as f32 }).collect();
    (mesh, on_cut)
}

#[test]
fn paint_covers_every_vertex_with_colours_a_screen_can_show() {
    let (mesh, on_cut) = attributed();
    let transfer = tissue_colors("liver", [0.26, 0.04, 0.03], [0.0, 130.0]);
    let capsule = Capsule { median: 50.0, window: [0.0, 130.0] };
    let scale = |by| Paint::Scale(Legend { by, range: [0.0, 10.0], colormap: Colormap::Viridis });
    let paints = [
        Paint::Flat([0.1, 0.2, 0.3]),
        Paint::Labels,
        Paint::Tissue { transfer: &transfer, capsule, on_cut: &on_cut },
        scale(ColorBy::Hu),
        scale(ColorBy::Displacement),
        scale(ColorBy::Strain),
        scale(ColorBy::Speed),
    ];
    let rest = RestSurface::new(&mesh, &on_cut, 0.0);
    for paint in paints {
        let [one, two, four] = on_threads(|| {
            let mut painted = colors(&mesh, paint);
            add_detail(&mut painted, &rest, &mesh, Detail::of_organ("liver"), 1.0);
            painted
        });
        assert!(one == two && two == four, "{paint:?}");
        assert_eq!(one.len(), mesh.positions.len());
        assert!(one.iter().all(|&color| in_range(color)), "{paint:?}");
        let plain = colors(&mesh, paint);
        let changed = plain.iter().zip(&one).filter(|(a, b)| a != b).count();
        assert!(changed > plain.len() / 4, "{paint:?}: mottle shows at 3 mm");
        for (plain, detailed) in plain.iter().zip(&one) {
            for (a, b) in plain.iter().zip(detailed) {
                assert!((a - b).abs() <= AMPLITUDE * a + 1e-6, "{a} to {b}");
            }
        }
    }
}

#[test]
fn a_scale_shows_its_attribute() {
    let (mesh, _) = attributed();
    let legend = Legend { by: ColorBy::Displacement, range: [2.0, 8.0], colormap: Colormap::Viridis };
    let painted = colors(&mesh, Paint::Scale(legend));
    for (color, moved) in painted.iter().zip(&mesh.displacements) {
        let length = moved.iter().map(|c| c * c).sum::<f32>().sqrt();
        assert_eq!(*color, Colormap::Viridis.rgb((length - 2.0) / 6.0));
    }
    assert_eq!(legend.to_string(), format!("displacement, 2 to 8 mm, {}", Colormap::Viridis));
}
