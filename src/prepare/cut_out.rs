//! The part, cut out of the scene: the plane that it stands on is found, and what else stands there is left out.

use super::LeftOut;
use super::foreground::foreground;
use super::scene::{Scene, enough};
use super::stacks::Floor;
use crate::config::{ClusterMode, Config};
use crate::error::Result;
use crate::preprocess::{Ground, Support, find_support};
use crate::stages::Stages;

/// How far around a region of interest its support is looked for [extents of the region].
const WIDER: [f64; 2] = [0.5, 2.0];

/// The part, where it stands.
pub(super) struct Part<'a> {
    /// What is left of the scene.
    pub(super) scene: Scene<'a>,
    /// The support plane, in the frame of the scene.
    pub(super) ground: Option<[f64; 4]>,
    /// Rows of the cloud in the scene as it was before, where anything was left out.
    pub(super) region: Option<Vec<u32>>,
    /// Size of the largest other thing on the support, which was left out \[share of the part\].
    pub(super) beside: f64,
}

/// Leaves out a support of this kind and what stands apart from the largest thing on it, or a backdrop.
pub(super) fn cut_out<'a>(
    scene: Scene<'a>,
    left_out: LeftOut,
    config: &Config,
    stages: &mut Stages,
) -> Result<Part<'a>> {
    let LeftOut { support, background } = left_out;
    if background && let Some(kept) = foreground(&scene, config.outliers.cluster_distance)? {
        let region = Some(scene.rows.clone());
        stages.number("background_points", (scene.rows.len() - kept.len()) as f64);
        let part = cut_out(scene.select(&kept), LeftOut { background: false, ..left_out }, config, stages)?;
        return Ok(Part { region, ..part });
    }
    let found = support.map(|support| find_under(&scene, support, config)).transpose()?.flatten();
    let Some(Ground { plane, band, kept, reason, removed, is_backdrop }) = found else {
        return Ok(Part { scene, ground: None, region: None, beside: 0.0 });
    };
    let [reason_of, count_of] =
        if is_backdrop { ["backdrop", "backdrop_points"] } else { ["ground", "ground_points"] };
    stages.text(reason_of, &reason);
    stages.number(count_of, removed as f64);
    let region = Some(scene.rows.clone());
    if is_backdrop {
        return Ok(Part { scene: scene.select(&kept), ground: None, region, beside: 0.0 });
    }
    let floor = Floor::new(plane, band, without(&scene.points, &kept));
    let scene = scene.select(&kept);
    let (scene, beside) = match config.cluster {
        ClusterMode::Main => scene.isolated(&floor, &config.outliers)?,
        ClusterMode::Off => (scene, 0.0),
    };
    stages.number("beside", beside);
    Ok(Part { scene, ground: Some(plane), region, beside })
}

/// The points but for those `kept`, whose indices ascend.
fn without(points: &[[f64; 3]], kept: &[u32]) -> Vec<[f64; 3]> {
    let mut kept = kept.iter().copied().peekable();
    (0_u32..).zip(points).filter(|(i, _)| kept.next_if_eq(i).is_none()).map(|(_, p)| *p).collect()
}

/// The plane that the part stands on; its `kept` and `removed` are of the points of `scene`.
pub(super) fn find_under(scene: &Scene, support: Support, config: &Config) -> Result<Option<Ground>> {
    let find = |scene: &Scene| {
        find_support(&scene.points, |i| scene.viewpoint(i), &config.plane, support, config.seed)
    };
    let within = find(scene)?;
    let Some(roi) = config.roi.filter(|_| within.as_ref().is_none_or(|ground| ground.is_backdrop)) else {
        return Ok(within);
    };
    // A box about the part leaves so little of its support that this looks like a face of the part.
    for times in WIDER {
        let around = scene.with_surroundings(roi, times);
        if let Some(ground) = find(&around)?.filter(|ground| !ground.is_backdrop) {
            let kept = scene.shared(&around, &ground.kept);
            let removed = scene.points.len() - kept.len();
            return Ok(enough("ground", kept.len()).is_ok().then_some(Ground { kept, removed, ..ground }));
        }
    }
    Ok(within)
}
