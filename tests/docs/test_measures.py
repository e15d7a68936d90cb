"""The measures of accuracy: that they would notice, and that they say what they find."""

import json
from dataclasses import replace

import numpy as np
import pytest
from enfilade.core.links import directions
from enfilade.core.options import Options
from enfilade.core.pipeline import solve
from enfilade.core.quality import tolerances as usual_tolerances
from enfilade.core.regions import merge
from enfilade.docs import measure
from enfilade.docs.bench import Bench
from enfilade.docs.measures import bases, bases_run, convergence, energy, form_factors, penumbrae, quadrature, segments, solutions, witness
from enfilade.docs.measures.scenes import scene_of, square, table
from enfilade.docs.measures.tables import Table
from scenery import box

CUBE = {"opposed": 0.19982489569838738, "beside": 0.20004377607540316}


def test_form_factors_of_a_cube_by_formula_and_by_a_solve():
    faces = [f.tolist() for f in box()]
    opposed, beside = {"a": [faces[0]], "b": [faces[1]]}, {"a": [faces[0]], "b": [faces[2]]}
    assert form_factors.by_points(opposed) == pytest.approx(CUBE["opposed"], rel=1e-12)
    assert form_factors.by_points(beside) == pytest.approx(CUBE["beside"], rel=1e-9)
    assert form_factors.by_solve(opposed) == pytest.approx(CUBE["opposed"], rel=1e-4)
    assert form_factors.worst([1.0, 2.2], [1.0, 2.0]) == pytest.approx(0.1)


def test_polygons_fall_apart_at_planes():
    plate = square([0.5, 0.5, 0], [0, 0, 1], 1.0)
    parts = quadrature.cut(plate, [[1, 0, 0, 0.25], [0, 1, 0, 0.5], [0, 0, 1, 0]])
    assert sorted(quadrature.area_of(p) for p in parts) == pytest.approx([0.125, 0.125, 0.375, 0.375])
    points, weights = quadrature.graded(plate)
    assert weights.sum() == pytest.approx(1)
    assert weights @ points[:, 0] ** 2 == pytest.approx(1 / 3)


def test_a_blocked_pair_and_a_pair_seen_through_a_door():
    cases = {case["name"]: case for case in table("exact_answers")["form_factors"]}
    pair = cases["opposed squares with a square between"]["pairs"][0]
    assert form_factors.by_points(pair) == pytest.approx(pair["factor"], rel=1e-8)
    # Without the planes the rule does not know where shadows begin.
    assert abs(form_factors.by_points(pair | {"planes": []}) / pair["factor"] - 1) > 1e-8


def test_systems_of_constants_and_solves_are_told_apart_from_wrong_ones():
    data = table("exact_answers")
    case = next(c for c in data["solutions"] if c["name"].startswith("tetrahedron"))
    found = solutions._constants(case, data)
    assert solutions._worst(case, found, case["expected"]) == (pytest.approx(0, abs=1e-9), True)
    assert solutions._worst(case, 1.001 * found, case["expected"])[1] is False
    case = next(c for c in data["solutions"] if c["name"].startswith("furnace"))
    error, within = solutions._worst(case, *solutions._continuous(case))
    assert within
    assert error < 1e-3


@pytest.mark.parametrize("order", [1, 2, 3])
def test_errors_fall_with_the_order_of_the_basis(order):
    errors = [convergence.error_at(order, k) for k in (1, 2, 3)]
    assert convergence.slope_of(errors) == pytest.approx(order, abs=0.2)


def test_penumbrae_are_exact_and_a_missing_blocker_would_show():
    case = next(c for c in table("penumbrae")["cases"] if c["name"] == "contact shadow")
    point = next(p for p in case["points"] if p["irradiance"] > 1)
    dark = next(p for p in case["points"] if p["irradiance"] < 1e-3)
    assert penumbrae._error(case, point) < 1e-6
    assert penumbrae._error(case, dark) < 1e-6
    assert penumbrae._error(case | {"blockers": []}, dark) == pytest.approx(1, abs=1e-6)


def test_the_balance_of_shooters_sees_what_leaves_and_what_is_doubled():
    # Walls of two metres are clusters, and so shooters, of their own.
    walls, lit = box(high=(2, 2, 2)), [0.0] * 5 + [1.0]
    closed = witness.solve_and_keep(scene_of(walls, 0.5, lit), Options(quality="draft", reflected="elements", threads=1))
    shot, arrived, lost = energy.balance(closed)
    assert len(shot) == 6
    np.testing.assert_allclose(arrived, shot, rtol=0.05)
    assert lost.max() == 0
    doubled = replace(closed, gains=replace(closed.gains, received=2 * closed.gains.received))
    np.testing.assert_allclose(energy.balance(doubled)[1], 2 * arrived)
    # Without its ceiling the cube loses a fifth of what each wall shoots, and as much of the floor's.
    lamp = square([1, 1, 1.99], [0, 0, -1], 0.02)
    opened = witness.solve_and_keep(scene_of([*walls[:5], lamp], 0.5, lit), Options(quality="draft", reflected="elements", threads=1))
    shot, arrived, lost = energy.balance(opened)
    floor = np.argmax(shot)
    assert lost[floor] / shot[floor] == pytest.approx(0.2, abs=0.03)
    np.testing.assert_allclose((arrived + lost)[floor], shot[floor], rtol=0.05)


