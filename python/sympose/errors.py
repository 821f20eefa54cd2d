"""The exceptions of sympose: every error the package raises on purpose derives from `SymposeError`."""

from __future__ import annotations

__all__ = [
    "CancelledError",
    "DeadlineExceededError",
    "InsufficientDataError",
    "InvalidInputError",
    "NoSymmetryError",
    "SymposeError",
]


class SymposeError(Exception):
    """Base of all errors of this package."""


class InvalidInputError(SymposeError, ValueError):
    """An argument or a file is wrong; the message says what was found and what is expected."""


class InsufficientDataError(SymposeError):
    """The input is well-formed, but too little of it is left to answer the question."""


class NoSymmetryError(SymposeError):
    """The cloud supports no rotational symmetry.

    Attributes:
        evidence: A dict with `axis` and `center` (3,) of the best axis in the world, the share of the surface
            that it has `explained`, its match `score`, both in [0, 1], and the `reason` for the refusal; or
            None where no axis was sought.
    """

    def __init__(self, message: str = "", evidence: object = None) -> None:
        super().__init__(message)
        self.evidence = evidence

    def __reduce__(self) -> tuple[type[NoSymmetryError], tuple[str, object]]:
        return type(self), (str(self), self.evidence)


class CancelledError(SymposeError):
    """The caller cancelled the computation."""


class DeadlineExceededError(SymposeError, TimeoutError):
    """The computation did not end within the time that the caller gave it."""
