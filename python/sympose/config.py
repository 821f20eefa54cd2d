"""`Config`: every setting of an estimate, nested by stage; names, defaults and domains are those of Rust."""

from __future__ import annotations

import difflib
import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from os import PathLike, fspath
from typing import Any, Self

import numpy as np

from sympose import _core
from sympose.errors import InvalidInputError

__all__ = ["Config", "Settings"]


class Settings(Mapping[str, Any]):
    """A frozen group of settings: `group.name` and `group["name"]` are the same."""

    __slots__ = ("_values",)
    _values: dict[str, Any]

    def __init__(self, values: Mapping[str, Any]) -> None:
        object.__setattr__(self, "_values", {name: _frozen(value) for name, value in values.items()})

    def __getattr__(self, name: str) -> Any:
        # `_values` itself is asked for here while a copy has none yet.
        if name.startswith("_"):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        if name not in self._values:
            raise AttributeError(_unknown(name, self._values))
        return self._values[name]

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"settings are frozen; make others with Config.replace({name}=...)")

    def __delattr__(self, name: str) -> None:
        raise AttributeError("settings are frozen")

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __hash__(self) -> int:
        return hash(tuple(self._values.items()))

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]

    def __reduce__(self) -> tuple[Any, ...]:
        return Settings, (dict(self._values),)

    def __repr__(self) -> str:
        return f"{{{', '.join(f'{name!r}: {value!r}' for name, value in self.items())}}}"


class Config(Settings):
    """Every setting of an estimate; frozen, and checked when it is made.

    Settings that are not given keep the defaults of the Rust core, which fit any unit of length. A group of
    settings is given as a dict, and keeps its defaults where the dict says nothing. `dict(Config())` has all.

    Args:
        **settings: By name; the most used are
            `order`: "auto", an integer of at least 2, or "continuous".
            `ground`: "auto" removes a support plane where there is one, "on" the largest plane with all else
                but its own sides on one side of it, even one that may be a face of the part, "off" none.
            `cluster`: "main" keeps the main cluster, "off" everything.
            `voxel_size`: edge of a voxel [length], or None: found from the cloud.
            `residual`: "point_to_plane", "point_to_point" or "distribution".
            `joint`: whether points and axis are optimised together.
            `origin`: "centroid", "base" or "midpoint".
            `yaw`: "harmonic" or "histogram".
            `non_finite`: "drop" points that are NaN or infinite, or raise an "error".

    Raises:
        InvalidInputError: There is no setting of that name (the message has the nearest one), or the value
            lies outside its domain.

    Example:
        >>> from sympose import Config
        >>> config = Config(ground="off", voxel_size=0.01)
        >>> config
        Config(ground='off', voxel_size=0.01)
        >>> config.residual
        'point_to_plane'
    """

    __slots__ = ()

    def __init__(self, **settings: Any) -> None:
        super().__init__(_checked(_merged(_DEFAULTS, settings)))

    @classmethod
    def paper(cls) -> Self:
        """The method of Dai et al. (arXiv 2606.16593), on what this package takes for the part."""
        return cls(**json.loads(_core.paper_config()))

    @classmethod
    def from_toml(cls, path: str | PathLike[str]) -> Self:
        """Read settings from a TOML file; a group is a table.

        Raises:
            InvalidInputError: Not TOML, or a setting is wrong.
            OSError: The file cannot be read.
        """
        with open(path, "rb") as file:
            try:
                settings = tomllib.load(file)
            except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
                raise InvalidInputError(f"{fspath(path)}: not a TOML file: {error}") from error
        try:
            return cls(**settings)
        except InvalidInputError as error:
            raise InvalidInputError(f"{fspath(path)}: {error}") from error

    def to_toml(self) -> str:
        """Return all settings as TOML, which `from_toml` reads; None is left out, or "off" for a limit."""
        return _core.config_to_toml(self.to_json())

    def to_json(self) -> str:
        """Return all settings as JSON."""
        return json.dumps(_plain(self))

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some settings changed; of a group, only those that the dict names.

        Raises:
            InvalidInputError: As for `Config`.

        Example:
            >>> from sympose import Config
            >>> Config(ground="off").replace(joint=False)
            Config(ground='off', joint=False)
        """
        return type(self)(**_merged(_plain(self), changes))

    def __repr__(self) -> str:
        changed = _difference(_plain(self), _DEFAULTS)
        return f"Config({', '.join(f'{name}={value!r}' for name, value in changed.items())})"

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (_plain(self),)


def _restored(settings: dict[str, Any]) -> Config:
    return Config(**settings)


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any], group: str = "") -> dict[str, Any]:
    merged = dict(base)
    for name, value in changes.items():
        if name not in base:
            raise InvalidInputError(_unknown(group + name, base))
        if isinstance(base[name], dict):
            if not isinstance(value, Mapping):
                raise InvalidInputError(
                    f"{group}{name} is a group of settings: expected a dict, got {value!r}"
                )
            merged[name] = _merged(base[name], value, f"{group}{name}.")
        else:
            merged[name] = _plain(value, group + name)
    return merged


def _checked(settings: dict[str, Any]) -> dict[str, Any]:
    checked: dict[str, Any] = json.loads(_core.check_config(json.dumps(settings)))
    return checked


def _plain(value: Any, name: str = "") -> Any:
    """What JSON can hold: groups as dicts, arrays as lists."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(item, f"{name}.{key}") for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(item, name) for item in value]
    if not (value is None or isinstance(value, (bool, int, float, str))):
        raise InvalidInputError(f"{name}: {value!r} is no setting")
    if isinstance(value, float) and not math.isfinite(value):
        raise InvalidInputError(f"{name} = {value}: expected a finite number")
    return value


def _frozen(value: Any) -> Any:
    if isinstance(value, Mapping):
        return value if isinstance(value, Settings) else Settings(value)
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value


def _difference(settings: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
    changed = {}
    for name, value in settings.items():
        if isinstance(value, dict):
            value = _difference(value, base[name])
            if value:
                changed[name] = value
        elif value != base[name]:
            changed[name] = value
    return changed


def _unknown(name: str, known: Mapping[str, Any]) -> str:
    near = difflib.get_close_matches(name.rpartition(".")[2], known, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(known)}"
    return f"there is no setting {name!r}; {hint}"


_DEFAULTS: dict[str, Any] = json.loads(_core.default_config())
