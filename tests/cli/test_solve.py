"""What ``solve`` writes, shows and refuses, with a solver that answers at once."""

import io
import json
import sys
import types
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.command_line import solve_main
from enfilade.core.options import Options, describe

FURNACE = Path(__file__).resolve().parents[1] / "data" / "bench" / "furnace.npz"
REPORT = {
    "rooms": 1,
    "polygons": 15,
    "clusters": np.int64(3),
    "portals": 0,
    "elements": 40,
    "iterations": 7,
    "unshot_fraction": np.float64(1e-4),
    "residual_bound": 0.02,
    "dropped_bound": 0.0,
    "energy": {"emitted": 10.0, "absorbed": 10.0, "escaped": 0.0},
    "segment_tests": 123_456,
    "seconds": {"merge": 0.1, "cluster": 0.2, "graph": 0.0, "solve": 1.0, "total": 1.3},
    "peak_bytes": 2**27,
}


@dataclass(frozen=True)
class Progress:
    stage: str
    fraction: float
    message: str


class Solution:
    """Irradiance (1, 2, polygon) at a point, exitance 5 everywhere."""

    report = REPORT

    def __init__(self, polygons):
        self.polygons = polygons

    def irradiance(self, points, polygon):
        return np.stack([np.ones(len(points)), np.full(len(points), 2.0), polygon], axis=1).astype(np.float32)

    def polygon_exitance(self):
        return np.full((self.polygons, 3), 5.0, np.float32)


@pytest.fixture
def solver(monkeypatch):
    """Puts a fake in the place of the pipeline and keeps what it was asked."""
    asked = types.SimpleNamespace(options=None, failure=None)

    def solve(scene, options, progress=None):
        asked.options = options
        for k in range(40):
            progress(Progress("solve", k / 40, f"round {k}"))
        if asked.failure:
            raise asked.failure
        return Solution(scene.polygon_count)

    monkeypatch.setitem(sys.modules, "enfilade.core.pipeline", types.SimpleNamespace(Progress=Progress, solve=solve))
    return asked


def run(*arguments):
    out, err = io.StringIO(), io.StringIO()
    code = solve_main([str(a) for a in arguments], out, err)
    return code, out.getvalue(), err.getvalue()


def refused(*arguments):
    """The one sentence of a run that is refused."""
    code, out, err = run(*arguments)
    lines = err.splitlines()
    assert code == 2
    assert out == ""
    assert len(lines) == 1, err
    assert lines[0].startswith("enfilade: ")
    return lines[0]


def test_writes_light_and_report(solver, tmp_path):
    code, out, err = run(FURNACE, "--out", tmp_path / "r.npz", "--report", tmp_path / "r.json")
    assert code == 0, err
    with np.load(FURNACE) as scene, np.load(tmp_path / "r.npz") as result:
        assert set(result.files) == {"E", "B", "seconds"}
        assert result["E"].dtype == np.float32
        assert np.array_equal(result["E"][:, 2], scene["pts_poly"])
        assert np.array_equal(result["B"], np.full((15, 3), 5.0))
        assert result["seconds"].shape == ()
    report = json.loads((tmp_path / "r.json").read_text())
    assert list(report["seconds"]) == ["load", "merge", "cluster", "graph", "solve", "evaluate", "total"]
    assert {k: report[k] for k in REPORT if k != "seconds"} == {k: v for k, v in REPORT.items() if k != "seconds"}
    assert [line for line in out.splitlines() if line.startswith("written: ")] == [
        f"written: {tmp_path / 'r.npz'}",
        f"written: {tmp_path / 'r.json'}",
    ]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r.json", "r.npz"]


def test_report_is_strict_json(solver, tmp_path, monkeypatch):
    """A bound may be infinite, where all light is reflected; JSON has no such number."""
    monkeypatch.setattr(Solution, "report", {**REPORT, "residual_bound": np.float64(np.inf)})
    assert run(FURNACE, "--out", tmp_path / "r.npz", "--report", tmp_path / "r.json")[0] == 0
    assert json.loads((tmp_path / "r.json").read_text(), parse_constant=pytest.fail)["residual_bound"] is None


def test_summary_shows_the_figures_of_the_report(solver, tmp_path):
    _, out, _ = run(FURNACE, "--out", tmp_path / "r.npz")
    for text in (
        "15 polygons",
        "3 clusters",
        "7 iterations",
        "123,456 segment tests",
        "absorbed 10 W (100.00 %)",
        "unshot 0.01 %",
        "128 MB",
    ):
        assert text in out


