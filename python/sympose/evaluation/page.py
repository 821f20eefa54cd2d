"""A report as a page of the repository: what was run, on what, and the pictures beside it."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import sympose

__all__ = ["circumstances", "write_page"]


def circumstances(command: str, seconds: float) -> str:
    """In Markdown: the command, the commit, the hardware, and how long it took.

    Neither the name of the machine nor a path of it is told.
    """
    cores = os.cpu_count() or 1
    facts = {
        "command": f"`{command}`",
        "commit": _commit(),
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "hardware": ", ".join([_processor(), f"{cores} cores", *_memory()]),
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "took": f"{seconds / 60.0:.0f} min",
    }
    return "\n".join(["| | |", "|---|---|", *(f"| {name} | {fact} |" for name, fact in facts.items())])


def write_page(path: Path, text: str, figures: Path) -> None:
    """Write a page, and the pictures that it shows into a folder of the same name beside it.

    Args:
        path: Of the page.
        text: Markdown that shows pictures by their bare names.
        figures: Folder in which those pictures are.
    """
    folder = path.with_suffix("")

    def moved(link: re.Match[str]) -> str:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(figures / link[1], folder / link[1])
        return f"]({folder.name}/{link[1]})"

    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(re.sub(r"\]\(([\w-]+\.png)\)", moved, text), encoding="utf-8")


def _commit() -> str:
    """The commit of the sources, marked where they were changed; without a repository the version."""
    here = Path(__file__).parent

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=here, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        # A package that is installed inside of some other repository is no part of it.
        git("ls-files", "--error-unmatch", "__init__.py")
        return git("describe", "--always", "--dirty", "--abbrev=10")
    except (OSError, subprocess.CalledProcessError):
        return f"version {sympose.__version__}"


def _processor() -> str:
    """Its name where the system tells it (Linux), else its kind."""
    try:
        known = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        known = ""
    name = re.search(r"^model name\s*:\s*(.+)$", known, re.MULTILINE)
    return name[1].strip() if name else platform.processor() or platform.machine()


def _memory() -> list[str]:
    try:
        size = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return []
    return [f"{size / 2**30:.0f} GiB"]
