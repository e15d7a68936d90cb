"""Illuminance by room, on surfaces and on work planes, and the daylight factor."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from enfilade.core.daylight_factor import in_per_cent, under_overcast_sky
from enfilade.core.lamps import Lamps
from enfilade.core.light_report import as_csv, report_of_light, surface_grid, work_plane
from enfilade.core.options import Options
from enfilade.core.photometry import LUMINOUS_EFFICACY
from enfilade.core.pipeline import solve
from enfilade.core.transport import lambert
from lamp_samples import area_lamp, point_lamp
from scenery import box, portals_of, rectangle, scene_of

DRAFT = Options(quality="draft", threads=1)
PANEL = rectangle((1.5, 1, 2.9), (0, 1, 0), (1, 0, 0))


def table(low=(0.5, 0.5, 0), high=(1.5, 1.5, 0.7)):
    return box(low, high, inward=False, leave_out="z-")


def solved(reflectance=0.0, furniture=True, lamps=None):
    polygons = [*box(high=(4, 3, 3)), *(table() if furniture else [])]
    scene = scene_of(polygons, reflectance=reflectance, object=[0] * 6 + [1] * (len(polygons) - 6))
    return solve(replace(scene, lamps=lamps or Lamps(area_lamp(PANEL, 100.0))), DRAFT)


def test_the_grid_of_surfaces_has_their_area_and_lies_on_them():
    solution = solved()
    grid = surface_grid(solution)
    area = np.bincount(grid.part, grid.area, minlength=5)
    # Floor without what the table covers, four walls and four sides, the ceiling, the top of the table.
    assert area == pytest.approx([11, 42 + 2.8, 12, 1, 0], rel=1e-6)
    on_floor = grid.points[grid.part == 0]
    assert (on_floor[:, 2] == 0).all()
    assert not ((on_floor[:, :2] > 0.5) & (on_floor[:, :2] < 1.5)).all(1).any()


def test_a_work_plane_lies_over_the_floor_without_furniture_and_borders():
    solution = solved()
    for height, border, low in ((0.8, 0.5, 0.5), (0.5, 0.3, 0.3), (0.8, 0.0, 0.0)):
        points = work_plane(solution, height, border).points
        assert points[:, 2] == pytest.approx(height)
        assert points[:, :2].min() >= low
        assert points[:, 0].max() <= 4 - low
        inside = ((points[:, :2] > 0.5) & (points[:, :2] < 1.5)).all(1)
        # Over the table there is a plane at 0.8 m, in it there is none.
        assert inside.any() == (height > 0.7)
    # A room too narrow for its border has a work plane all the same.
    assert len(work_plane(solution, 0.8, 5.0).points) > 50


def test_illuminance_on_the_work_plane_is_exact_in_a_black_room():
    solution = solved()
    rows = {row.part: row for row in report_of_light(solution, 0.8, 0.5)}
    points = work_plane(solution, 0.8, 0.5).points
    up = np.tile([0, 0, 1.0], (len(points), 1))
    lux = LUMINOUS_EFFICACY * 100 * lambert(points, up, np.repeat(PANEL[None], len(points), 0))
    plane = rows["work plane"]
    assert (plane.average, plane.minimum, plane.maximum) == pytest.approx((lux.mean(), lux.min(), lux.max()), rel=1e-5)
    assert plane.uniformity == pytest.approx(lux.min() / lux.mean(), rel=1e-5)
    assert rows["floor"].minimum == 0  # beside the table
    assert rows["ceilings"].average == 0


def test_reflected_light_arrives_on_the_work_plane_too():
    # In an integrating box with a small isotropic lamp the mean of the surfaces is known: rho P / (S (1 - rho)) and the direct light.
    solution = solved(0.5, False, Lamps(points=point_lamp((2, 1.5, 1.5), 10.0)))
    rows = {row.part: row for row in report_of_light(solution, 0.8, 0.0)}
    total = sum(rows[p].average * rows[p].area for p in ("floor", "walls", "ceilings"))
    assert total / LUMINOUS_EFFICACY == pytest.approx(40 * np.pi / 0.5, rel=0.02)
    direct = LUMINOUS_EFFICACY * 10 * 0.7 / 0.7**3
    assert rows["work plane"].maximum > direct
    assert rows["work plane"].maximum == pytest.approx(direct + LUMINOUS_EFFICACY * 40 * np.pi / 66 / 0.5 * 0.5 / 0.5, rel=0.25)


def test_every_room_has_its_rows_and_they_are_csv():
    rooms = [*box(high=(4, 3, 3), leave_out="x+"), *box(low=(4, 0, 0), high=(8, 3, 3), leave_out="x-")]
    opening = rectangle((4, 0, 0), (0, 3, 0), (0, 0, 3))
    scene = scene_of(rooms, room=np.repeat([0, 1], 5), portals=portals_of([opening], [[0, 1]]))
    rows = report_of_light(solve(replace(scene, lamps=Lamps(area_lamp(PANEL, 10.0))), DRAFT))
    assert [row.room for row in rows] == ["room 0"] * 4 + ["room 1"] * 4
    read = list(csv.reader(io.StringIO(as_csv(rows))))
    assert read[0][0] == "room"
    assert [r[1] for r in read[1:5]] == ["floor", "walls", "ceilings", "work plane"]
    assert float(read[1][3]) == pytest.approx(rows[0].average, rel=1e-3)
    assert rows[0].average > rows[4].average > 0


def test_daylight_factor_under_a_roof_opening():
    # A black room with an opening in the roof: what comes in is the sky's component alone.
    faces = box(high=(4, 3, 3), leave_out="z+")
    hole = rectangle((1, 1, 3), (2, 0, 0), (0, 1, 0))
    roof = [rectangle((x, y, 3), (0, h, 0), (w, 0, 0)) for x, y, w, h in ((0, 0, 4, 1), (0, 2, 4, 1), (0, 1, 1, 1), (3, 1, 1, 1))]
    scene = scene_of([*faces, *roof], reflectance=0.0, emission=1.0, portals=portals_of([hole], [[0, -1]]))
    under_sky = solve(under_overcast_sky(scene), DRAFT)
    rows = {row.part: row for row in in_per_cent(report_of_light(under_sky, 0.8, 0.0))}
    places = (np.arange(80) + 0.5) / 80
    x, y = (g.ravel() for g in np.meshgrid(1 + 2 * places, 1 + places, indexing="ij"))
    # Under the middle of the opening, by its parts: L = (1 + 2 sin h) / 3 over 7 pi / 9.
    d = np.stack([x - 2, y - 1.5, np.full(6400, 2.2)], 1)
    r = np.linalg.norm(d, axis=1)
    sine = d[:, 2] / r
    expected = 100 * ((1 + 2 * sine) / 3 * sine**2 / r**2).sum() * 2 / 6400 / (7 * np.pi / 9)
    assert rows["work plane"].maximum == pytest.approx(expected, rel=0.02)
    assert rows["ceilings"].average == 0
