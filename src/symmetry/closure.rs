//! What no camera saw: the surface of a part is closed, so what faces up somewhere must face down somewhere else.
//!
//! Seen from above, a part lacks its underside and its centroid lies too high: by far the largest error along the axis.
//! The area that is missing is known, since the flux of a constant field through a closed surface vanishes: the sum of
//! area times the component of the normal along the axis is what the unseen side must make up for, ring by ring. Where
//! it lies is not known. Between blades the lower edge is in sight, so the unseen side is put there; a ring without a
//! gap is taken to reach down to the end of the part.

use rayon::prelude::*;

use crate::symmetry::fold::{Folded, FoldedPoint};

/// Rings from the axis to the rim.
const RINGS: usize = 40;

/// Share of a ring that faces one way: below the first it has gaps, above the second it has none.
const GAP: [f64; 2] = [0.7, 0.9];

/// Share of the missing area that is put in place; the rest was seen from elsewhere or is steep.
const SHARE: f64 = 0.8;

/// Area of a ring that makes its edge \[share\]; enough of it that noise does not.
const EDGE: f64 = 0.04;

/// Area and first moment along the axis of the surface that was not seen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Unseen {
    /// Area [squared length].
    pub area: f64,
    /// Area times height [cubed length].
    pub moment: f64,
}

/// Finds the unseen surface of a folded part between its lower and upper end; the normals must point outward.
#[must_use]
pub(crate) fn unseen(folded: &Folded, [lower, upper]: [f64; 2]) -> Unseen {
    let rim = folded.points.iter().map(|p| p.radius).fold(f64::MIN_POSITIVE, f64::max);
    let width = rim / RINGS as f64;
    // A point counts in both rings whose middles it lies between, so that none decides by the ring it falls into.
    let mut rings: Vec<Vec<(&FoldedPoint, f64)>> = vec![Vec::new(); RINGS];
    for point in &folded.points {
        let position = (point.radius / width - 0.5).clamp(0.0, (RINGS - 1) as f64);
        let (inner, share) = (position as usize, position.fract());
        rings[inner].push((point, (1.0 - share) * point.area));
        if share > 0.0 {
            rings[inner + 1].push((point, share * point.area));
        }
    }
    let of_ring = |(i, ring): (usize, &Vec<(&FoldedPoint, f64)>)| {
        let flux: f64 = ring.iter().map(|(p, area)| area * p.slope).sum();
        let facing: f64 = ring.iter().map(|(p, area)| area * (p.slope * flux.signum()).max(0.0)).sum();
        let whole = std::f64::consts::TAU * (i as f64 + 0.5) * width * width;
        let full = ((facing / whole - GAP[0]) / (GAP[1] - GAP[0])).clamp(0.0, 1.0);
        let end = if flux > 0.0 { lower } else { upper };
        let height = full * end + (1.0 - full) * edge(ring, flux > 0.0);
        let area = SHARE * flux.abs();
        Unseen { area, moment: area * height }
    };
    let unseen: Vec<Unseen> = rings.par_iter().enumerate().map(of_ring).collect();
    Unseen { area: unseen.iter().map(|u| u.area).sum(), moment: unseen.iter().map(|u| u.moment).sum() }
}

/// Lower or upper edge of a ring.
fn edge(ring: &[(&FoldedPoint, f64)], lower: bool) -> f64 {
    let mut heights: Vec<(f64, f64)> = ring.iter().map(|(p, area)| (p.height, *area)).collect();
    heights.sort_unstable_by(|a, b| if lower { a.0.total_cmp(&b.0) } else { b.0.total_cmp(&a.0) });
    tail(&heights, EDGE * heights.iter().map(|(_, area)| area).sum::<f64>())
}

/// Mean of the first of some heights, those of as much area as `within`; each comes with its area.
///
/// A quantile would jump where a step has just that much area; a mean moves as little as the area does.
#[must_use]
pub(crate) fn tail(heights: &[(f64, f64)], within: f64) -> f64 {
    let (mut sum, mut moment) = (0.0, 0.0);
    for (height, area) in heights {
        let area = area.min(within - sum);
        sum += area;
        moment += area * height;
        if sum >= within {
            break;
        }
    }
    if sum > 0.0 { moment / sum } else { 0.0 }
}
