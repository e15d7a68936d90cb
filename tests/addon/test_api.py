"""The functions for scripts do what the buttons do."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def api(shop):
    from enfilade.addon import api

    return api


def test_a_bake_is_that_of_the_button(shop, api):
    made = shop.two_rooms()
    seen = []
    done = api.bake(quality="draft", domain="point", progress=seen.append)
    assert set(done.objects) == {o.name for k, o in made.items() if k != "Door"}
    assert done.images == ()
    assert done.report["rooms"] == 2
    assert done.summary == shop.bpy.context.scene.enfilade.summary
    assert seen[-1].fraction == pytest.approx(1.0)
    mine = {name: shop.colors(shop.bpy.data.objects[name]) for name in done.objects}
    shop.bpy.ops.enfilade.bake()  # with the options that the file remembers
    for name, color in mine.items():
        assert np.array_equal(color, shop.colors(shop.bpy.data.objects[name]))
    assert api.clear() == []
    assert len(made["West"].data.color_attributes) == 0


def test_rooms_one_by_one_and_what_is_out_of_date(shop, api, tmp_path):
    made = shop.two_rooms()
    assert api.rooms() == ("West", "East")
    assert not api.out_of_date()
    assert set(api.bake(["East"], quality="draft").objects) == {"East walls", "East door wall"}
    assert len(made["West"].data.color_attributes) == 0
    assert not api.out_of_date()
    made["Lamp"].location.z -= 0.2
    shop.bpy.context.view_layer.update()
    assert api.out_of_date()
    done = api.export_gltf(tmp_path / "east.glb")
    assert set(done.objects) == {"East walls", "East door wall"}


def test_refusals_change_nothing(shop, api, tmp_path):
    with pytest.raises(api.REFUSALS, match="nothing to bake"):
        api.bake()
    with pytest.raises(api.REFUSALS, match="bake first"):
        api.export_gltf(tmp_path / "a.glb")
    shop.two_rooms()
    before = shop.state()
    with pytest.raises(TypeError, match="no option 'qualty'"):
        api.bake(qualty="draft")
    with pytest.raises(api.REFUSALS, match="option margin"):
        api.bake(margin=0)
    with pytest.raises(api.REFUSALS, match="no room 'Attic'"):
        api.bake(["Attic"])

    def stop(step):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        api.bake(quality="draft", progress=stop)
    assert shop.state() == before
    assert shop.bpy.context.scene.enfilade.solve.quality == "good"


def test_scripts_need_not_register_and_may_be_in_edit_mode(tmp_path):
    program = f"""
import importlib.util, sys
spec = importlib.util.spec_from_file_location("enfilade", {str(ROOT / "__init__.py")!r}, submodule_search_locations=[{str(ROOT)!r}])
sys.modules["enfilade"] = module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
import bpy
from enfilade.addon import api
bpy.ops.object.mode_set(mode="EDIT")
print(api.bake(quality="draft", quantity="lux").objects)
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines()[-1] == "('Cube',)"
