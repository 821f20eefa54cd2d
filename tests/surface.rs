//! Nearest points by lookup against a search through all points.

use proptest::prelude::*;
use sympose::config::Residual;
use sympose::nalgebra::Vector3;
use sympose::symmetry::axis::Axis;
use sympose::symmetry::detect::DetectParams;
use sympose::symmetry::order::{Order, Turns};
use sympose::symmetry::propose::ProposeParams;
use sympose::symmetry::refine::{Aligner, RefineParams};
use sympose::symmetry::search::{HYPOTHESES, SearchContext, search_known, search_unknown};
use sympose::symmetry::surface::{Gate, Samples, Surface};
use sympose::{Control, Error};

const SPACING: f64 = 0.02;

/// A bumpy sheet, rolled up to an open tube: both of its sides, several layers of tiles.
fn tube(points: usize, bumps: f64) -> Samples {
    let place = |i: usize| {
        let turn = 5.0 * (i as f64 * 0.618_033_988_749_894_9).fract();
        let height = i as f64 / points as f64 - 0.5;
        let radius = 0.5 + bumps * (7.0 * turn).sin() * (11.0 * height).cos();
        Vector3::new(radius * turn.cos(), radius * turn.sin(), height)
    };
    let points: Vec<Vector3<f64>> = (0..points).map(place).collect();
    let normals = points.iter().map(|p| Vector3::new(p.x, p.y, 0.0).normalize()).collect();
    Samples { points, normals }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[test]
fn rotations_of_an_order_tell_it_from_all_its_parts() {
    for n in 2..=360 {
        let generating = |count: u32| (1..=count).filter(|&k| gcd(k, n) == 1).count();
        for max in [1, 5, 12] {
            for (turns, count) in
                [(Turns::half(Order::Cyclic(n), max), n / 2), (Turns::all(Order::Cyclic(n), max), n - 1)]
            {
                let steps: Vec<u32> = turns
                    .angles()
                    .map(|angle| (angle / std::f64::consts::TAU * f64::from(n)).round() as u32)
                    .collect();
                assert_eq!(steps.len(), max.min(count as usize), "order {n}, at most {max}");
                assert!(steps.is_sorted() && steps.iter().all(|step| (1..=count).contains(step)));
                let found = steps.iter().filter(|&&step| gcd(step, n) == 1).count();
                assert_eq!(found, max.min(generating(count)), "order {n}, at most {max}");
            }
        }
    }
}

#[test]
fn a_surface_without_a_spacing_is_refused_and_ends() {
    let samples = tube(500, 0.05);
    let flat = Surface::new(samples.clone(), true, 0.0, 0.0);
    assert_eq!(flat.len(), 500);
    let axis = Axis::new(Vector3::z(), Vector3::zeros());
    let (turns, params) = (Turns::half(Order::Cyclic(5), 5), RefineParams::default());
    let residual = Residual::PointToPlane;
    let surface = Surface::new(samples.clone(), true, SPACING, 0.5);
    let aligner = Aligner { surface: &surface, samples: &samples, turns: &turns, residual, params: &params };
    let control = Control::new();
    for gates in [[0.1, 0.0], [0.1, -1.0], [f64::INFINITY, 0.1], [0.1, f64::NAN]] {
        let align = axis.map(|axis| aligner.align(axis, gates, &control));
        assert!(matches!(align, Some(Err(Error::InvalidParameter { name: "gates", .. }))), "{gates:?}");
        let beside = axis.map(|axis| aligner.align_from_beside(axis, gates, &control));
        assert!(matches!(beside, Some(Err(Error::InvalidParameter { name: "gates", .. }))), "{gates:?}");
    }
    let context = SearchContext {
        diameter: 1.0,
        hints: &[],
        within: None,
        visibility: None,
        propose: &ProposeParams::default(),
        detect: &DetectParams::default(),
        gate: Gate::new(0.05, 0.8),
        control: &control,
    };
    let known = search_known(&flat, Order::Cyclic(5), &context);
    assert!(matches!(known, Err(Error::InvalidParameter { name: "gates", .. })));
    let unknown = search_unknown(&flat, &HYPOTHESES, &context);
    assert!(matches!(unknown, Err(Error::InvalidParameter { name: "gates", .. })));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(100) })]

    #[test]
    fn the_table_knows_the_nearest_point(
        count in 1_usize..6000,
        bumps in 0.0..0.1,
        reach in 0.5..11.0,
        offsets in prop::collection::vec((0.0..1.0, prop::array::uniform3(-1.0..1.0_f64)), 200),
    ) {
        let samples = tube(count, bumps);
        let surface = Surface::new(samples.clone(), true, SPACING, 0.5);
        let gate = Gate::new(reach * SPACING, -1.0);
        let normal = Vector3::x();
        // The tables are as coarse as a spacing near by and three farther away. A point clearly farther than the nearest
        // one is found only where both are about as far from the middle of a cell.
        let cell = if reach <= 3.0 { SPACING } else { 3.0 * SPACING };
        let farthest = 3_f64.sqrt() * cell;
        let mut missed = 0;
        for (at, [x, y, z]) in &offsets {
            let middle = samples.points[(at * count as f64) as usize];
            let query = middle + Vector3::new(*x, *y, *z) * (2.0 * gate.distance);
            let distance = |p: &Vector3<f64>| (p - query).norm();
            let nearest = samples.points.iter().map(distance).fold(f64::INFINITY, f64::min);
            match surface.matching(&query, &normal, gate).map(|i| distance(&samples.points[i as usize])) {
                Some(found) => {
                    prop_assert!(found < gate.distance && found < nearest + farthest);
                    missed += usize::from(found > nearest + 0.2 * cell);
                }
                None => {
                    prop_assert!(nearest > gate.distance - farthest);
                    missed += usize::from(nearest < gate.distance - 0.2 * cell);
                }
            }
        }
        let most = if reach <= 3.0 { offsets.len() / 10 } else { offsets.len() / 3 };
        prop_assert!(missed <= most, "{missed} of {}", offsets.len());
    }
}