def test_exchanges_are_reciprocal(monkeypatch):
    solved = witness.solve_and_keep(scene_of(box(), 0.5, [0.0] * 5 + [1.0]), Options(quality="draft", threads=1))
    assert energy.asymmetry(solved) < 1e-14
    monkeypatch.setattr(energy, "directions", lambda group: [next(directions(group))])
    assert energy.asymmetry(solved) > 0.1


def test_a_solve_is_watched_without_being_changed():
    scene = Bench("two_rooms").scene
    options = Options(quality="draft", reflected="elements", threads=1)
    with witness.segment_tests() as timed:
        watched = solve(scene, options)
    plain = solve(scene, options)
    np.testing.assert_array_equal(watched.light.reflected, plain.light.reflected)
    assert timed.tests >= plain.report["segment_tests"] > 0
    assert timed.seconds > 0
    assert sum(n * i * j for n, i, j in timed.shapes) == timed.tests


def test_the_bare_loop_finds_what_is_cut():
    # Heights 1 and -1, at 0 and at 3 of the frame: the segment passes the plane half way, at 1.5, which is outside of 1.
    a, b = (
        [np.array([[1.0, 1.0]]), np.array([[0.0, 0.0]]), np.zeros((1, 2))],
        [np.array([[-1.0, -1.0]]), np.array([[3.0, 1.0]]), np.zeros((1, 2))],
    )
    assert segments._bare(a, b)[0, 0].tolist() == [False, True]
    assert segments.bare_rate([(1000, 2, 2)]) > 1e4


def test_tolerances_between_two_qualities():
    regions = merge(scene_of(box(), 0.5, 0.0))
    draft, good = (usual_tolerances(Options(quality=q), regions) for q in ("draft", "good"))
    assert bases_run.between(0.0)(good, regions) == draft
    half = bases_run.between(0.5)(good, regions)
    assert half.exchange == pytest.approx((draft.exchange * good.exchange) ** 0.5)
    assert bases_run.between(2.0)(good, regions) == usual_tolerances(Options(quality="fine"), regions)


def test_errors_at_equal_cost_are_read_off_curves():
    assert bases.error_at([(1, 0.1), (100, 0.001)], 10) == pytest.approx(0.01)
    assert bases.error_at([(1, 0.1), (10, 0.2), (100, 0.001)], 10) == pytest.approx(0.1)
    result = bases_run.main("furnace", 1, 0.0)
    assert all(found["score"]["rmse"] < 0.05 and found["cpu_seconds"] > 0 for found in result["ways"].values())
    assert result["ways"]["gathered"]["score"] != result["ways"]["elements"]["score"]
    assert result["light_bytes"] > 0


def test_a_page_keeps_what_stands_around_its_marks(tmp_path):
    page = tmp_path / "accuracy.md"
    page.write_text(f"# Title\n\n{measure.BEGIN}\nold\n{measure.END}\n\nafter\n")
    lines = [["slope", "1", "1.02", "yes"]]
    text = measure.text_of(
        [Table("Part", "What it is.", ["a"], [["1"]], lines)], {"processor": "p", "cores": "2", "python": "3", "numpy": "1"}
    )
    measure.write(page, text)
    measure.write(page, text)
    found = page.read_text()
    assert found.startswith("# Title\n")
    assert found.endswith("\nafter\n")
    assert "old" not in found
    assert found.count("| slope | 1 | 1.02 | yes |") == 1
    with pytest.raises(ValueError, match="marks"):
        measure.write(tmp_path / "other.md", text) if (tmp_path / "other.md").write_text("x") else None


def test_the_page_of_the_repository_has_its_marks():
    text = measure.PAGE.read_text(encoding="utf-8")
    assert text.index(measure.BEGIN) < text.index(measure.END)


def test_parts_that_were_measured_are_kept_until_the_code_changes(tmp_path, monkeypatch):
    kept = measure.Kept(tmp_path / "m.json")
    made = Table("T", "text", ["h"], [["r"]], [["a", "b", "c", "yes"]])
    kept.keep("energy", made)
    assert measure.Kept(tmp_path / "m.json").table("energy") == made
    assert json.loads((tmp_path / "m.json").read_text())["energy"]["table"]["title"] == "T"
    monkeypatch.setattr(measure, "code_version", lambda: "another")
    assert measure.Kept(tmp_path / "m.json").table("energy") is None
