//! What the caller should know about an answer: the warnings of an estimate.

use nalgebra::Vector3;

use crate::prepare::Prepared;
use crate::rivals::{Likeness, MOSTLY_HIDDEN, ambiguity_of_axes};
use crate::symmetry::axis::Axis;
use crate::symmetry::closeness::CloserPart;
use crate::symmetry::details::Details;
use crate::symmetry::detect::{DetectParams, Detection};
use crate::symmetry::order::Order;
use crate::symmetry::overlap::Conflict;
use crate::symmetry::score::MatchScore;
use crate::symmetry::search::Found;
use crate::symmetry::surface::Surface;
use crate::symmetry::view_errors::Spread;
use crate::symmetry::visibility::Visibility;

/// What is remarked on an answer.
pub(crate) struct Remarks {
    pub warnings: Vec<String>,
    /// Another answer may be the right one: this one deserves less trust.
    pub ambiguous: bool,
    /// What the cameras saw does not allow the declared order about this axis.
    pub doubted: bool,
}

/// An axis, with the order that holds about it and what speaks for both.
pub(crate) struct Answer<'a> {
    /// Order that the caller gave.
    pub declared: Order,
    /// The axis, refined.
    pub axis: &'a Axis,
    /// What becomes of the surface under the turns of the order.
    pub score: &'a MatchScore,
    /// The order found about it.
    pub detection: &'a Detection,
    /// Another order that holds as well about nearly the same axis.
    pub rival: Option<u32>,
    /// How it was found.
    pub detect: &'a DetectParams,
    /// The part.
    pub prepared: &'a Prepared,
}

/// All that the caller should know about an `answer`, refined from the one `chosen` of the `candidates`.
pub(crate) fn remarks(answer: &Answer, chosen: &Found, candidates: &[Found]) -> Remarks {
    let &Answer { declared, axis, score, detection, prepared, .. } = answer;
    let visibility = prepared.visibility.as_ref();
    let is_open = declared == Order::Auto;
    let unseen_half = answer.unseen_half();
    let ambiguous_half = unseen_half.as_ref().filter(|half| half.is_ambiguous());
    let ambiguity = (answer.ambiguous_order())
        .or_else(|| ambiguity_of_axes(axis, chosen, candidates, &answer.likeness()))
        .or_else(|| answer.rival.map(rival))
        .or_else(|| out_of_sight(declared, score).filter(|_| prepared.one_view()))
        .or_else(|| beyond_sight(&prepared.surface, score, visibility.is_some()))
        .or_else(|| ambiguous_half.map(UnseenHalf::remark));
    let doubted = !is_open && visibility.is_some() && !detection.allows(declared);
    let ambiguous = ambiguity.is_some() || (doubted && answer.is_ruled_out());
    let mut warnings: Vec<String> = order_warning(declared, detection).into_iter().chain(ambiguity).collect();
    if is_open {
        warnings.extend((!prepared.outward).then(|| UNSEEN.to_owned()));
        warnings.extend(missing_returns(prepared));
        warnings.extend(unseen_half.filter(|half| !half.is_ambiguous()).map(|half| half.remark()));
        warnings.extend(prepared.sight(axis).unseen().map(unseen_sector));
        warnings.extend(details(detection).filter(|_| answer.too_fine().is_none()));
        warnings.extend(visibility.and_then(|v| few_points(detection, v, prepared)));
    }
    warnings.extend(thing_beside(prepared.beside));
    Remarks { warnings, ambiguous, doubted }
}

