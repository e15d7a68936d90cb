"""Exponents over the siblings of a scene."""

import pytest
from enfilade.docs import scaling
from enfilade.docs.scaling import fitted, main


def test_the_exponent_of_a_power_is_found():
    assert fitted([1, 8, 27], [3 * n**1.25 for n in (1, 8, 27)]) == pytest.approx(1.25, abs=1e-12)
    # Noise of the same size to both sides leaves the middle out: least squares over the logarithms.
    assert fitted([1, 10, 100], [2, 10, 2]) == pytest.approx(0, abs=1e-12)
    assert fitted([5, 5], [1, 2]) != fitted([5, 5], [1, 2])


def test_every_sibling_is_solved_once_and_the_fit_stands_below(monkeypatch, tmp_path):
    asked = []

    def solve(module, scene, scale, seed, options, err=None):
        asked.append((scene, scale))
        seconds = {"merge": scale, "cluster": scale, "graph": scale, "solve": 60 * scale**1.5}
        parts = {"light": 10 * scale**2, "link": 10 * scale, "shoot": 5 * scale}
        report = {"polygons": round(54_000 * scale), "elements": 10, "links": 20, "seconds": seconds, "solve_seconds": parts}
        return {"report": report, "base_bytes": 40e6, "peak_bytes": 40e6 + 800e6 * scale}

    monkeypatch.setattr(scaling, "run_module", solve)
    arguments = ["--out", str(tmp_path), "--scales", "1/2", "1/8", "1"]
    assert main(arguments) == main(arguments) == 0
    assert asked == [("test_scene", 0.125), ("test_scene", 0.5), ("test_scene", 1.0)]
    lines = [[c.strip() for c in line.strip("|").split("|")] for line in (tmp_path / "scaling.md").read_text().splitlines() if "|" in line]
    found = dict(zip(lines[0], lines[-1], strict=True))
    assert found["scale"] == "exponent"
    assert (found["elements"], found["light, s"], found["link, s"], found["peak, MB"]) == ("0.00", "2.00", "1.00", "1.00")
    assert [line[1] for line in lines[2:5]] == ["6,750", "27,000", "54,000"]
