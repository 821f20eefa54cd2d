//! Other answers that came out of the search and explain the data as well as the one that is given.

use crate::symmetry::axis::Axis;
use crate::symmetry::order::Order;
use crate::symmetry::search::{EQUALLY_GOOD_SEVERAL, Found, group_size};

/// Angle between axes that are not the same \[rad\].
pub(crate) const APART: f64 = 0.17;

/// Another axis explains the data about as well from here on [score of the best one].
pub(crate) const AS_WELL: f64 = 0.95;

/// Share of the surface that turns take out of sight, from which on several views tell no more than one: all from above, of a part
/// that lies on its side. About right axes of parts that something holds it is below 0.44, about wrong ones in scans of no part 0.5
/// to 0.8.
pub(crate) const MOSTLY_HIDDEN: f64 = 0.5;

/// Shares of the score of an axis from which on another one, of a group as large or larger, explains the data about as
/// well.
pub(crate) struct Likeness {
    of_equals: f64,
    of_larger: f64,
}

impl Likeness {
    pub(crate) fn sought(declared: Order, one_view: bool, is_seen: bool, hidden: f64) -> Self {
        /// A wall seen from the side turns as well about its own edges. In 46 views of the faces of parts of an order above
        /// two no other axis came nearer than 0.72.
        const DECLARED: f64 = 0.8;
        /// A larger group hides more of itself, and matches less for that.
        const HIDING: f64 = 0.6;
        let [of_equals, of_larger] = match declared {
            Order::Auto if one_view => [AS_WELL, HIDING],
            Order::Auto if is_seen => [AS_WELL, EQUALLY_GOOD_SEVERAL],
            Order::Cyclic(_) if one_view || hidden > MOSTLY_HIDDEN => [DECLARED; 2],
            _ => [AS_WELL; 2],
        };
        Self { of_equals, of_larger }
    }
}

/// Says so when another axis than `axis` came out of the search that explains the data about as well, as for a cube.
pub(crate) fn ambiguity_of_axes(
    axis: &Axis,
    chosen: &Found,
    candidates: &[Found],
    likeness: &Likeness,
) -> Option<String> {
    let size = |found: &Found| found.order.map_or(0, group_size);
    let score = |found: &Found| found.proposal.score.value();
    let is_apart = |found: &Found| found.proposal.axis.angle_to(axis) > APART;
    // The refinement may lead from a rough start to where a better one of the candidates is, too.
    let here = candidates.iter().filter(|found| !is_apart(found) && size(found) >= size(chosen));
    let best_here = here.map(score).fold(score(chosen), f64::max);
    let other = candidates.iter().find(|other| {
        let least = if size(other) > size(chosen) { likeness.of_larger } else { likeness.of_equals };
        score(other) >= least * best_here
            && size(other) >= size(chosen)
            && is_apart(other)
            && !std::ptr::eq(*other, chosen)
    })?;
    Some(another_axis(other.proposal.axis.angle_to(axis)))
}

/// Says that an axis at an `angle` \[rad\] to the one answered explains the data about as well.
pub(crate) fn another_axis(angle: f64) -> String {
    let degrees = angle.to_degrees();
    format!("ambiguous: another axis, {degrees:.0} degrees away, explains the data about as well")
}

/// Other orders that came out of the search about nearly the same axis and explain the data as well as any there, each with its
/// first axis, but for those that follow from `order`, or that it follows from: teeth of which few are in sight fit those of another
/// number if the axis gives way.
pub(crate) fn other_orders(axis: &Axis, order: Order, candidates: &[Found]) -> Vec<(u32, Axis)> {
    let Order::Cyclic(n) = order else { return Vec::new() };
    let score = |found: &Found| found.proposal.score.value();
    let here = || candidates.iter().filter(|found| found.proposal.axis.angle_to(axis) <= APART);
    let best = here().map(score).fold(0.0, f64::max);
    let mut others: Vec<(u32, Axis)> = Vec::new();
    for found in here().filter(|found| score(found) >= AS_WELL * best) {
        if let Some(Order::Cyclic(m)) = found.order
            && !(m.is_multiple_of(n) || n.is_multiple_of(m))
            && others.iter().all(|(other, _)| *other != m)
        {
            others.push((m, found.proposal.axis));
        }
    }
    others
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::symmetry::propose::Proposal;
    use crate::symmetry::score::MatchScore;

    /// A candidate of order `n` about an axis so far from z \[rad\], with `matched` of 100 points that match.
    fn candidate(n: u32, angle: f64, matched: usize) -> Option<Found> {
        let axis = Axis::new(Vector3::new(angle.sin(), 0.0, angle.cos()), Vector3::zeros())?;
        let score = MatchScore { matched, missing: 100 - matched, ..MatchScore::default() };
        let order = Order::Cyclic(n);
        Some(Found {
            proposal: Proposal { axis, score },
            order: Some(order),
            hypothesis: order,
            explained: 1.0,
        })
    }

    /// Candidates, each given by order, angle and matches of 100.
    fn candidates(given: &[(u32, f64, usize)]) -> Result<Vec<Found>, &'static str> {
        let found: Option<Vec<Found>> =
            given.iter().map(|&(n, angle, matched)| candidate(n, angle, matched)).collect();
        found.ok_or("no candidates")
    }

    #[test]
    fn a_better_start_at_the_same_axis_speaks_for_it() -> Result<(), &'static str> {
        let axis = Axis::new(Vector3::z(), Vector3::zeros()).ok_or("no axis")?;
        let likeness = Likeness::sought(Order::Auto, false, true, 0.0);
        let is_ambiguous = |given: &[(u32, f64, usize)]| -> Result<bool, &'static str> {
            let candidates = candidates(given)?;
            let chosen = candidates.first().ok_or("no candidates")?;
            Ok(ambiguity_of_axes(&axis, chosen, &candidates, &likeness).is_some())
        };
        assert!(is_ambiguous(&[(2, 0.03, 88), (3, 0.5, 70)])?);
        // Of the same order, or of a larger group.
        assert!(!is_ambiguous(&[(2, 0.03, 88), (3, 0.5, 70), (2, 0.0, 98)])?);
        assert!(!is_ambiguous(&[(2, 0.03, 88), (3, 0.5, 70), (20, 0.0, 98)])?);
        // A smaller group may match better where its axis is wrong.
        assert!(is_ambiguous(&[(3, 0.03, 88), (4, 0.5, 70), (2, 0.0, 98)])?);
        Ok(())
    }

    #[test]
    fn another_order_about_the_same_axis_makes_an_order_ambiguous() -> Result<(), &'static str> {
        let axis = Axis::new(Vector3::z(), Vector3::zeros()).ok_or("no axis")?;
        let found = |given: &[(u32, f64, usize)]| -> Result<Vec<u32>, &'static str> {
            let others = other_orders(&axis, Order::Cyclic(18), &candidates(given)?);
            Ok(others.into_iter().map(|(m, _)| m).collect())
        };
        assert_eq!(found(&[(18, 0.0, 96), (17, 0.0, 96), (13, 0.0, 96), (17, 0.0, 95)])?, [17, 13]);
        // One follows from the other.
        assert!(found(&[(18, 0.0, 96), (6, 0.0, 97), (36, 0.0, 95)])?.is_empty());
        // It fits worse, or about another axis.
        assert!(found(&[(18, 0.0, 96), (17, 0.0, 80), (5, 0.3, 99)])?.is_empty());
        Ok(())
    }
}