impl Answer<'_> {
    /// Whether the order was found in one view, or in what is taken for one.
    fn is_found_in_one_view(&self) -> bool {
        self.declared == Order::Auto
            && (self.prepared.one_view() || self.prepared.surface.assumed_view.is_some())
    }

    /// Says so when the order that was found may be another one.
    fn ambiguous_order(&self) -> Option<String> {
        let &Self { declared, axis, score, detection, prepared, .. } = self;
        if declared != Order::Auto {
            return None;
        }
        if prepared.visibility.as_ref().is_some_and(|v| v.is_patchy) {
            return Some(patchy(score));
        }
        let one_view = self.is_found_in_one_view();
        let assumed = prepared.surface.assumed_view.map(|place| place - prepared.surface.centroid);
        let toward_sensors = prepared.toward_sensors.or(assumed).filter(|_| one_view);
        (toward_sensors.and_then(|toward| side_view(axis, &toward)))
            .or_else(|| half_turn(detection, one_view, !prepared.outward))
            .or_else(|| revolution(detection).filter(|_| !prepared.outward))
            .or_else(|| detection.rival.map(rival))
            .or_else(|| detection.faint.then(|| FAINT.to_owned()))
            .or_else(|| self.too_fine())
    }

    fn too_fine(&self) -> Option<String> {
        too_fine(self.detection).filter(|_| self.is_found_in_one_view())
    }

    fn unseen_half(&self) -> Option<UnseenHalf> {
        UnseenHalf::found(self.detection, self.score)
            .filter(|_| self.declared == Order::Auto && self.prepared.several_views())
    }

    /// Whether what speaks against a declared order that is not allowed is more than a few details or lost returns.
    fn is_ruled_out(&self) -> bool {
        if self.prepared.one_view() {
            return !self.score.lacks_returns_only();
        }
        let explained = self.score.explained();
        self.detection.contradicts(self.declared, explained, self.detect)
            || self.score.hidden_share() > MOSTLY_HIDDEN
    }

    fn likeness(&self) -> Likeness {
        let one_view = self.is_found_in_one_view() || self.prepared.one_view();
        let is_seen = self.prepared.visibility.is_some();
        Likeness::sought(self.declared, one_view, is_seen, self.score.hidden_share())
    }
}

/// Remark on an order that was found without knowing what was seen from where.
const UNSEEN: &str = "the order was found without viewpoints, where hidden surface looks like missing surface: give them \
                      ([0, 0, 0] for points in the frame of the camera), or the order";

/// Remark on an order that might be another one, or none.
const FAINT: &str = "ambiguous: hardly anything in sight tells this order from others, or from none: declare it, or add a \
                     view";

/// Remark on a group that exchanges pieces of the surface.
pub(crate) const LIKE_PIECES: &str = "each turn takes a piece of the scan to another one, and nothing joins them: \
                                      where they are several like parts, set roi to one of them";

/// Remark on a piece of the surface far from all the rest.
pub(crate) const PIECE_APART: &str = "a large piece of the scan is far from all the rest, and nothing joins them: where \
                                      they are several parts, set roi to one of them";

/// Says so when another thing on the support is so large, as a share of the one answered for, that it may be the part.
fn thing_beside(share: f64) -> Option<String> {
    const LARGE: f64 = 0.3;
    (share > LARGE).then(|| {
        format!(
            "another thing, {:.0} % as large, stands beside what was answered for and was left out: if the part is that one, \
             or both, set roi",
            100.0 * share
        )
    })
}

/// Says so when an order of two was found where little could contradict it: half of a part, as `one_view` shows it, seldom
/// contradicts a half turn about some axis, and nothing does where it is `unknown` what was seen.
fn half_turn(detection: &Detection, one_view: bool, unknown: bool) -> Option<String> {
    /// Share of the observed surface that a half turn must map to itself where no viewpoint is known.
    const MAPPED: f64 = 0.9;
    if detection.order != Some(Order::Cyclic(2)) {
        return None;
    }
    if one_view {
        return Some(
            "ambiguous: one view shows too little to tell a part of order 2 from others: declare the order, or add a \
             view"
                .to_owned(),
        );
    }
    (unknown && detection.explained < MAPPED).then(|| {
        let percent = 100.0 * (1.0 - detection.explained);
        format!(
            "ambiguous: a half turn brings {percent:.0} % of the surface to where nothing was measured: give the \
             viewpoints, or declare the order"
        )
    })
}

