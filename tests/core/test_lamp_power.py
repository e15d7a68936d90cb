"""The power of lamps, the balance of a solve that has them, and lamps that shine on nothing."""

from dataclasses import replace

import numpy as np
import pytest
from enfilade.core.lamp_power import area_power, lamp_power, point_power
from enfilade.core.lamps import Lamps
from enfilade.core.options import Options
from enfilade.core.pipeline import solve
from enfilade.core.point_lights import spot_factor
from lamp_samples import DOWNLIGHT, area_lamp, even_sky, point_lamp, sun
from scenery import box, portals_of, rectangle, scene_of

PANEL = rectangle((1, 1, 2.4), (0, 0.5, 0), (0.8, 0, 0))


def test_power_by_closed_form():
    assert area_power(area_lamp(PANEL, (1, 2, 3))) == pytest.approx(0.4 * np.array([[1, 2, 3]]))
    assert point_power(point_lamp((0, 0, 0), 2.0)) == pytest.approx(np.full((1, 3), 8 * np.pi))
    assert point_power(point_lamp((0, 0, 0), 2.0, distribution=DOWNLIGHT)) == pytest.approx(np.full((1, 3), 2 * DOWNLIGHT.flux()))
    assert lamp_power(Lamps()) == 0


@pytest.mark.parametrize(("cone", "blend"), [(0.5, 0.0), (0.5, 1.0), (1.2, 0.3), (2.0, 0.5)])
def test_power_of_a_spot_by_very_many_directions(cone, blend):
    lamp = point_lamp((0, 0, 0), 1.0, cone=cone, blend=blend)
    z = (np.arange(200000) + 0.5) / 100000 - 1
    local = np.column_stack([np.sqrt(1 - z**2), 0 * z, z])
    expected = 4 * np.pi * spot_factor(lamp, np.zeros(len(z), int), local).mean()
    assert point_power(lamp)[0, 0] == pytest.approx(expected, rel=1e-4)


def balance(scene, lamps):
    report = solve(replace(scene, lamps=lamps), Options(quality="draft", threads=1)).report
    energy = report["energy"]
    assert energy["absorbed"] + energy["escaped"] == pytest.approx(energy["emitted"], rel=0.02)
    return energy["emitted"], report["warnings"]


def test_the_balance_of_a_closed_room_with_lamps():
    scene = scene_of(box(high=(4, 3, 2.5)), reflectance=0.5)
    lamps = Lamps(area_lamp(PANEL, 10.0), point_lamp((3, 2, 1), 1.5, 0.05))
    emitted, warnings = balance(scene, lamps)
    assert emitted == pytest.approx(3 * (4 + 6 * np.pi), rel=1e-6)
    assert warnings == []


def test_what_enters_through_a_window_is_in_the_balance():
    faces = box(high=(4, 3, 3), leave_out="z+")
    hole = rectangle((1, 1, 3), (2, 0, 0), (0, 1, 0))
    roof = [rectangle((x, y, 3), (0, h, 0), (w, 0, 0)) for x, y, w, h in ((0, 0, 4, 1), (0, 2, 4, 1), (0, 1, 1, 1), (3, 1, 1, 1))]
    scene = scene_of([*faces, *roof], reflectance=0.3, portals=portals_of([hole], [[0, -1]]))
    day = Lamps(suns=sun((0.1, 0.2, 1), 5.0), sky=even_sky(1.0))
    through = 3 * 2 * (5 / np.sqrt(1.05) + np.pi)
    assert balance(scene, day)[0] == pytest.approx(through, rel=0.02)
    # With a lamp beside the sun the shares are told apart.
    both = replace(day, points=point_lamp((2, 1.5, 0.5), 2.0))
    assert balance(scene, both)[0] == pytest.approx(through + 24 * np.pi, rel=0.02)


def test_sun_and_sky_without_windows_are_said():
    _, warnings = balance(scene_of(box(), emission=1.0), Lamps(suns=sun((0, 0, 1)), sky=even_sky()))
    assert len(warnings) == 1
    assert "'sun'" in warnings[0]
    assert "'sky'" in warnings[0]
    assert "no portal leads outside" in warnings[0]


def test_a_lamp_inside_a_wall_is_said():
    pillar = [f + [1, 1, 0] for f in box(high=(0.5, 0.5, 2.5), inward=False)]
    scene = scene_of([*box(high=(4, 3, 2.5)), *pillar], object=[0] * 6 + [1] * 6)
    # Its light never leaves the pillar, so there is no balance to strike.
    walled = replace(scene, lamps=Lamps(points=point_lamp((1.25, 1.25, 1), 1.0)))
    warnings = solve(walled, Options(quality="draft", threads=1)).report["warnings"]
    assert len(warnings) == 1
    assert "'bulb' stands inside a wall" in warnings[0]
    assert balance(scene, Lamps(points=point_lamp((2.25, 1.25, 1), 1.0)))[1] == []
