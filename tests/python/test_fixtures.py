"""A part held by something that has no part in its symmetry."""

from __future__ import annotations

import numpy as np
import pytest

import sympose

trimesh = pytest.importorskip("trimesh")
for library in ("manifold3d", "embreex"):
    pytest.importorskip(library)

from sympose.datasets import Part, Scan, part, scan  # noqa: E402


def clamped(name: str, at: list[float], extents: list[float]) -> Part:
    """A part with a block at its rim, the name of the order that it has without."""
    held = part(name)
    block = trimesh.creation.box(extents=extents, transform=trimesh.transformations.translation_matrix(at))
    mesh = trimesh.util.concatenate([held.mesh, block])
    return Part(f"{name}_clamped", held.family, held.order, mesh, held.axis, held.center, held.dihedral)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_declared_order_looks_past_a_clamp(seed: int) -> None:
    held = scan(clamped("flange_8", [0.52, 0.05, 0.0], [0.2, 0.15, 0.15]), "sphere", views=3, seed=seed)
    found = sympose.estimate(held.scene, order=8)
    assert abs(found.axis @ held.axis) > np.cos(np.radians(0.1))
    assert np.linalg.norm(np.cross(found.center - held.center, held.axis)) < 0.001
    with pytest.raises(sympose.NoSymmetryError, match="such as what holds the part, set roi"):
        sympose.estimate(held.scene)


def on_plate(name: str, thickness: float, scenario: str = "upper") -> Scan:
    """Three views of a part on a plate, off its middle, with edges in sight."""
    low = part(name).mesh.bounds[0, 2]
    whole = clamped(name, [0.07, 0.04, low - 0.5 * thickness], [1.3, 1.3, thickness])
    return scan(whole, scenario, views=3, seed=1)


@pytest.mark.parametrize(
    ("name", "thickness"), [("propeller_3", 0.05), ("wheel_hub_5", 0.2), ("sprocket_6", 0.2)]
)
@pytest.mark.parametrize("ground", ["auto", "on"])
def test_a_plate_under_a_part_is_left_out(name: str, thickness: float, ground: str) -> None:
    seen = on_plate(name, thickness)
    with pytest.raises(sympose.NoSymmetryError):
        sympose.estimate(seen.scene, config=sympose.Config(ground="off"))
    found = sympose.estimate(seen.scene, config=sympose.Config(ground=ground))
    assert found.order == part(name).order
    assert found.ground is not None
    assert found.score > 0.9
    assert abs(found.axis @ seen.axis) > np.cos(np.radians(0.1))
    assert any("taken to stand on a plate" in warning for warning in found.warnings) == (ground == "auto")


@pytest.mark.parametrize(("name", "thickness"), [("propeller_3", 0.05), ("wheel_hub_5", 0.2)])
def test_a_plate_is_left_out_however_the_part_is_sought(name: str, thickness: float) -> None:
    scene, order = on_plate(name, thickness).scene, part(name).order
    found = sympose.estimate(scene)
    reference = found.as_reference()
    for options in (
        {"order": order},
        {"initial": found},
        {"initial": found, "order": order},
        {"reference": reference},
        {"reference": reference, "initial": found},
    ):
        again = sympose.estimate(scene, prefer=found, **options)  # type: ignore[arg-type]
        moved = (again.pose - found.pose) @ [0.5, 0.5, 0.5, 1.0]
        assert np.linalg.norm(moved) < 1e-3, options
        assert again.score > 0.9


def test_a_plate_is_named_where_it_may_be_of_the_part() -> None:
    """Many a casting without symmetry has a round boss."""
    with pytest.raises(
        sympose.NoSymmetryError, match='what stands on the plate is the part, set ground = "on"'
    ):
        sympose.estimate(on_plate("pulley", 0.2).scene)
    found = sympose.estimate(on_plate("flange_8", 0.2).scene)
    assert found.score < 0.5
    assert any('set ground = "on"' in warning for warning in found.warnings)


def test_a_plate_that_is_seen_from_below_stays() -> None:
    # So thick that its underside is far from the rim: nothing but the sensors below tells it from a fixture.
    seen = on_plate("wheel_hub_5", 0.4, "sphere")
    with pytest.raises(sympose.NoSymmetryError, match="what stands on the plate"):
        sympose.estimate(seen.scene)
    assert sympose.estimate(seen.scene, config=sympose.Config(ground="on")).order == 5


@pytest.mark.parametrize("views", [2, 3])
def test_a_half_turn_that_hides_much_is_said_to(views: int) -> None:
    # About its handle a mug turns its mouth to the underside, which no view from above shows.
    mug = scan(part("mug"), "table", views=views, seed=3)
    found = sympose.estimate(mug.scene)
    assert found.order == 2
    assert any("out of sight, where nothing can contradict it" in warning for warning in found.warnings)
    # What shows its faces has nothing to hide.
    propeller = scan(part("propeller_2"), "upper", views=views, seed=1)
    found = sympose.estimate(propeller.scene)
    assert found.order == 2
    assert not any("out of sight" in warning for warning in found.warnings)


def test_a_plate_that_does_not_help_leaves_no_trace() -> None:
    # Of a wrong order nothing is certain, with the plate or without.
    scene = on_plate("propeller_3", 0.05).scene
    found = sympose.estimate(scene, order=7)
    alone = sympose.estimate(scene, order=7, config=sympose.Config(ground="off"))
    assert found.ground is None
    np.testing.assert_array_equal(found.pose, alone.pose)
    assert set(found.diagnostics) == set(alone.diagnostics)
    assert found.diagnostics["voxel_size"] == alone.diagnostics["voxel_size"]
