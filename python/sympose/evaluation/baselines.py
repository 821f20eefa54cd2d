"""What else one could do: fit the true CAD model with Open3D's ICP, or take the principal axes.

The ICP columns are what the method is held against: they know the model, which the project does not.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sympose.datasets import Scan, sample_visible
from sympose.datasets.parts import Part
from sympose.evaluation.reference import mesh_from_object
from sympose.evaluation.scenario import Subject

__all__ = ["cad_icp", "principal_axes"]

_VOXEL = 0.01  # diameters
_MODEL_SAMPLES = 200_000
_NEIGHBORS = 20
_GATES = (0.05, 0.02)  # diameters
_ITERATIONS = 60
_START_DEG, _START_OFFSET = 2.0, 0.02


def cad_icp(
    subject: Subject, scan: Scan, seed: int, *, near: bool = True, plane: bool = True
) -> NDArray[np.float64]:
    """Fit the true model to the scan with Open3D.

    Args:
        subject: Its mesh is the model.
        scan: Reduced to a voxel of 0.01.
        seed: Of the start.
        near: Start 2 degrees and 0.02 diameters from the truth; else from a plane fit and the centroid, as
            the paper begins.
        plane: Point-to-plane, else point-to-point.

    Returns:
        (4, 4) world_from_object.

    Raises:
        ImportError: open3d is not installed.
    """
    o3d = _open3d()
    frame = mesh_from_object(subject.part)
    truth = scan.world_from_object @ frame
    truth[:3, 3] = scan.center
    source = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scan.scene.points / scan.diameter))
    source = source.voxel_down_sample(_VOXEL)
    truth[:3, 3] /= scan.diameter
    start = _near(truth, seed) if near else _plane_and_centroid(source)
    registration = o3d.pipelines.registration
    estimation = (
        registration.TransformationEstimationPointToPlane()
        if plane
        else registration.TransformationEstimationPointToPoint()
    )
    criteria = registration.ICPConvergenceCriteria(max_iteration=_ITERATIONS)
    object_from_world = np.linalg.inv(start)
    for gate in _GATES:
        object_from_world = registration.registration_icp(
            source, _model(subject.part), gate, object_from_world, estimation, criteria
        ).transformation
    pose: NDArray[np.float64] = np.linalg.inv(object_from_world)
    pose[:3, 3] *= scan.diameter
    return pose


def principal_axes(subject: Subject, scan: Scan, seed: int) -> NDArray[np.float64]:
    """The principal axis about which the spread is most even, through the centroid."""
    del subject, seed
    points = scan.scene.points
    centroid = points.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((points - centroid).T))
    lowest_alike = values[0] / values[1] > values[1] / values[2]
    return _frame(vectors[:, 2] if lowest_alike else vectors[:, 0], centroid)


@lru_cache(maxsize=8)
def _model(part: Part) -> Any:
    """The model as an Open3D cloud with normals, in the true frame of the part."""
    o3d = _open3d()
    frame = mesh_from_object(part)
    samples, _ = sample_visible(part.mesh, _MODEL_SAMPLES)
    model = o3d.geometry.PointCloud(o3d.utility.Vector3dVector((samples - frame[:3, 3]) @ frame[:3, :3]))
    model.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(_NEIGHBORS))
    return model


def _near(truth: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """The truth, turned by 2 degrees about an axis across its own and shifted by 0.02 in any direction."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    turned = _rotation(np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), np.radians(_START_DEG))
    shift = rng.normal(size=3)
    start = truth.copy()
    start[:3, :3] = truth[:3, :3] @ turned
    start[:3, 3] += _START_OFFSET * shift / np.linalg.norm(shift)
    return start


def _plane_and_centroid(cloud: Any) -> NDArray[np.float64]:
    """The paper's initial pose: the normal of the largest plane and the centroid; the yaw is chance."""
    o3d = _open3d()
    o3d.utility.random.seed(0)
    plane, _ = cloud.segment_plane(_VOXEL, 3, 1000)
    return _frame(np.asarray(plane[:3]), np.asarray(cloud.points).mean(axis=0))


def _frame(axis: NDArray[np.float64], origin: NDArray[np.float64]) -> NDArray[np.float64]:
    z = axis / np.linalg.norm(axis)
    x = np.linalg.svd(z[None])[2][1]
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = origin
    return pose


def _rotation(axis: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def _open3d() -> Any:
    try:
        import open3d
    except ImportError as error:
        raise ImportError("the ICP columns need open3d: pip install 'sympose[evaluation]'") from error
    # It spreads over all cores; what it warns about is in the result.
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d
