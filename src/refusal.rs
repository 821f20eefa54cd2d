//! What is said where no axis holds.

use nalgebra::{Point3, Vector3};

use crate::error::{Error, Evidence};
use crate::estimate::Estimator;
use crate::prepare::Prepared;
use crate::remarks::{PIECE_APART, missing_returns, odd_sensors, wrong_viewpoints};
use crate::symmetry::axis::Axis;

/// What is said first.
const NO_SYMMETRY: &str = "no rotational symmetry explains the data";

/// What is said of an axis about which no order came near.
const NO_ROTATION: &str = "about the best axis no rotation maps the part to itself";

/// What is said of a half turn that details contradict.
const BUT_FOR_DETAILS: &str = "a half turn about the best axis maps all but details that contradict it, as one maps a plate with \
                               something on one of its sides; declare order 2 if the part has it but for these";

/// An axis about which no order holds.
pub(crate) struct Refusal {
    pub axis: Axis,
    /// Share of the observed surface that the best order explains.
    pub explained: f64,
    /// Score under the turns that brought the axis there.
    pub score: f64,
    /// A half turn maps all but a few details.
    pub is_denied: bool,
}

impl Estimator {
    /// The refusal where no order held; `best` is the axis that came nearest.
    pub(crate) fn no_symmetry(&self, prepared: &Prepared, best: Option<Refusal>) -> Error {
        let world = |p: Vector3<f64>| (prepared.world_from_local * Point3::from(p)).coords.into();
        let mut advice = String::new();
        if self.config().axis_hint.is_some() {
            advice += "; axis_hint keeps other directions out of the search";
        }
        if !prepared.outward {
            advice += "; give the viewpoint or the order, which say more";
        }
        if let Ok(true) = prepared.has_piece_apart() {
            advice = format!("{advice}; {PIECE_APART}");
        } else if self.config().roi.is_none() && best.is_some() {
            advice += "; if something else is in the scan, such as what holds the part, set roi, or declare the order";
        }
        let of_sensors = [odd_sensors(prepared), wrong_viewpoints(prepared), missing_returns(prepared)];
        advice.extend(of_sensors.into_iter().flatten().map(|remark| format!("; {remark}")));
        let evidence = match best {
            Some(Refusal { axis, explained, score, is_denied }) => Evidence {
                axis: (prepared.world_from_local * axis.direction.into_inner()).into(),
                center: world(axis.point),
                explained,
                score,
                reason: format!(
                    "{NO_SYMMETRY}: {}{advice}",
                    if is_denied { BUT_FOR_DETAILS } else { NO_ROTATION }
                ),
            },
            None => Evidence {
                center: world(prepared.surface.centroid),
                reason: format!("{NO_SYMMETRY}: no direction within reach could be aligned{advice}"),
                ..Evidence::default()
            },
        };
        Error::NoSymmetry { evidence }
    }
}
