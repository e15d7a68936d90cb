"""The benchmark that is run before and after a change."""

import json

import pytest
from enfilade.docs import benchmark
from enfilade.docs.report import results


def run(seconds, elements, rmse):
    score = {"rmse": rmse, "p95": 0.1, "dark_rmse": None, "dark_p95": None}
    common = {"links": 10, "segment_tests": 20, "peak_bytes": 1e8, "stages": {"merge": 0.5}, "score": score}
    return {"seconds": seconds, "cpu_seconds": seconds, "elements": elements, **common}


def test_figures_of_several_runs_are_medians():
    figures = benchmark.summed_up([run(1.0, 5, 0.1), run(9.0, 7, 0.3), run(2.0, 6, 0.2)])
    assert (figures["seconds"], figures["elements"], figures["rmse"]) == (2.0, 6, 0.2)
    assert figures["stage merge"] == 0.5
    assert "dark_rmse" not in figures


def test_what_became_worse_is_marked():
    before, after = ({"room good": benchmark.summed_up([r])} for r in (run(1.0, 100, 0.1), run(1.04, 103, 0.1)))
    rows, worse = benchmark.compared(before, after)
    assert worse == 1
    assert ["room good", "elements", "100", "103", "1.030", "worse"] in rows
    assert ["room good", "cpu_seconds", "1.000 s", "1.040 s", "1.040", ""] in rows


def test_two_files_are_compared(tmp_path, capsys):
    for name, error in (("a", 0.1), ("b", 0.2)):
        figures = {"room good": benchmark.summed_up([run(1.0, 100, error)])}
        (tmp_path / f"{name}.json").write_text(json.dumps({"machine": {"cores": "2"}, "code": name, "runs": figures}))
    paths = [str(tmp_path / "a.json"), str(tmp_path / "b.json")]
    assert benchmark.main(["--compare", *paths]) == 1
    assert "| room good | rmse | 10.000% | 20.000% | 2.000 | worse |" in capsys.readouterr().out
    assert benchmark.main(["--compare", paths[0], paths[0]]) == 0


def test_a_missing_file_is_said_in_a_sentence(tmp_path, capsys):
    assert benchmark.main(["--compare", str(tmp_path / "a.json"), str(tmp_path / "b.json")]) == 2
    assert "a.json" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        benchmark.main([])


def test_a_scene_is_measured(programs, tmp_path):
    assert benchmark.main([str(tmp_path / "r.json"), "--scenes", "furnace", "--qualities", "draft", "--runs", "1", "--threads", "1"]) == 0
    result = json.loads((tmp_path / "r.json").read_text())
    assert result["runs"]["furnace draft"]["rmse"] < 0.02
    assert result["code"] == results.code_version()
