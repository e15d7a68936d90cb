"""How the errors of the tables are reckoned, and what a run is said to take."""

import sys

import numpy as np
import pytest
from enfilade.docs.bench import NAMES, Bench
from enfilade.docs.processes import RunError, run_module


@pytest.fixture(scope="module")
def two_rooms():
    return Bench("two_rooms")


def test_the_reference_has_no_error_and_its_noise_is_that_of_the_scenes_page(two_rooms):
    score = two_rooms.score(two_rooms.light)
    assert score["rmse"] == score["p95"] == score["bias"] == score["dark_rmse"] == 0
    assert score["noise"] == pytest.approx(0.0055, abs=5e-5)


def test_errors_of_light_that_is_off_by_a_known_part(two_rooms):
    # A tenth too much everywhere: the root mean square is a tenth of that of the light itself.
    weight = two_rooms.area / two_rooms.area.sum()
    mean = weight @ two_rooms.light
    expected = 0.1 * np.sqrt(np.mean(weight @ two_rooms.light**2)) / mean.mean()
    score = two_rooms.score(1.1 * two_rooms.light)
    assert score["rmse"] == pytest.approx(expected)
    assert score["bias"] == pytest.approx(0.1)
    # Of a value above 1 % of the mean the error is exactly a tenth, and that is most of them.
    assert score["p95"] == pytest.approx(0.1)


def test_errors_where_no_lamp_shines_count_only_there(two_rooms):
    found = two_rooms.light.copy()
    found[two_rooms.dark] = 0
    score = two_rooms.score(found)
    assert score["dark_p95"] == pytest.approx(1)
    assert score["dark_rmse"] > 1
    assert score["rmse"] < 0.2
    found = two_rooms.light.copy()
    found[~two_rooms.dark] = 0
    assert two_rooms.score(found)["dark_rmse"] == 0


def test_scenes_without_dark_rooms_have_no_such_error():
    score = Bench("furnace").score(np.tile([2.0, 1.0, 4.0], (1546, 1)))
    assert score["dark_rmse"] is None
    assert score["rmse"] < 3e-3  # the reference's own noise


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_is_there_with_its_reference(name):
    bench = Bench(name)
    assert bench.light.shape == (len(bench.area), 3) == bench.scene.points.position.shape


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory of running processes is read from /proc")
def test_a_run_tells_its_result_and_its_most_memory(programs):
    text = "import json, sys, time\nx = b'1' * 200_000_000\ntime.sleep(1)\ndel x\nprint('words')\nprint(json.dumps({'a': sys.argv[1:]}))"
    (programs / "hungry.py").write_text(text)
    result = run_module("hungry", 1, "two")
    assert result["a"] == ["1", "two"]
    assert 200e6 < result["peak_bytes"] < 260e6


def test_a_run_that_fails_says_why(programs):
    (programs / "failing.py").write_text("raise SystemExit('no light at all')")
    with pytest.raises(RunError, match=r"failing.*no light at all"):
        run_module("failing")