def test_progress_is_a_line_for_each_tenth(solver, tmp_path):
    _, _, err = run(FURNACE, "--out", tmp_path / "r.npz")
    assert [line.split("%")[0].strip() for line in err.splitlines()] == [str(10 * k) for k in range(10)]


def test_every_option_reaches_the_solver(solver, tmp_path):
    wanted = {}
    for info in describe(Options):
        if info.kind == "choice":
            wanted[info.name] = info.choices[-1]
        elif info.kind == "path":
            wanted[info.name] = str(tmp_path / "store")
        else:
            wanted[info.name] = type(info.default)(info.minimum + 1)
    flags = [text for info in describe(Options) for text in (info.flag, str(wanted[info.name]))]
    code, _, err = run(FURNACE, "--out", tmp_path / "r.npz", *flags)
    assert code == 0, err
    assert solver.options == Options(**wanted)


def test_memory_takes_a_size(solver, tmp_path):
    run(FURNACE, "--out", tmp_path / "r.npz", "--memory", "512M")
    assert solver.options.memory == 512 * 2**20


def test_scene_without_points_gives_no_irradiance(solver, tmp_path):
    building = FURNACE.parents[2].parent / "sample_scenes" / "duplex.json"
    assert run(building, "--out", tmp_path / "r.npz")[0] == 0
    with np.load(tmp_path / "r.npz") as result:
        assert result["E"].shape == (0, 3)
        assert len(result["B"]) == 792


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["nothere.npz", "--out", "r.npz"], "nothere.npz"),
        ([FURNACE], "--out"),
        ([FURNACE, "--out", "no/such/folder/r.npz"], "--out"),
        ([FURNACE, "--out", "."], "folder"),
        ([FURNACE, "--out", "r.npz", "--report", "no/such/folder/r.json"], "--report"),
        ([FURNACE, "--out", "r.npz", "--report", "r.npz"], "same file"),
        ([FURNACE, "--out", FURNACE], "same file"),
        ([FURNACE, "--out", "r.npz", "--order", "4"], "order"),
        ([FURNACE, "--out", "r.npz", "--quality", "superb"], "quality"),
        ([FURNACE, "--out", "r.npz", "--memory", "much"], "memory"),
        ([FURNACE, "--out", "r.npz", "--nonsense"], "--nonsense"),
        (["notes.npz", "--out", "r.npz"], "notes.npz"),
        (["notes.txt", "--out", "r.npz"], "notes.txt"),
    ],
)
def test_bad_input_is_one_sentence_and_nothing_written(solver, tmp_path, monkeypatch, arguments, part):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.npz").write_text("no scene")
    (tmp_path / "notes.txt").write_text("no scene")
    before = sorted(tmp_path.iterdir())
    assert part in refused(*arguments)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("broken", ["nan", "empty"])
def test_bad_scene_is_one_sentence(solver, tmp_path, broken):
    with np.load(FURNACE) as file:
        arrays = dict(file)
    if broken == "nan":
        arrays["verts"][0, 1] = np.nan
    else:
        arrays.update({key: arrays[key][:0] for key in ("polys", "rho", "emit", "room", "pts", "pts_n", "pts_poly")})
    np.savez(tmp_path / "bad.npz", **arrays)
    refused(tmp_path / "bad.npz", "--out", tmp_path / "r.npz")
    assert not (tmp_path / "r.npz").exists()


@pytest.mark.parametrize(("failure", "code"), [(MemoryError(), 2), (KeyboardInterrupt(), 130)])
def test_failure_in_the_run_leaves_old_results(solver, tmp_path, failure, code):
    old = tmp_path / "r.npz"
    old.write_bytes(b"old")
    solver.failure = failure
    assert run(FURNACE, "--out", old)[0] == code
    assert old.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [old]


def test_what_is_mended_is_said(solver, tmp_path):
    with np.load(FURNACE) as file:
        arrays = dict(file)
    arrays["polys"][3] = arrays["polys"][3, 0]
    np.savez(tmp_path / "odd.npz", **arrays)
    code, _, err = run(tmp_path / "odd.npz", "--out", tmp_path / "r.npz")
    assert code == 0
    assert next(line for line in err.splitlines() if line.startswith("warning: ")).count("no area") == 1
