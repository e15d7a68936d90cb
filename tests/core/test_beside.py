"""A generator in a process of its own: its steps, result and errors, an early end, and nothing left running."""

import builtins
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from enfilade.core import baking, child
from enfilade.core.bake_values import Carrier
from enfilade.core.beside import SolverLost, beside
from enfilade.core.options import BakeOptions, OptionError, Options
from scenery import box, rectangle, scene_of

ROOT = Path(child.__file__).parents[1]
PROC = pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks at processes through /proc")


def drained(steps):
    seen = []
    while True:
        try:
            seen.append(next(steps))
        except StopIteration as end:
            return seen, end.value


def code(text):
    """A generator made of source, whose name arrives in the other process: ``eval`` of it."""
    return beside(builtins.eval, text)


def test_steps_and_result_come_from_another_process():
    seen, result = drained(code("(__import__('os').getpid() for _ in range(1))"))
    assert len(seen) == 1
    assert seen[0] != os.getpid()
    assert result is None


def test_of_many_steps_the_last_one_is_told():
    seen, _ = drained(code("iter(x for x in range(100_000))"))
    assert seen == sorted(seen)
    assert seen[-1] == 99_999
    assert len(seen) < 1000


def test_errors_arrive_as_they_are():
    with pytest.raises(ZeroDivisionError):
        drained(code("(1 / k for k in (1, 0))"))
    with pytest.raises(OptionError, match="memory"):
        drained(beside(baking.bake, task(Options(quality="good", memory=1)), None, True))


def test_what_the_generator_prints_is_no_answer():
    seen, _ = drained(code("(print('hello') or k for k in range(1))"))
    assert seen == [0]


def test_a_process_that_dies_is_told_in_one_sentence():
    with pytest.raises(SolverLost, match="option memory"):
        drained(code("(__import__('os')._exit(9) for _ in range(3))"))


@PROC
def test_an_early_end_ends_the_process():
    steps = code("((__import__('time').sleep(0.05), __import__('os').getpid())[1] for _ in range(10_000))")
    pid = next(steps)
    assert Path(f"/proc/{pid}").exists()
    begin = time.perf_counter()
    steps.close()
    assert time.perf_counter() - begin < 2
    assert not Path(f"/proc/{pid}").exists()


@PROC
def test_a_killed_program_leaves_no_process_behind():
    program = f"""
import builtins, sys, time
sys.path[:] = {sys.path!r}
import conftest
from enfilade.core.beside import beside
steps = beside(builtins.eval, "((__import__('time').sleep(0.05), __import__('os').getpid())[1] for _ in range(10_000))")
print(next(steps), flush=True)
time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", program], cwd=ROOT, stdout=subprocess.PIPE, text=True) as victim:
        pid = int(victim.stdout.readline())
        assert Path(f"/proc/{pid}").exists()
        victim.send_signal(signal.SIGKILL)
    end = time.monotonic() + 5
    while alive(pid) and time.monotonic() < end:
        time.sleep(0.05)
    assert not alive(pid)


def alive(pid):
    """Whether a process runs; one that has ended may wait for somebody to ask how."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_without_other_processes_the_generator_runs_here(monkeypatch):
    def refuse(*_, **__):
        raise PermissionError("no processes here")

    monkeypatch.setattr(child.subprocess, "Popen", refuse)
    assert drained(code("(__import__('os').getpid() for _ in range(2))")) == ([os.getpid()] * 2, None)


def task(options):
    """A lit box, as a mesh that carries its own light."""
    faces = [*box(), rectangle((0.3, 0.3, 0.9), (0, 0.4, 0), (0.4, 0, 0))]
    scene = scene_of(faces, emission=[0.0] * 6 + [10.0])
    count = len(faces)
    corner = np.arange(4 * count).reshape(-1, 4)
    triangle = corner[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    mesh = Carrier(
        np.concatenate(faces), np.arange(4 * count), 4 * np.arange(count + 1), np.ones(4 * count, bool), triangle, np.arange(2 * count) // 2
    )
    return baking.Task(scene, options, BakeOptions(), (mesh,), ("Box",), (0,))


def test_a_bake_has_the_same_bits_as_here():
    work = task(Options(quality="draft"))
    (steps, there), (_, here) = drained(beside(baking.bake, work, None, True)), drained(baking.bake(work))
    assert any(step.sketch is not None for step in steps)
    for a, b in zip(there.colors, here.colors, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(there.elements.exitance, here.elements.exitance)
