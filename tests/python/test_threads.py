"""Threads, signals, deadlines, processes: what a long call does to the program around it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sympose
from conftest import ORDER, Part, heed_ctrl_c, make_part
from sympose import Config, DeadlineExceededError, PinholeCamera, Scene, View, cli, segment

FINE = Config(ground="off", cluster="off", voxel_size=0.001)


def result(part: Part, **options: Any) -> tuple[bytes, ...]:
    found = sympose.estimate(part.points, order=ORDER, viewpoints=part.viewpoint, **options)
    return tuple(array.tobytes() for array in (found.pose, found.points, found.covariance, found.match_curve))


@pytest.mark.parametrize("threads", [1, 2, 3, 4])
def test_the_number_of_threads_changes_nothing(part: Part, threads: int) -> None:
    assert result(part, threads=threads) == result(part)


def test_the_seed_is_all_the_chance_there_is(part: Part) -> None:
    assert result(part, seed=7) == result(part, config=Config(seed=7))


def test_calls_from_several_threads_do_not_disturb_each_other(part: Part) -> None:
    alone = result(part)
    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(lambda _: result(part), range(4))) == {alone}


@pytest.mark.timed
def test_other_threads_run_during_a_long_call() -> None:
    part = make_part(60_000)
    ticks, done = 0, threading.Event()

    def tick() -> None:
        nonlocal ticks
        while not done.wait(0.002):
            ticks += 1

    ticker = threading.Thread(target=tick)
    ticker.start()
    started = time.perf_counter()
    result(part, config=FINE)
    seconds = time.perf_counter() - started
    done.set()
    ticker.join()
    assert seconds > 0.1
    # Under a held lock there would be none at all; a loaded machine may lose most.
    assert ticks > 20 * seconds


def test_progress_rises_and_comes_in_the_calling_thread(part: Part) -> None:
    reports: list[tuple[str, float, int]] = []
    result(part, progress=lambda stage, done: reports.append((stage, done, threading.get_ident())))
    fractions = [done for _, done, _ in reports]
    assert len(reports) >= 3
    assert fractions == sorted(fractions)
    assert min(fractions) >= 0.0
    assert max(fractions) == 1.0
    assert {thread for _, _, thread in reports} == {threading.get_ident()}


def test_an_exception_in_progress_cancels_and_is_raised(part: Part) -> None:
    stages = []

    def stop(stage: str, _done: float) -> None:
        stages.append(stage)
        raise KeyError(stage)

    with pytest.raises(KeyError):
        result(part, progress=stop)
    assert len(stages) == 1


@pytest.mark.timed
def test_a_deadline_ends_the_call() -> None:
    part = make_part(60_000)
    started = time.perf_counter()
    with pytest.raises(DeadlineExceededError) as caught:
        result(part, config=FINE, timeout=0.05)
    assert time.perf_counter() - started < 1.5
    assert isinstance(caught.value, TimeoutError)
    assert result(make_part(500), timeout=1e9)


@pytest.mark.timed
def test_a_deadline_ends_the_search_for_the_order() -> None:
    part = make_part(3000)
    many = sympose.Config(detect={"max_order": 360, "ring_samples": 6000, "samples": 3000})

    def search(timeout: float | None) -> float:
        started = time.perf_counter()
        try:
            sympose.estimate(part.points, viewpoints=part.viewpoint, config=many, timeout=timeout)
        except DeadlineExceededError:
            assert timeout is not None
        return time.perf_counter() - started

    whole = search(None)
    assert search(0.3 * whole) < 0.6 * whole


def seen_by(part: Part, views: int) -> Scene:
    """The part as cameras about the place of its sensor see it."""
    camera = PinholeCamera(320, 240, 250.0, 250.0, 159.5, 119.5)
    forward = part.world_from_object[:3, 3] - part.viewpoint
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    poses = []
    for step in range(views):
        pose[:3, 3] = part.viewpoint - 0.01 * step * forward
        poses.append(pose.copy())
    return Scene(part.points, viewpoints=part.viewpoint, views=[View(camera, pose) for pose in poses])


@pytest.mark.timed
def test_a_deadline_ends_the_segmentation() -> None:
    scene = seen_by(make_part(20_000), 40)
    started = time.perf_counter()
    segment(scene.points, scene.views)
    whole = time.perf_counter() - started
    started = time.perf_counter()
    with pytest.raises(DeadlineExceededError, match="segmentation"):
        sympose.estimate(scene, order=ORDER, timeout=0.1 * whole)
    assert time.perf_counter() - started < 0.6 * whole


def test_the_segmentation_counts_against_the_timeout(part: Part) -> None:
    def dawdle(stage: str, _share: float) -> None:
        time.sleep(0.3 if stage == "segment" else 0.0)

    with pytest.raises(DeadlineExceededError):
        sympose.estimate(seen_by(part, 2), order=ORDER, timeout=1.0, progress=dawdle)
    with pytest.raises(sympose.InvalidInputError, match="timeout = -1"):
        sympose.estimate(seen_by(part, 2), order=ORDER, timeout=-1)


def test_progress_rises_through_the_segmentation_and_can_end_it(part: Part) -> None:
    scene, reports = seen_by(part, 3), []
    sympose.estimate(scene, order=ORDER, progress=lambda stage, share: reports.append((stage, share)))
    shares = [share for _, share in reports]
    assert [stage for stage, _ in reports].count("segment") >= len(scene.views)
    assert shares == sorted(shares)
    assert (shares[0], shares[-1] <= 1.0) == (0.0, True)

    def stop(_stage: str, share: float) -> None:
        if share > 0.0:
            raise KeyError(share)

    with pytest.raises(KeyError) as caught:
        sympose.estimate(scene, order=ORDER, progress=stop)
    assert caught.value.args[0] == shares[1]


INTERRUPTED = """
import time
from conftest import ORDER, make_part
import sympose
part = make_part(200_000)
fine = sympose.Config(ground="off", cluster="off", voxel_size=0.0005)
print("ready", flush=True)
try:
    while True:
        sympose.estimate(part.points, order=ORDER, config=fine)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.timed
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT to a single process")
def test_ctrl_c_interrupts_within_a_second() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED],
        stdout=subprocess.PIPE,
        text=True,
        cwd=os.path.dirname(__file__),
        preexec_fn=heed_ctrl_c,
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)
        sent = time.perf_counter()
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted\n"
        assert time.perf_counter() - sent < 1.0
    assert process.returncode == 0


def filtered(folder: str, name: str) -> bytes:
    """What the command line leaves of a scan."""
    source, target = f"{folder}/{name}.ply", f"{folder}/{name}.pcd"
    sympose.write(source, make_part(800).points)
    assert cli.main(["filter", source, target, "--voxel-size", "0.1", "--quiet"]) == 0
    return sympose.read(target).points.tobytes()


def in_child(queue: Any, folder: str) -> None:
    part = make_part(800)
    tree = sympose.KdTree(part.points)
    queue.put((tree.query(part.points, 3)[1].tobytes(), result(part), filtered(folder, "child")))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork.*:DeprecationWarning")
def test_a_forked_child_can_work(tmp_path: Path) -> None:
    part = make_part(800)
    tree = sympose.KdTree(part.points)
    here = (tree.query(part.points, 3)[1].tobytes(), result(part), filtered(str(tmp_path), "parent"))
    context = multiprocessing.get_context("fork")
    queue: Any = context.Queue()
    child = context.Process(target=in_child, args=(queue, str(tmp_path)))
    child.start()
    assert queue.get(timeout=30) == here
    child.join(10)
    assert child.exitcode == 0
