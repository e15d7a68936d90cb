"""Black surfaces send nothing, but the links between them count where a room is closed."""

from dataclasses import replace

import numpy as np
import pytest
from enfilade.core.lamps import Lamps
from enfilade.core.options import Options
from enfilade.core.pipeline import solve
from lamp_samples import area_lamp
from scenery import box, rectangle, scene_of


@pytest.mark.parametrize("quality", ["draft", "good"])
def test_black_walls_take_no_more_than_there_is(quality):
    """A white floor and ceiling between four black walls: 300 W come in, and all of it is absorbed."""
    lamps = Lamps(area_lamp(rectangle((1, 1, 2.9), (0, 1, 0), (1, 0, 0)), 100.0))
    at = np.column_stack([np.random.default_rng(0).uniform((0.5, 0.8), (2.5, 2.2), (200, 2)), np.zeros(200)])
    light, absorbed = [], []
    for walls in (0.0, 1e-3):
        scene = scene_of(box(high=(4, 3, 3)), reflectance=np.array([*[walls] * 4, 0.7, 0.7]))
        solution = solve(replace(scene, lamps=lamps), Options(quality=quality, threads=1))
        light.append(solution.irradiance(at, np.full(200, 4)).mean())
        absorbed.append(solution.report["energy"]["absorbed"])
    assert absorbed == pytest.approx([300.0, 300.0], rel=5e-3)
    assert light[0] == pytest.approx(light[1], rel=5e-3)