/// Share of the surface that a half turn brings to where no view shows anything, as it brings the mouth of a mug to its
/// underside.
struct UnseenHalf(f64);

impl UnseenHalf {
    fn found(detection: &Detection, score: &MatchScore) -> Option<Self> {
        /// From which on it is worth a remark.
        const MUCH: f64 = 0.25;
        let share = score.hidden_share();
        (detection.order == Some(Order::Cyclic(2)) && share > MUCH).then_some(Self(share))
    }

    /// Whether too little is left in sight to tell.
    fn is_ambiguous(&self) -> bool {
        /// Share that may go out of sight.
        const MOST: f64 = 2.0 / 3.0;
        self.0 > MOST
    }

    fn remark(&self) -> String {
        format!(
            "{}the half turn brings {:.0} % of the surface out of sight, where nothing can contradict it: add a view of that, or \
             declare the order",
            if self.is_ambiguous() { "ambiguous: " } else { "" },
            100.0 * self.0
        )
    }
}

/// Says so when the turns of an order take much of the only view out of sight, where they cannot be contradicted: a
/// two-bladed propeller seen edge-on looks two-fold about other axes, too.
fn out_of_sight(declared: Order, score: &MatchScore) -> Option<String> {
    // What may go out of sight: right answers to views of a face have less.
    let most = match declared {
        Order::Cyclic(2) => 1.0 / 3.0,
        Order::Auto => 0.75,
        _ => return None,
    };
    let share = score.hidden_share();
    (share > most).then(|| {
        format!(
            "ambiguous: the symmetry brings {:.0} % of what the only view shows out of sight, and another axis may explain \
             it as well: add a view",
            100.0 * share
        )
    })
}

/// Says so when turns take a part of a flat surface to where no camera looked, or, where it is not known what was seen, to where
/// nothing was measured: nothing of it hides anything else, so that it ends there, or was cut off, as a piece of a table is.
fn beyond_sight(surface: &Surface, score: &MatchScore, is_seen: bool) -> Option<String> {
    /// Share of it that may come to lie there: noise at the rim.
    const MOST: f64 = 0.03;
    let (share, there) = if is_seen {
        (score.hidden_share(), "no camera looked")
    } else {
        (1.0 - score.explained(), "nothing was measured")
    };
    (share > MOST && surface.is_flat()).then(|| {
        format!(
            "ambiguous: all that was measured lies in one plane, and the symmetry brings {:.0} % of it to where {there}: the part \
             may go on there, or be another one",
            100.0 * share
        )
    })
}

/// Says so when a surface of revolution was found without viewpoints, and much of the part meets nothing at other angles.
fn revolution(detection: &Detection) -> Option<String> {
    /// Share of the observed surface that other angles must explain. Bolt holes, spokes and the handle of a mug leave less;
    /// so does what was hidden.
    const MAPPED: f64 = 0.85;
    (detection.order == Some(Order::Continuous) && detection.explained < MAPPED).then(|| {
        let percent = 100.0 * (1.0 - detection.explained);
        format!(
            "ambiguous: {percent:.0} % of a surface of revolution would be hidden, or the part has features that are not \
             round: give the viewpoints, or declare the order"
        )
    })
}

/// What the caller should know when the data says something else than the declared order.
pub(crate) fn order_warning(declared: Order, detection: &Detection) -> Option<String> {
    match (declared, detection.order) {
        (Order::Auto, _) => None,
        (declared, Some(found)) if declared == found => None,
        // A part of an order too large to be looked for is no better explanation.
        (Order::Cyclic(n), Some(Order::Cyclic(found))) if found < n && detection.allows(declared) => None,
        (declared, Some(found)) => {
            Some(format!("order {declared} was declared, but left open order {found} would have been found"))
        }
        (declared, None) => Some(format!(
            "order {declared} was declared, but nothing about this axis confirms it, or any other one: the best one leaves \
             {:.0} % of the observed surface unexplained",
            100.0 * (1.0 - detection.explained)
        )),
    }
}

