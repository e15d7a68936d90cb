"""``python -m enfilade bake`` on a sample file, in a process of its own."""

import json
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
SAMPLES = Path(__file__).resolve().parents[2] / "sample_scenes"


def radiance(name):
    """Positions (C, 3) and baked colours (C, 3) of the corners of an object."""
    thing = bpy.data.objects[name]
    corners = np.array([thing.matrix_world @ thing.data.vertices[loop.vertex_index].co for loop in thing.data.loops])
    attribute = thing.data.color_attributes["Enfilade"]
    colors = np.zeros(len(attribute.data) * 4, np.float32)
    attribute.data.foreach_get("color", colors)
    return corners, colors.reshape(-1, 4)[:, :3]


def test_cornell_box_bleeds_its_colours(enfilade, tmp_path):
    """The floor reddens towards the red wall and turns green towards the green one; what comes out is in the report."""
    done = enfilade("bake", SAMPLES / "cornell.blend", "--quality", "draft", "--out", "baked.blend", "--report", "report.json")
    assert done.returncode == 0, done.stderr
    assert "written: baked.blend" in done.stdout
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "baked.blend"), load_ui=False)
    corners, colors = radiance("Box floor")
    assert np.isfinite(colors).all()
    west, east = (colors[side].sum(axis=0) for side in (corners[:, 0] < 0.3, corners[:, 0] > 1.7))
    assert west[0] / west[1] > 1.2 * east[0] / east[1]
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["rooms"] == 1
    assert report["energy"]["absorbed"] == pytest.approx(report["energy"]["emitted"], rel=0.1)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["nothere.blend", "--out", "b.blend"], "nothere.blend"),
        (["broken.blend", "--out", "b.blend"], "broken.blend"),
        ([SAMPLES / "cornell.blend", "--out", "no/folder/b.blend"], "--out"),
        ([SAMPLES / "cornell.blend", "--out", "b.blend", "--rooms", "Attic"], "Attic"),
        ([SAMPLES / "cornell.blend", "--out", "b.blend", "--texel-density", "0"], "texel_density"),
    ],
)
def test_bad_input_is_one_sentence_and_nothing_written(enfilade, tmp_path, arguments, part):
    (tmp_path / "broken.blend").write_text("no scene")
    before = sorted(tmp_path.iterdir())
    done = enfilade("bake", *arguments)
    sentences = [line for line in done.stderr.splitlines() if line.startswith("enfilade: ")]
    assert done.returncode == 2, done.stderr
    assert len(sentences) == 1
    assert part in sentences[0]
    assert sorted(tmp_path.iterdir()) == before
