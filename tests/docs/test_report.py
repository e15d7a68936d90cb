"""The report of speed against error: what it runs, what it keeps, how it reckons."""

import json

import pytest
from enfilade.docs.bench import Bench
from enfilade.docs.processes import run_module
from enfilade.docs.report import page, results
from enfilade.docs.report.__main__ import main as report_main
from enfilade.docs.report.curves import Point, best_of, curves, time_to
from enfilade.docs.report.plan import Setting, settings
from enfilade.docs.report.results import PACKAGE, Results

MACHINE = {"processor": "p", "cores": "2", "system": "s", "python": "3", "numpy": "1", "threads": "2", "enfilade": "0"}
SCORE = {"rmse": 0.1, "p95": 0.3, "bias": 0.0, "noise": 0.01, "dark_rmse": None, "dark_p95": None, "dark_noise": None}


def points(*pairs):
    """A curve from (seconds, error)."""
    return [Point("", 1, t, t, 1, SCORE | {"rmse": e}, {}) for t, e in pairs]


def test_times_are_read_off_a_straight_line_of_logarithms():
    noise = points((1, 0.08), (4, 0.04), (16, 0.02))
    assert time_to(noise, 0.05, "rmse", noisy=True).seconds == pytest.approx(2.56)  # (0.08 / 0.05) ** 2
    assert time_to(noise, 0.05, "rmse", noisy=True).how == "between"
    beyond = time_to(noise, 0.01, "rmse", noisy=True)
    assert (beyond.seconds, beyond.how) == (pytest.approx(64), "beyond")
    assert time_to(noise, 0.01, "rmse", noisy=False) is None
    within = time_to(noise, 0.09, "rmse", noisy=False)
    assert (within.seconds, within.how) == (1, "within")


def test_what_is_not_noise_does_not_fall_with_more_samples():
    stuck = points((1, 0.4), (4, 0.26), (16, 0.22))
    assert time_to(stuck, 0.02, "rmse", noisy=True) is None
    assert time_to(stuck, 0.3, "rmse", noisy=True).how == "between"
    assert time_to(points((1, 0.4)), 0.2, "rmse", noisy=True).seconds == pytest.approx(4)  # one point tells nothing else


def test_an_error_that_rises_again_counts_where_it_first_falls_below():
    assert time_to(points((1, 0.1), (10, 0.01), (100, 0.02)), 0.03162, "rmse", noisy=False).seconds == pytest.approx(3.16, abs=0.01)


def test_the_best_way_is_the_first_there():
    lines = {
        "Enfilade": points((0.1, 0.001)),
        "Cycles, irradiance at the points": points((1, 0.1), (4, 0.05)),
        "Cycles, light map": points((1, 0.04)),
    }
    name, reached = best_of(lines, 0.05, "rmse")
    assert (name, reached.seconds) == ("Cycles, light map", 1)
    name, reached = best_of(lines, 0.01, "rmse")
    assert (name, reached.seconds) == ("Cycles, irradiance at the points", pytest.approx(100))


def fill(kept, plan):
    """Results as if all had run: Enfilade is exact, Cycles as noisy as its samples."""
    for setting in plan:
        error = 0.004 if setting.tool == "enfilade" else 0.6 / setting.samples**0.5
        common = {"seconds": setting.samples / 64 or 2.0, "cpu_seconds": 1.0, "peak_bytes": 3e8, "score": SCORE | {"rmse": error}}
        own = {"elements": 5, "links": 6, "segment_tests": 7e6, "stages": {"merge": 0.5, "solve": 1.5}}
        kept.add(setting, common | (own if setting.tool == "enfilade" else {"size": "4 texels", "blender": "5"}))


