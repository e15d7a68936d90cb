"""Blocks of work in processes: order, errors, an early end, and what goes over the wire."""

import gc
import io
import operator
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from enfilade.core import child, parallel
from enfilade.core.parallel import Crew, WorkerLost, worker_count
from enfilade.core.wire import Shared, attached, receive, send
from scenery import crew

PID = "__import__('os').getpid()"


@pytest.mark.parametrize("workers", [1, 2, 4])
def test_results_come_in_the_order_of_the_blocks(workers):
    hands = crew(workers)
    assert list(hands.map(operator.mul, (3,), range(50))) == [3 * k for k in range(50)]
    assert list(hands.map(operator.mul, (3,), [])) == []
    assert list(hands.map(eval, (), ["__import__('time').sleep(0.05) or 1", "2", "3"])) == [1, 2, 3]


def test_blocks_run_side_by_side_in_other_processes():
    hands = crew(2)
    begin = time.perf_counter()
    found = list(hands.map(eval, (), ["(__import__('time').sleep(0.5), " + PID + ")"] * 4))
    assert time.perf_counter() - begin < 1.8
    assert len({pid for _, pid in found}) == 2
    assert os.getpid() not in {pid for _, pid in found}


def test_a_short_job_calls_nobody():
    hands = Crew(4)
    assert set(hands.map(eval, (), [PID] * 20)) == {os.getpid()}


def test_a_long_job_calls_workers(monkeypatch):
    monkeypatch.setattr(parallel, "PATIENCE", 0.05)
    pids = list(Crew(2).map(eval, (), ["(__import__('time').sleep(0.05), " + PID + ")[1]"] * 60))
    assert pids[0] == os.getpid() != pids[-1]


@pytest.mark.parametrize("workers", [1, 3])
def test_an_error_in_a_block_reaches_the_caller(workers):
    hands, found = crew(workers), []
    with pytest.raises(ZeroDivisionError):
        found.extend(hands.map(operator.truediv, (1,), [1, 2, 4, 0, 8]))
    assert len(found) <= 3
    assert list(hands.map(operator.add, (1,), range(5))) == [1, 2, 3, 4, 5]


def test_an_error_that_cannot_travel_comes_as_text():
    raising = "(_ for _ in ()).throw(type('Local', (Exception,), {})('nobody knows'))"
    with pytest.raises(RuntimeError, match="nobody knows"):
        list(crew(2).map(eval, (), [f"next({raising})"]))


@pytest.mark.parametrize("workers", [1, 2])
def test_blocks_are_taken_a_few_ahead_and_none_after_the_end(workers):
    taken = []

    def blocks():
        for k in range(1000):
            taken.append(k)
            yield k

    results = crew(workers).map(operator.add, (0,), blocks())
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    assert len(taken) <= 3 + 2 * workers + 1
    results.close()
    assert len(taken) < 20


def test_an_early_end_does_not_wait_for_the_blocks_under_way():
    hands = crew(2)
    results = hands.map(eval, (), ["1", *["__import__('time').sleep(30)"] * 10])
    assert next(results) == 1
    begin = time.perf_counter()
    results.close()
    assert time.perf_counter() - begin < 5
    hands.summon()
    assert list(hands.map(operator.add, (1,), range(3))) == [1, 2, 3]


def test_a_worker_that_dies_is_told_in_one_sentence():
    hands = crew(2)
    with pytest.raises(WorkerLost, match="option threads"):
        list(hands.map(eval, (), ["__import__('os')._exit(9)"] * 3))
    hands.summon()
    assert list(hands.map(operator.add, (1,), range(3))) == [1, 2, 3]


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="looks at processes through /proc")
def test_workers_go_with_their_crew():
    hands = crew(2)
    pids = {process.pid for process in hands._processes}
    assert all(Path(f"/proc/{pid}").exists() for pid in pids)
    del hands
    gc.collect()
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


def test_a_worker_that_outlives_its_program_ends_without_a_word(tmp_path):
    program = f"""
import os, sys
sys.path[:] = {sys.path!r}
import conftest
from enfilade.core.parallel import Crew
crew = Crew(2)
crew.summon()
results = crew.map(eval, (), ["1"] + ["__import__('time').sleep(0.5)"] * 4)
next(results)
os._exit(0)
"""
    root = Path(parallel.__file__).parents[1]
    with (tmp_path / "said").open("wb") as said:
        subprocess.run([sys.executable, "-c", program], cwd=root, stderr=said, check=True, timeout=60)
        time.sleep(1.5)
    assert (tmp_path / "said").read_bytes() == b""


def test_without_other_processes_the_work_is_done_here(monkeypatch):
    def refuse(*_, **__):
        raise PermissionError("no processes here")

    monkeypatch.setattr(child.subprocess, "Popen", refuse)
    hands = crew(3)
    assert list(hands.map(operator.mul, (2,), range(5))) == [0, 2, 4, 6, 8]


def test_a_program_that_is_no_python_finds_its_python(monkeypatch, tmp_path):
    folder = tmp_path if sys.platform == "win32" else tmp_path / "bin"
    folder.mkdir(exist_ok=True)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "blender"))
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert list(crew(2).map(operator.mul, (2,), range(3))) == [0, 2, 4]
    name = f"python{sys.version_info.major}.{sys.version_info.minor}" + (".exe" if sys.platform == "win32" else "")
    (folder / name).write_text("#!/bin/sh\n")
    (folder / name).chmod(0o755)
    assert Path(child.python()) == folder / name


def test_arrays_go_over_the_wire_unchanged():
    rng = np.random.default_rng(1)
    message = {"a": rng.random((100, 3)), "b": (np.arange(5), "text"), "t": rng.random((4, 6)).T, "empty": np.zeros((0, 3), np.float32)}
    stream = io.BytesIO()
    send(stream, message)
    send(stream, 7)
    stream.seek(0)
    found = receive(stream)
    for name in ("a", "t", "empty"):
        np.testing.assert_array_equal(found[name], message[name])
        assert found[name].dtype == message[name].dtype
    found["a"][0] = 1  # results may be written to
    assert receive(stream) == 7
    with pytest.raises(EOFError):
        receive(stream)


def test_shared_arrays_are_seen_and_cannot_be_changed():
    thing = np.arange(1000.0), np.zeros((0, 2)), "text"
    shared = Shared(thing)
    found = attached(shared.ticket)
    shared.close()
    np.testing.assert_array_equal(found[0], thing[0])
    assert found[1].shape == (0, 2)
    assert found[2] == "text"
    with pytest.raises(ValueError, match="read-only"):
        found[0][0] = 1


def test_the_number_of_workers():
    assert worker_count(3) == 3
    assert worker_count(0) >= 1