/// Says so when the sensor loses so much that gaps in the part are hard to tell from gaps in the scan. Where viewpoints are wrong
/// nothing tells what should have been seen.
pub(crate) fn missing_returns(prepared: &Prepared) -> Option<String> {
    /// Returns lost for each that comes.
    const MANY: f64 = 0.05;
    let dropout = prepared.visibility.as_ref()?.dropout;
    (dropout > MANY && wrong_viewpoints(prepared).is_none()).then(|| {
        let percent = 100.0 * dropout / (1.0 + dropout);
        let about = if dropout < 1.0 { "about" } else { "at least" };
        format!(
            "{about} {percent:.0} % of the returns are missing where a surface should be seen: gaps in the part look like \
             gaps in the scan, so declare the order where it is known"
        )
    })
}

/// Says that a part of a group of order `n` holds more closely than the whole.
pub(crate) fn closer_part_holds(n: u32, part: &CloserPart, diameter: f64) -> String {
    let percent = |distance: f64| 100.0 * distance / diameter;
    format!(
        "order {n} holds less closely than order {}: 19 of 20 points come to within {:.2} % of the diameter of the surface, not \
         {:.2} %; declare {} where that matters",
        part.order,
        percent(part.others_within),
        percent(part.within),
        part.order
    )
}

/// Says so when views are off their places by more than the noise of what they measure.
pub(crate) fn misplaced_views(prepared: &Prepared) -> Option<String> {
    /// Distance at the rim from which they matter [diameters].
    const FAR: f64 = 0.001;
    /// The same that noise and the edges of thin blades do not bring about [noise of a measurement].
    const CLEAR: f64 = 1.0;
    let Spread { shift, turn, noise, .. } = prepared.view_errors.as_ref()?.spread?;
    let at_rim = shift.hypot(turn * prepared.surface.radius);
    (at_rim > FAR * prepared.diameter && at_rim > CLEAR * noise).then(|| {
        format!(
            "the views do not fit each other: in each direction they are off by about {:.2} % of the diameter of the part and \
             {:.2} degrees; check where the sensors stood (the covariance allows for it)",
            100.0 * shift / prepared.diameter,
            turn.to_degrees()
        )
    })
}

/// Says so when a sensor stood where none does: far away, as where its unit is another one than that of the points, or inside the
/// part.
pub(crate) fn odd_sensors(prepared: &Prepared) -> Option<String> {
    /// Distance from which on the part would be a speck in its picture [diameters].
    const FAR: f64 = 100.0;
    /// Distance up to which it is within most parts [diameters].
    const INSIDE: f64 = 0.2;
    let [nearest, farthest] = prepared.sensor_distances?;
    let (distance, what) = if farthest > FAR {
        (farthest, "far away")
    } else if nearest < INSIDE {
        (nearest, "inside the part")
    } else {
        return None;
    };
    Some(format!(
        "a viewpoint lies {what}, {distance:.1} diameters from its middle: check the unit and the frame of the viewpoints"
    ))
}

/// Says so when sensors cannot have measured the points from where they are said to have stood.
pub(crate) fn wrong_viewpoints(prepared: &Prepared) -> Option<String> {
    /// Share of what views saw that others may have looked through: right viewpoints have up to 0.04 at five sigma on a table.
    const THROUGH: f64 = 0.15;
    /// Share of what a view saw that may lie behind other points of it: right viewpoints have up to 0.14 from the side.
    const BEHIND: f64 = 0.15;
    let Conflict { looked_through, behind_others } = prepared.visibility.as_ref()?.conflict;
    (looked_through > THROUGH || behind_others > BEHIND).then(|| {
        format!(
            "the viewpoints do not fit the points: seen from there, {:.0} % of the part lies behind other points of the same view, and \
             another view looked through {:.0} % of what it should have seen; check that each is where the sensor of its point stood, \
             in the frame of the points (of a world-to-camera pose that is -R^T t, not t)",
            100.0 * behind_others,
            100.0 * looked_through
        )
    })
}

