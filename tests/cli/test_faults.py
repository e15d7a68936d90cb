"""What happens to a run from outside: killed, interrupted, no room on the disk, no memory, another run beside it.

What was there before stays, nothing half-made is left, and what is told is one sentence.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

resource = pytest.importorskip("resource")
ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "tests" / "data" / "bench" / "cornell.npz"
OLD = b"what an earlier run has left"
START = f"""
import importlib.util, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell that runs the tests in the background has it ignored
spec = importlib.util.spec_from_file_location("enfilade", {str(ROOT / "__init__.py")!r}, submodule_search_locations=[{str(ROOT)!r}])
sys.modules["enfilade"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(sys.modules["enfilade"])
from enfilade.__main__ import main
"""


def start(folder, *more, before="", name="light.npz"):
    """A run of ``solve`` in a process of its own; ``before`` is run in it first."""
    arguments = ["solve", str(SCENE), "--out", str(folder / name), "--quality", "good", "--threads", "1", *map(str, more)]
    program = f"{START}\n{before}\nsys.exit(main({arguments!r}))"
    return subprocess.Popen(
        [sys.executable, "-c", program],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )


def ended(process):
    """Exit code and the last line of what was told; never a traceback."""
    try:
        told = process.communicate(timeout=60)[1]
    finally:
        process.kill()
    assert "Traceback" not in told
    return process.returncode, told.strip().splitlines()[-1] if told.strip() else ""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "light.npz").write_bytes(OLD)
    return tmp_path


def untouched(folder):
    return [p.name for p in folder.iterdir()] == ["light.npz"] and (folder / "light.npz").read_bytes() == OLD


@pytest.mark.parametrize("kill", [signal.SIGKILL, signal.SIGINT])
def test_a_run_that_is_ended_leaves_what_there_was(folder, kill):
    process = start(folder)
    assert "%" in process.stderr.readline()  # it is on its way
    time.sleep(0.2)
    process.send_signal(kill)
    code, told = ended(process)
    assert untouched(folder)
    if kill == signal.SIGINT:
        assert (code, told) == (130, "enfilade: interrupted, nothing was written")
    assert ended(start(folder))[0] == 0
    assert np.load(folder / "light.npz")["B"].min() >= 0


def test_a_full_disk_leaves_what_there_was(folder):
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 10, 1 << 10))"
    code, told = ended(start(folder, before=limit))
    assert code == 2
    assert told.startswith("enfilade: ")
    assert "light.npz" in told
    assert untouched(folder)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the address space of a process can be read here only")
@pytest.mark.parametrize("spare", [4, 6])  # MB; the stack grows into it too, and what finds no room for that is ended by the system
def test_too_little_memory_is_one_sentence(folder, spare):
    limit = f"""
import resource, enfilade.core.pipeline, enfilade.core.command_line, enfilade.core.scene_files, enfilade.core.scene_checks, numpy.random
numpy.ones((200, 200)) @ numpy.ones((200, 200))  # OpenBLAS waits for its work space for ever
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + {spare << 20}, used + {spare << 20}))
"""
    code, told = ended(start(folder, before=limit))
    assert code == 2
    assert "not enough memory" in told
    assert untouched(folder)


def test_two_runs_into_one_file_end_with_the_light_of_one(tmp_path):
    runs = [
        start(tmp_path),
        start(tmp_path, "--order", "1"),
        start(tmp_path, name="one.npz"),
        start(tmp_path, "--order", "1", name="two.npz"),
    ]
    assert [ended(run)[0] for run in runs] == [0] * 4
    both, one, two = (np.load(tmp_path / f"{name}.npz")["B"] for name in ("light", "one", "two"))
    assert np.array_equal(both, one) or np.array_equal(both, two)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["light.npz", "one.npz", "two.npz"]
