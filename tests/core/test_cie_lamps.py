"""CIE 171:2006, cases with point sources and skies: 5.2, 5.8, 5.9 and 5.11, within the tolerances that the closed forms allow."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.daylight_factor import under_overcast_sky
from enfilade.core.lamps import Lamps, Sky
from enfilade.core.light_report import surface_grid
from enfilade.core.options import Options
from enfilade.core.pipeline import solve
from lamp_samples import even_sky, point_lamp
from scenery import box, portals_of, rectangle, scene_of

CASES = json.loads((Path(__file__).resolve().parents[1] / "data" / "cie171_lamps.json").read_text(encoding="utf-8"))
HIGH = np.arange(2.75, 0, -0.5)
ALONG = np.arange(0.25, 4, 0.5)


def wall_points(y):
    return np.column_stack([np.full(6, 2.0), np.full(6, y), HIGH])


def lines(z, far=False):
    y = ALONG[::-1] if far else ALONG
    return np.column_stack([np.full(8, 2.0), y, np.full(8, z)])


def assert_case(case, found, names, scale=1.0):
    expected = [CASES[case]["expected"][name] for name in names]
    assert scale * found == pytest.approx(np.array(expected), rel=CASES[case]["rtol"], abs=CASES[case]["atol"])


def irradiance(scene, lamps, points, polygon):
    solution = solve(replace(scene, lamps=lamps) if lamps else scene, Options(threads=1))
    return solution.irradiance(points, np.broadcast_to(polygon, len(points)))[:, 0].astype(float)


def test_point_source_over_a_plane():
    # Points A to J, by E = I h2 / d4 for a Lambertian source that faces the plane: here one with that distribution.
    floor = rectangle((-4, -4, 0), (8, 0, 0), (0, 8, 0))
    expected = CASES["5.2"]["expected"]
    lamp = Lamps(points=point_lamp((0, 0, 3), 1000.0))
    d2 = 3 * np.sqrt(1000 * 9 / np.array(list(expected.values())) / 9)  # from E = I h2 / d4
    at = np.column_stack([np.sqrt(np.maximum(d2 - 9, 0)), 0 * d2, 0 * d2])
    found = irradiance(scene_of([floor], reflectance=0.0), lamp, at, 0)
    # A source alike to all sides gives I h / d3: the same but for the cosine at the source.
    assert found * 3 / np.sqrt(d2) == pytest.approx(np.array(list(expected.values())), rel=CASES["5.2"]["rtol"])


@pytest.mark.parametrize("rho", [0.1, 0.5, 0.9])
def test_interreflection_of_a_bulb_in_a_cube(rho):
    scene = replace(scene_of(box(high=(4, 4, 4)), reflectance=rho), lamps=Lamps(points=point_lamp((2, 2, 2), 10000 / (4 * np.pi))))
    solution = solve(scene, Options(threads=1))
    grid = surface_grid(solution)
    found = solution.irradiance(grid.points, grid.polygon)[:, 0].astype(float)
    away = np.abs(grid.points - 2)
    direct = 10000 / (4 * np.pi) * away.max(1) / np.linalg.norm(away, axis=1) ** 3
    assert_case("5.8", np.array([((found - direct) * grid.area).sum() / 96]), [f"rho={rho}"])


def roof_opening():
    faces = box(high=(4, 4, 3), leave_out="z+")
    sides = ((0, 0, 4, 1.5), (0, 2.5, 4, 1.5), (0, 1.5, 1.5, 1), (2.5, 1.5, 1.5, 1))
    roof = [rectangle((x, y, 3), (0, h, 0), (w, 0, 0)) for x, y, w, h in sides]
    hole = rectangle((1.5, 1.5, 3), (1, 0, 0), (0, 1, 0))
    return scene_of([*faces, *roof], reflectance=0.0, portals=portals_of([hole], [[0, -1]]))


@pytest.mark.parametrize("kind", ["type5", "type16"])
def test_sky_through_a_roof_opening(kind):
    scene = roof_opening()
    scene = replace(scene, lamps=Lamps(sky=even_sky(1 / np.pi))) if kind == "type5" else under_overcast_sky(scene)
    found = irradiance(scene, None, np.concatenate([wall_points(0.0), lines(0.0)]), [2] * 6 + [4] * 8)
    assert_case("5.9", found, [f"{kind}/{name}" for name in "ABCDEFGHIJKLMN"], 100)


def test_sky_and_ground_through_a_facade_opening():
    faces = box(high=(4, 4, 3), leave_out="y-")
    around = ((0, 0, 1, 3), (3, 0, 1, 3), (1, 0, 2, 1), (1, 2, 2, 1))
    wall = [rectangle((x, 0, z), (0, 0, h), (w, 0, 0)) for x, z, w, h in around]
    window = rectangle((1, 0, 1), (2, 0, 0), (0, 0, 1))
    scene = scene_of([*faces, *wall], reflectance=0.0, portals=portals_of([window], [[0, -1]]))
    rows = np.where((np.arange(256) + 0.5) / 256 > 0.5, 1.0, 0.3) / np.pi
    sky = Sky("even over ground", np.repeat(rows[:, None, None], 3, 2).astype(np.float32))
    at = np.concatenate([wall_points(4.0), lines(0.0, True), lines(3.0, True)])
    found = irradiance(scene, Lamps(sky=sky), at, [2] * 6 + [3] * 8 + [4] * 8)
    names = [f"type5/{name}" for name in [*"ABCDEFGHIJKLMN", *(f"{x}'" for x in "GHIJKLMN")]]
    assert_case("5.11", found, names, 100)
