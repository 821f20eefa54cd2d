"""The examples in the docstrings of compiled functions, which pytest does not find by itself."""

from __future__ import annotations

import doctest

import pytest

from sympose import _core

EXAMPLES = [test for test in doctest.DocTestFinder().find(_core, "_core", module=False) if test.examples]


def test_examples_are_found() -> None:
    assert len(EXAMPLES) >= 8


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_example(example: doctest.DocTest) -> None:
    report: list[str] = []
    results = doctest.DocTestRunner(verbose=False).run(example, out=report.append)
    assert results.failed == 0, "".join(report)
