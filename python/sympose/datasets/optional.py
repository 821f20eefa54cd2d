"""Loading of the libraries that only this subpackage needs."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["load"]


def load(module: str) -> Any:
    """Import `module`, or say which extra brings it.

    Raises:
        ImportError: `module` is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise ImportError(f"sympose.datasets needs {name}: pip install 'sympose[datasets]'") from error
