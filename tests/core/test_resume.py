"""Runs that were ended on their way, and go on from their store: the same bits as without.

``ENFILADE_KILLS=20 python -m pytest tests/core/test_resume.py`` kills at twenty random moments instead of three.
"""

import dataclasses
import os
import random
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from enfilade.core import stages
from enfilade.core.options import Options
from enfilade.core.pipeline import run, solve
from enfilade.core.scene_files import load_scene
from enfilade.core.solution import Light
from enfilade.core.stage_files import load_stage
from enfilade.core.store import StoreError

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "tests" / "data" / "bench" / "cornell.npz"
KILLS = int(os.environ.get("ENFILADE_KILLS", "3"))
DRAFT = Options(quality="draft", threads=1, ordering="random")

# As ``python -m enfilade solve``, of the checkout whatever its folder is called, and with a state kept after every few shots.
PROGRAM = textwrap.dedent("""
    import importlib.util, sys
    root, scene, store = sys.argv[1:]
    spec = importlib.util.spec_from_file_location("enfilade", root + "/__init__.py", submodule_search_locations=[root])
    sys.modules["enfilade"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["enfilade"])
    from enfilade.core import stages
    from enfilade.core.options import Options
    from enfilade.core.pipeline import solve
    from enfilade.core.scene_files import load_scene
    stages.CHECKPOINT_SECONDS, stages.CHECKPOINT_SHARE = 0.02, 1e9
    solve(load_scene(scene), Options(quality="draft", threads=1, ordering="random", memory=1_000_000, store=store))
""")


def start(store):
    return subprocess.Popen([sys.executable, "-c", PROGRAM, str(ROOT), str(SCENE), str(store)], stderr=subprocess.PIPE)


@pytest.fixture(scope="module")
def scene():
    return load_scene(SCENE)


@pytest.fixture(scope="module")
def whole(scene):
    return solve(scene, DRAFT)


def same_light(found, expected):
    for field in dataclasses.fields(Light):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name))


@pytest.fixture(scope="module")
def duration(tmp_path_factory):
    begin = time.perf_counter()
    process = start(tmp_path_factory.mktemp("whole"))
    assert process.wait(120) == 0, process.stderr.read().decode()
    return time.perf_counter() - begin


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has other ways to end a process")
@pytest.mark.parametrize("number", range(KILLS))
def test_killed_at_any_moment_it_resumes_with_the_same_bits(number, duration, whole, tmp_path):
    moment = random.Random(number).uniform(0.1, 1.0) * duration
    process = start(tmp_path)
    time.sleep(moment)
    process.kill()
    process.wait()
    process.stderr.close()
    process = start(tmp_path)
    assert process.wait(120) == 0, process.stderr.read().decode()
    same_light(load_stage(Light, tmp_path / "light.npz"), whole.light)
    assert sorted(p.name for p in tmp_path.iterdir() if p.name.endswith(".part") or p.name.startswith("scratch-")) == []


def often(monkeypatch):
    """States are kept after every few shots."""
    monkeypatch.setattr(stages, "CHECKPOINT_SECONDS", 0.005)
    monkeypatch.setattr(stages, "CHECKPOINT_SHARE", 1e9)


def interrupted(scene, options, when):
    """Close a run at its first step for which ``when`` holds."""
    steps = run(scene, options)
    for step in steps:
        if when(step):
            steps.close()
            return
    raise AssertionError("the run ended before")


MOMENTS = {
    "before anything": lambda step: True,
    "in the graph": lambda step: step.stage == "graph",
    "with lamps half done": lambda step: step.message.startswith("Light") and step.fraction > 0.1,
    "while linking": lambda step: step.message.startswith("Linking") and step.fraction > 0.5,
    "before shooting": lambda step: step.message.startswith("Ordering"),
    "after some shots": lambda step: step.message.startswith("Iteration 2"),
}


@pytest.mark.parametrize(("moment", "memory"), [(m, 1_000_000 * (k % 2)) for k, m in enumerate(MOMENTS)])
def test_cancelled_anywhere_it_resumes_with_the_same_bits(moment, memory, scene, whole, tmp_path, monkeypatch):
    often(monkeypatch)
    options = dataclasses.replace(DRAFT, store=str(tmp_path), memory=memory)
    interrupted(scene, options, MOMENTS[moment])
    solution = solve(scene, dataclasses.replace(options, memory=1_000_000 - memory))
    same_light(solution.light, whole.light)
    skipped = ("seconds", "solve_seconds", "peak_bytes", "disk")
    assert {k: v for k, v in solution.report.items() if k not in skipped} == {k: v for k, v in whole.report.items() if k not in skipped}


def test_what_is_finished_is_not_done_again(scene, whole, tmp_path, monkeypatch):
    options = dataclasses.replace(DRAFT, store=str(tmp_path))
    first = solve(scene, options)

    def never(*args, **more):
        raise AssertionError("this was finished before")

    for module, name in (("regions", "merge"), ("clustering", "cluster_as_chosen"), ("visibility_graph", "build_as_chosen")):
        monkeypatch.setattr(getattr(stages, module), name, never)
    for module, name in (("illumination", "illuminate"), ("refinement", "link")):
        monkeypatch.setattr(getattr(stages, module), name, never)
    monkeypatch.setattr(stages.Shooter, "_shoot", never)
    again = solve(scene, options)
    same_light(again.light, whole.light)
    assert again.report["iterations"] == first.report["iterations"]
    assert again.report["seconds"]["graph"] >= first.report["seconds"]["graph"]


def test_an_ordering_of_its_own_starts_from_the_links(scene, tmp_path, monkeypatch):
    options = dataclasses.replace(DRAFT, store=str(tmp_path))
    solve(scene, options)
    monkeypatch.setattr(stages.refinement, "link", None)
    other = dataclasses.replace(options, ordering="greedy_c")
    found = solve(scene, other)
    monkeypatch.undo()
    same_light(found.light, solve(scene, dataclasses.replace(other, store="")).light)


def test_other_options_begin_anew(scene, tmp_path):
    solve(scene, dataclasses.replace(DRAFT, store=str(tmp_path)))
    coarse = dataclasses.replace(DRAFT, order=1)
    same_light(solve(scene, dataclasses.replace(coarse, store=str(tmp_path))).light, solve(scene, coarse).light)


def test_an_interrupted_run_gives_the_light_of_its_finished_iterations(scene, whole, tmp_path, monkeypatch):
    often(monkeypatch)
    options = dataclasses.replace(DRAFT, store=str(tmp_path))
    interrupted(scene, options, MOMENTS["after some shots"])
    some = solve(scene, dataclasses.replace(options, max_iterations=1))
    assert 1 <= some.report["iterations"] < whole.report["iterations"]
    same_light(solve(scene, options).light, whole.light)


def test_a_disk_that_fills_up_loses_nothing(scene, whole, tmp_path):
    resource = pytest.importorskip("resource")
    options = dataclasses.replace(DRAFT, store=str(tmp_path))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, before[1]))
    try:
        with pytest.raises(StoreError, match=r"^[^\n]*make room there and run again, what is done is kept$"):
            solve(scene, options)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert (tmp_path / "clusters.npz").exists()
    same_light(solve(scene, options).light, whole.light)
