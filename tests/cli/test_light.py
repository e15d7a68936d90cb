"""``python -m enfilade light``: the table of the light of every room."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.light_command import light_main

ROOT = Path(__file__).resolve().parents[2]
FURNACE = ROOT / "tests" / "data" / "bench" / "furnace.npz"


@pytest.fixture
def light():
    """Run ``light`` and return its code and what it said."""

    def run(*words, **more):
        out, err = io.StringIO(), io.StringIO()
        code = light_main([str(word) for word in words], out, err, **more)
        return code, out.getvalue(), err.getvalue()

    return run


def table(path):
    return list(csv.DictReader(path.open(encoding="utf-8")))


def test_furnace_in_lux(enfilade, tmp_path):
    """Everywhere E = (2, 1, 4) W/m2, of which 179 lm/W times its luminance are lux."""
    done = enfilade("light", FURNACE, "--out", "light.csv", "--quality", "draft")
    assert done.returncode == 0, done.stderr
    assert "written: light.csv" in done.stdout
    rows = table(tmp_path / "light.csv")
    expected = 179.0 * np.dot([2.0, 1.0, 4.0], [0.2126, 0.7152, 0.0722])
    assert {row["part"] for row in rows} >= {"floor", "walls", "ceilings", "work plane"}
    for row in rows:
        assert float(row["average (lx)"]) == pytest.approx(expected, rel=0.01)
        assert float(row["uniformity"]) == pytest.approx(1.0, abs=0.02)


def test_daylight_factors_of_a_closed_room_are_zero(light, tmp_path):
    code, _, _ = light(FURNACE, "--out", tmp_path / "day.csv", "--daylight", "--quality", "draft")
    assert code == 0
    assert {float(row["average (%)"]) for row in table(tmp_path / "day.csv")} == {0.0}


def test_the_work_plane_lies_where_it_is_told(light, tmp_path):
    points = []
    for border in (0.0, 0.3):
        code, _, err = light(FURNACE, "--out", tmp_path / "a.csv", "--quality", "draft", "--border", border, "--work-plane", 0.4)
        assert code == 0, err
        points.append(next(int(row["points"]) for row in table(tmp_path / "a.csv") if row["part"] == "work plane"))
    assert points[1] < points[0]


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ([FURNACE], "--out"),
        ([FURNACE, "--out", "light.txt"], ".csv"),
        ([FURNACE, "--out", "none/light.csv"], "does not exist"),
        (["nothere.npz", "--out", "light.csv"], "nothere.npz"),
        (["broken.npz", "--out", "light.csv"], "broken.npz"),
        (["house.blend", "--out", "light.csv"], "pip install bpy"),
        ([FURNACE, "--out", "light.csv", "--border", "-1"], "--border"),
        ([FURNACE, "--out", "light.csv", "--work-plane", "nan"], "--work-plane"),
    ],
)
def test_bad_input_is_one_sentence_and_nothing_written(light, tmp_path, monkeypatch, words, part):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.npz").write_text("no scene")
    before = sorted(tmp_path.iterdir())
    code, out, err = light(*words)
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert part in err
    assert sorted(tmp_path.iterdir()) == before
