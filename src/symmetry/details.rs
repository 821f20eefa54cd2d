//! Details that lower a symmetry: bolt holes on a disc, or on a sprocket with many more teeth.
//!
//! They cover so little of their ring that few of its points meet them at any one angle, and their evidence drowns in that of the
//! rest. So each ring is asked alone whether something contradicts the group that holds for all the others, and where it does,
//! which part of the group holds there.

use std::collections::{BTreeSet, HashMap, HashSet};

use rayon::prelude::*;

use crate::symmetry::axis::Axis;
use crate::symmetry::detect::{DetectParams, largest_group};
use crate::symmetry::order::{Order, Turns};
use crate::symmetry::rings::{Ring, Rings};
use crate::symmetry::score::outcome;
use crate::symmetry::sight::Sight;
use crate::symmetry::surface::{Gate, Surface};
use crate::symmetry::sweep::{Sweep, Tally, fraction};

/// Details that contradict the group that holds for all the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Details {
    /// A part of the group holds for them, too.
    OfOrder {
        /// The order of that part.
        order: u32,
        /// The larger one of all but these details.
        rest: Order,
    },
    /// None does: a recess in one end of a plate, or teeth that are finer than the orders that are looked for.
    OfNone,
}

/// The details that contradict a group `order` which holds otherwise.
pub(crate) fn contradicting_details(
    surface: &Surface,
    axis: &Axis,
    gate: Gate,
    sight: Sight<'_>,
    order: Order,
    params: &DetectParams,
) -> Option<Details> {
    /// Points that are asked, and for how many rotations of them at least; rotations of a surface of revolution.
    const ASKED: usize = 5000;
    const ROTATED: usize = 30_000;
    const TURNS: usize = 24;
    /// Share of the evidence in a ring that must speak against the group, and the least amount of it.
    const CONTRADICTED: (f64, f64) = (0.006, 8.0);
    /// Points of these rings.
    const SAMPLES: usize = 1500;
    /// Share of the evidence against the group that may speak against a part of it, on average and at the worst angle.
    const LEFT: [f64; 2] = [0.25, 0.5];
    /// Evidence against it that there would be by chance.
    const EXPECTED: f64 = 12.0;
    /// Share of the evidence in these rings that must speak against the group where no part of it holds, and the least amount
    /// of it: less may come from returns that strayed into a hole.
    const MISFIT: (f64, f64) = (0.1, 40.0);
    /// Distance of a match beside that elsewhere: the rim of a hole must not match what comes to lie in it, and where there is
    /// a surface no ray goes on behind it, so that nothing speaks against points that miss it.
    const NARROW: f64 = 0.7;
    let gate = Gate { distance: NARROW * gate.distance, ..gate };
    let turns: Vec<_> = Turns::all(order, TURNS).angles().map(|angle| axis.turn(angle)).collect();
    let asked = surface.samples.strided(ASKED.max(ROTATED / turns.len()));
    let rings = Rings::about(axis, &asked);
    let evidence: Vec<Tally> = (asked.points.par_iter().zip(&asked.normals))
        .map(|(point, normal)| {
            let mut tally = Tally::default();
            turns.iter().for_each(|turn| tally.add(outcome(surface, point, normal, turn, gate, sight)));
            tally
        })
        .collect();
    let mut tallies: HashMap<Ring, Tally> = HashMap::new();
    for (point, tally) in asked.points.iter().zip(&evidence) {
        tallies.entry(rings.of(point)).or_default().merge(tally);
    }
    let contradicted =
        |tally: &Tally| tally.share_against() > CONTRADICTED.0 && tally.against() > CONTRADICTED.1;
    let with_details: HashSet<Ring> =
        tallies.into_iter().filter(|(_, tally)| contradicted(tally)).map(|(ring, _)| ring).collect();
    if with_details.is_empty() {
        return None;
    }
    let samples = rings.within(&with_details, &surface.samples, SAMPLES);
    let (fractions, parts): (Vec<_>, Vec<u32>) = match order {
        Order::Cyclic(n) => {
            let fractions: BTreeSet<(u32, u32)> = (1..=n / 2).map(|k| fraction(k, n)).collect();
            (fractions.into_iter().collect(), (2..n).filter(|&part| n.is_multiple_of(part)).collect())
        }
        _ => (params.fractions(), (2..=params.max_order).collect()),
    };
    let sweep = Sweep::new(surface, &samples, axis, fractions, gate, sight);
    let everything: Vec<usize> = (0..samples.points.len()).collect();
    let against = match order {
        Order::Cyclic(n) => sweep.order(n, &everything).sum,
        _ => sweep.generic(&everything),
    };
    let share = against.share_against();
    if share * against.total() < EXPECTED {
        return None;
    }
    let holding: Vec<(u32, f64)> = (parts.into_iter())
        .map(|part| (part, sweep.order(part, &everything)))
        .filter(|(_, evidence)| {
            evidence.sum.share_against() < LEFT[0] * share
                && evidence.worst < LEFT[1] * share
                && share * evidence.sum.total() > EXPECTED
        })
        .map(|(part, evidence)| (part, evidence.sum.share_against()))
        .collect();
    match largest_group(&holding) {
        Some((part, _)) => Some(Details::OfOrder { order: part, rest: order }),
        None => (share > MISFIT.0 && against.against() > MISFIT.1).then_some(Details::OfNone),
    }
}
