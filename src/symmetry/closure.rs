//! What no camera saw: the surface of a part is closed, so what faces up somewhere must face down somewhere else.
//!
//! Seen from above, a part lacks its underside and its centroid lies too high: by far the largest error along the axis.
//! The area that is missing is known, since the flux of a constant field through a closed surface vanishes: the sum of
//! area times the component of the normal along the axis is what the unseen side must make up for, ring by ring. Where
//! it lies is not known. Between blades the lower edge is in sight, so the unseen side is put there; a ring without a
//! gap is taken to reach down to the end of the part.

use crate::symmetry::complete::{Completion, FoldedCell};

/// Rings from the axis to the rim.
const RINGS: usize = 40;

/// Share of a ring that must face one way for it to have no gap.
const WITHOUT_GAP: f64 = 0.8;

/// Share of the missing area that is put in place; the rest was seen from elsewhere or is steep.
const SHARE: f64 = 0.8;

/// Cells of a ring beyond its edge, which noise has thrown there \[share\].
const STRAY: f64 = 0.02;

/// Area and first moment along the axis of the surface that was not seen.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Unseen {
    /// Area [squared cell edges].
    pub area: f64,
    /// Area times height [squared cell edges times length].
    pub moment: f64,
}

/// Finds the unseen surface of a completed part between its lower and upper end; the normals must point outward.
#[must_use]
pub fn unseen(completion: &Completion, [lower, upper]: [f64; 2]) -> Unseen {
    let rim = completion.cells.iter().map(FoldedCell::radius).fold(f64::MIN_POSITIVE, f64::max);
    let width = rim / RINGS as f64;
    let mut rings: Vec<Vec<&FoldedCell>> = vec![Vec::new(); RINGS];
    for cell in &completion.cells {
        rings[((cell.radius() / width) as usize).min(RINGS - 1)].push(cell);
    }
    let mut unseen = Unseen::default();
    for (i, ring) in rings.iter().enumerate() {
        let flux: f64 = ring.iter().map(|c| c.area * c.slope).sum();
        let facing: f64 = ring.iter().map(|c| c.area * (c.slope * flux.signum()).max(0.0)).sum();
        let whole = std::f64::consts::TAU * (i as f64 + 0.5) * (width / completion.cell).powi(2);
        let end = if facing >= WITHOUT_GAP * whole {
            if flux > 0.0 { lower } else { upper }
        } else {
            let near = rings[i.saturating_sub(1)..(i + 2).min(RINGS)].concat();
            edge(near, flux > 0.0)
        };
        unseen.area += SHARE * flux.abs();
        unseen.moment += SHARE * flux.abs() * end;
    }
    unseen
}

/// Lower or upper edge of some cells.
fn edge(cells: Vec<&FoldedCell>, lower: bool) -> f64 {
    let mut heights: Vec<f64> = cells.iter().map(|c| c.position.z).collect();
    if heights.is_empty() {
        return 0.0;
    }
    let stray = (STRAY * heights.len() as f64) as usize;
    let rank = if lower { stray } else { heights.len() - 1 - stray };
    *heights.select_nth_unstable_by(rank, f64::total_cmp).1
}
