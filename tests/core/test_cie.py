"""The analytical rooms of CIE 171:2006, 5.3, 5.6 and 5.7: area sources, one behind an obstruction, in rooms that reflect nothing."""

import json
from pathlib import Path

import numpy as np
import pytest
from enfilade.core.options import Options
from enfilade.core.pipeline import solve
from enfilade.core.scene_files import load_scene

SCENES = Path(__file__).resolve().parents[1] / "data" / "scenes"


@pytest.mark.parametrize("case", ["5.3", "5.6", "5.7"])
def test_room(case):
    path = SCENES / f"cie171-{case}.json"
    scene = load_scene(path)
    solution = solve(scene, Options())
    light = solution.irradiance(scene.points.position, scene.points.polygon)
    exact = np.array([probe["irradiance"] for probe in json.loads(path.read_text())["probes"]])
    assert light == pytest.approx(np.broadcast_to(exact.reshape(len(exact), -1), light.shape), rel=5e-5)
    energy = solution.report["energy"]
    # The room is black: what its mesh holds of the lamp's light is the quadrature of the mesh alone.
    assert energy["absorbed"] + energy["escaped"] == pytest.approx(energy["emitted"], rel=1e-3)