/// Says what was left out of account where an order was found in the only view as if that had lost returns in patches.
fn patchy(score: &MatchScore) -> String {
    let [matched, contradicted, missing, _] = score.counts();
    let percent = 100.0 * missing / (matched + contradicted + missing);
    format!(
        "ambiguous: the only view got no return from {percent:.0} % of where the symmetry has a surface, which was taken for lost: \
         the order, or that there is one, is uncertain; declare it, or add a view"
    )
}

/// Says so when a surface of revolution was found in the only view although some of it speaks against that.
pub(crate) fn nearly_round(explained: f64) -> String {
    format!(
        "ambiguous: the only view fits a surface of revolution but for {:.1} % of what it shows, which may be noise, details or \
         another order: declare it, or add a view",
        100.0 * (1.0 - explained)
    )
}

/// Says so when an order holds although a sector about the axis shows nothing of it.
fn unseen_sector(width: f64) -> String {
    format!(
        "nothing was measured in a sector of {:.0} degrees about the axis: it is taken for unseen, not for empty",
        width.to_degrees()
    )
}

/// Says so when details contradict the order of all the rest: when they decide it, and when they have no part in it.
fn details(detection: &Detection) -> Option<String> {
    Some(match (detection.details?, detection.order?) {
        (Details::OfOrder { rest, .. }, _) => {
            format!("small details decide the order: without them it would be {rest}")
        }
        (Details::OfNone, order) => format!(
            "details contradict the order ({order}) of all the rest and every part of it: they have another one, or none"
        ),
    })
}

/// Says so when a part is called round of which few points are known: its holes or teeth may be narrower than what these show.
fn few_points(detection: &Detection, visibility: &Visibility, prepared: &Prepared) -> Option<String> {
    /// Width of a gap that shows, at most [diameters].
    const NARROW: f64 = 0.05;
    let width = visibility.narrowest_gap(&prepared.surface.centroid) / prepared.diameter;
    let is_round = detection.order == Some(Order::Continuous) && detection.details.is_none();
    (is_round && width > NARROW).then(|| {
        format!(
            "so few points hardly show gaps narrower than {:.0} % of the diameter of the part: where it has such holes or teeth, \
             declare their order, or keep more points",
            100.0 * width
        )
    })
}

/// Says so when one view shows that a surface of revolution has details, but not how they repeat: the teeth of a gear.
fn too_fine(detection: &Detection) -> Option<String> {
    (detection.order == Some(Order::Continuous) && detection.details == Some(Details::OfNone)).then(|| {
        "ambiguous: the only view shows details that are not round, but too little of them to tell their order, if they have \
         one: declare it, or add a view"
            .to_owned()
    })
}

/// Says so when an order was found that only one view speaks for, and that one from the side: the faces of the part, and
/// all that lies behind, are out of sight. `toward_sensor` is any vector to it.
fn side_view(axis: &Axis, toward_sensor: &Vector3<f64>) -> Option<String> {
    /// Cosine between the axis and the view.
    const ASIDE: f64 = 0.3;
    let cosine = axis.direction.dot(&toward_sensor.try_normalize(0.0)?).abs();
    (cosine < ASIDE).then(|| {
        "ambiguous: the only view is from the side and shows too little to tell the order: declare it, or add a view"
            .to_owned()
    })
}

/// Says so when another order holds about as well about the same axis.
fn rival(order: u32) -> String {
    format!("ambiguous: too little is in sight to tell the order from {order}: declare it, or add a view")
}
