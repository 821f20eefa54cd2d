"""What the README shows works: its Python is run, its commands too. Its Rust is a doctest of the crate."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from sympose.cli import main

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


@pytest.fixture(autouse=True)
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(ROOT / "examples" / "data", tmp_path / "examples" / "data")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_python_example_runs(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("plyfile")
    pytest.importorskip("matplotlib")
    (example,) = blocks("python")
    exec(compile(example, "README.md", "exec"), {})
    assert "[[" in capsys.readouterr().out
    for name in ("hub.json", "hub.png", "completed.ply"):
        assert (clone / name).stat().st_size > 1000


def test_the_commands_run(clone: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (example,) = blocks("sh")
    commands = example.splitlines()
    assert len(commands) >= 3
    for command in commands:
        program, *arguments = shlex.split(command)
        assert program == "sympose"
        assert main(arguments) == 0, (command, capfd.readouterr().err)
    for name in ("hub.json", "completed.ply", "clean.ply"):
        assert (clone / name).stat().st_size > 1000


@pytest.mark.parametrize("page", ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links_and_paths_lead_somewhere(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    links = re.findall(r"\]\((?!https?://|#)([^)]+)\)", text)
    paths = re.findall(r"`((?:src|python|tests|examples|benches)/[\w./-]*)`", text)
    missing = [path for path in {*links, *paths} if not (ROOT / path).exists()]
    assert missing == []