def test_results_outlive_the_process_and_a_page_is_made_of_them(tmp_path):
    plan = settings(quick=True)
    fill(Results(tmp_path / "out" / "r.json", MACHINE), plan)
    again = Results(tmp_path / "out" / "r.json", MACHINE)
    assert all(len(again.of(s)) == 1 for s in plan)
    text = page.page(again, plan, {"cornell": "images/speed-cornell.png"})
    # 2 %: Enfilade is there with its fastest setting after 2 s; noise of 7.5 % after 1 s falls to 2 % after 900 / 64 = 14 s.
    assert "| cornell | 2% | < 2.0 | ~ 14 | irradiance at the points | 7.0 times |" in text
    assert "![time against error on cornell](images/speed-cornell.png)" in text
    assert "| two_rooms | good | 5 | 6 | 7.0 | 0.50 | 1.5 |" in text


def test_results_of_other_code_or_another_machine_do_not_count(tmp_path, monkeypatch):
    path, plan = tmp_path / "r.json", settings(quick=True)
    fill(Results(path, MACHINE), plan)
    monkeypatch.setattr(results, "code_version", lambda: "another")
    later = Results(path, MACHINE)
    assert {s.tool for s in plan if later.of(s)} == {"cycles"}
    with pytest.raises(ValueError, match=r"another machine.*--fresh"):
        Results(path, MACHINE | {"processor": "q"})


def test_medians_are_shown_and_denoised_bakes_are_curves_of_their_own(tmp_path):
    kept = Results(tmp_path / "r.json", MACHINE)
    setting = Setting("cornell", "cycles", way="texels", samples=4, fineness=12.0)
    for seconds in (1.0, 5.0, 2.0):
        smooth = {"seconds": seconds + 1, "cpu_seconds": 1.0, "score": SCORE | {"rmse": 0.05}}
        kept.add(setting, {"seconds": seconds, "cpu_seconds": 1.0, "peak_bytes": 1, "score": SCORE, "denoised": smooth})
    lines = curves(kept, [setting], "cornell")
    assert lines["Cycles, light map"][0].seconds == 2
    assert lines["Cycles, light map, denoised"][0].seconds == 3
    assert lines["Cycles, light map, denoised"][0].score["rmse"] == 0.05


def test_keys_tell_settings_apart():
    for quick in (True, False):
        plan = settings(quick)
        assert len({s.key for s in plan}) == len(plan)
        assert json.loads(json.dumps([s.key for s in plan]))
    assert {s.scene for s in settings(False)} == {"cornell", "two_rooms", "office", "building", "furnace", "hard"}
    assert {s.tool for s in settings(False, scenes=["office"], tools=["enfilade"])} == {"enfilade"}


def test_a_missing_package_is_named(monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert report_main(["--quick", "--page-only"]) == 2
    assert "matplotlib is missing; install it" in capsys.readouterr().err


def test_no_setting_is_said(capsys):
    with pytest.raises(SystemExit):
        report_main(["--scenes", "palace"])
    assert "palace" in capsys.readouterr().err


def test_a_picture_is_drawn(tmp_path):
    plots = pytest.importorskip("enfilade.docs.report.plots")
    plots.draw("room", {"Enfilade": points((1, 0.1), (2, 0.01))}, tmp_path / "images" / "p.png")
    assert (tmp_path / "images" / "p.png").read_bytes().startswith(b"\x89PNG")


def test_enfilade_runs_as_a_program(programs):
    result = run_module(f"{PACKAGE}.enfilade_run", "furnace", "draft", 1)
    assert result["score"]["rmse"] < 0.02
    assert result["seconds"] >= sum(result["stages"].values()) - 0.05
    assert result["cpu_seconds"] > 0.1


@pytest.mark.parametrize(("way", "fineness"), [("points", 0), ("vertices", 0.5), ("texels", 8)])
def test_cycles_finds_the_light_of_the_furnace(programs, way, fineness):
    pytest.importorskip("bpy")
    result = run_module(f"{PACKAGE}.cycles_run", "furnace", way, 64, fineness, 1)
    # Everything shines alike, so that what is wrong is noise or the place where light was looked up.
    assert result["score"]["rmse"] < 0.05
    assert abs(result["score"]["bias"]) < 0.005
    if way == "texels":
        assert result["denoised"]["score"]["rmse"] < 0.9 * result["score"]["rmse"]
    assert Bench("furnace").dark.sum() == 0
