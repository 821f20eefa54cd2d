"""The configuration: names and defaults of Rust, frozen, checked when made."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sympose
from sympose import Config, InvalidInputError


def test_the_promised_settings_are_there() -> None:
    config = Config()
    assert (config.ground, config.cluster, config.voxel_size) == ("auto", "main", None)
    assert (config.residual, config.joint) == ("point_to_plane", True)
    assert (config.origin, config.yaw, config.non_finite) == ("centroid", "harmonic", "drop")


@pytest.mark.parametrize(
    "settings",
    [
        {"ground": "off"},
        {"cluster": "off", "voxel_size": 0.01},
        {"order": "continuous"},
        {"order": np.int64(5), "voxel_size": np.float64(0.5)},
        {"roi": np.array([[0, 0, 0], [1, 1, 1]]), "axis_hint": (0, 0, 1)},
        {"origin": "midpoint", "yaw": "histogram", "residual": "distribution", "joint": False},
    ],
)
def test_what_is_set_is_kept(settings: dict[str, Any], tmp_path: Path) -> None:
    config = Config(**settings)
    for name, value in settings.items():
        assert np.array_equal(config[name], value)
        assert getattr(config, name) == config[name]
    path = tmp_path / "config.toml"
    path.write_text(config.to_toml())
    assert Config.from_toml(path) == config
    assert pickle.loads(pickle.dumps(config)) == config
    assert hash(pickle.loads(pickle.dumps(config))) == hash(config)
    assert eval(repr(config), {"Config": Config}) == config


def groups() -> list[str]:
    return [name for name, value in Config().items() if isinstance(value, Mapping)]


@pytest.mark.parametrize("group", groups())
def test_a_group_keeps_its_other_defaults(group: str) -> None:
    default = Config()[group]
    name, value = next((name, value) for name, value in default.items() if type(value) in (float, int))
    other = type(value)(0.75 * value)
    config = Config(**{group: {name: other}})
    assert dict(config[group]) == {**default, name: other}
    assert getattr(config[group], name) == other
    assert config.replace(ground="off")[group] == config[group]
    assert config.replace(**{group: {name: value}}) == Config()
    with pytest.raises(InvalidInputError, match=rf"{group}\.nonsense"):
        Config(**{group: {"nonsense": 1}})
    with pytest.raises(InvalidInputError, match="group"):
        Config(**{group: 3})


@pytest.mark.parametrize("group", groups())
def test_a_group_can_be_copied_and_pickled(group: str) -> None:
    settings = Config(outliers={"scattered": "off"})[group]
    for twin in (copy.copy(settings), copy.deepcopy(settings), pickle.loads(pickle.dumps(settings))):
        assert (twin, type(twin), hash(twin)) == (settings, type(settings), hash(settings))
    assert copy.deepcopy({"settings": settings})["settings"] == settings


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(InvalidInputError, match="'grund'; did you mean 'ground'"):
        Config(grund="off")
    with pytest.raises(InvalidInputError, match="voxel_size"):
        Config().replace(voxelsize=1.0)
    with pytest.raises(AttributeError, match="did you mean 'ground'"):
        Config().grund  # noqa: B018


@pytest.mark.parametrize(
    "settings",
    [
        {"ground": "maybe"},
        {"voxel_size": -1.0},
        {"refine": {"gate": -1.0}},
        {"propose": {"directions": 10**9}},
        {"detect": {"max_order": 3000}},
        {"refine": {"max_normal_angle": 44.0}},
        {"smoothing": {"max_angle": 9.0}},
        {"propose": {"max_hint_angle": 30.0}},
        {"voxel_size": 0.0},
        {"voxel_size": float("nan")},
        {"voxel_size": float("inf")},
        {"voxel_size": "large"},
        {"voxel_size": ...},
        {"order": 1},
        {"order": True},
        {"order": 5.5},
        {"order": "some"},
        {"joint": "yes"},
        {"roi": [[0, 0], [1, 1]]},
        {"axis_hint": [0.0, 0.0, 0.0]},
        {"seed": -1},
        {"seed": 2**63},
        {"seed": 2**64},
        {"order": 2**70},
        {"threads": 0},
        {"origin": None},
    ],
    ids=str,
)
def test_a_value_outside_its_domain_is_named(settings: dict[str, Any]) -> None:
    with pytest.raises(InvalidInputError, match=next(iter(settings))):
        Config(**settings)


def test_a_configuration_is_frozen() -> None:
    config = Config()
    with pytest.raises(AttributeError, match="frozen"):
        config.ground = "off"
    with pytest.raises(AttributeError, match="frozen"):
        del config.ground
    with pytest.raises(TypeError):
        Config("off")  # type: ignore[call-arg]


def test_repr_shows_only_what_was_changed() -> None:
    assert repr(Config()) == "Config()"
    assert repr(Config(ground="off", joint=True)) == "Config(ground='off')"


def test_equality_is_by_value() -> None:
    assert Config(ground="auto") == Config()
    assert Config(ground="off") != Config()


@pytest.mark.parametrize("content", [b"ground = ", b"\xff\xfe\x00", b"nonsense = 1", b"voxel_size = -1"])
def test_a_wrong_file_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "wrong.toml"
    path.write_bytes(content)
    with pytest.raises(InvalidInputError, match=r"wrong\.toml"):
        Config.from_toml(path)
    with pytest.raises(FileNotFoundError):
        Config.from_toml(tmp_path / "nothing.toml")


def test_the_largest_seed_survives_a_file(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(Config(seed=2**63 - 1).to_toml())
    assert Config.from_toml(path).seed == 2**63 - 1
    with pytest.raises(InvalidInputError, match="from 0 to 9,223,372,036,854,775,807"):
        Config(seed=2**63)


def test_an_order_of_another_type_is_named() -> None:
    with pytest.raises(
        InvalidInputError, match=r'order = 5\.0: expected a whole number from 2 to 360, "cont'
    ):
        Config(order=5.0)
    with pytest.raises(InvalidInputError, match="order = true: expected a whole number"):
        Config(order=True)


def test_settings_reach_the_estimate() -> None:
    points = np.full((10, 3), np.nan)
    with pytest.raises(InvalidInputError, match="10 of 10"):
        sympose.estimate(points, config=Config(order=3, non_finite="error"))


def test_numbers_of_another_kind_are_named_in_words() -> None:
    with pytest.raises(InvalidInputError, match=r"threads: .* expected a whole number, 0 or more"):
        Config(threads=-1)
    with pytest.raises(InvalidInputError, match=r"voxel_size: .* expected a number"):
        Config(voxel_size="large")
