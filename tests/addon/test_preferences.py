"""Preferences of the machine, and presets."""

import dataclasses
from pathlib import Path

import pytest
from enfilade.core.options import BakeOptions, Options


def test_preferences_fill_in_what_a_file_leaves_open(shop):
    from enfilade.addon.preferences import on_this_machine, with_preferences

    assert on_this_machine(Options()) == Options()  # nothing is installed here
    filled = with_preferences(Options(), 3, "/cache", "/files/house.blend")
    assert filled.threads == 3
    assert filled.store.replace("\\", "/") == "/cache/house"
    assert with_preferences(Options(), 0, "/cache", "").store.replace("\\", "/") == "/cache/untitled"
    own = Options(threads=2, store="/mine")
    assert with_preferences(own, 3, "/cache", "/files/house.blend") == own
    assert with_preferences(Options(), 0, "", "/files/house.blend") == Options()


def test_the_bake_asks_the_preferences(shop, monkeypatch):
    from enfilade.addon import job

    shop.two_rooms()
    monkeypatch.setattr(job, "on_this_machine", lambda options: dataclasses.replace(options, threads=1))
    reading = job.read(shop.bpy.context, Options(), BakeOptions(target="texture", texel_density=2.0))
    assert reading.options == Options()
    assert reading.solving == Options(threads=1, reflected="elements")


@pytest.mark.parametrize("key", ["PREVIEW", "VERTEX", "FINE_VERTEX", "LIGHTMAP", "ENGINE", "LUX"])
def test_presets_set_all_options(shop, key):
    from enfilade.addon.job import settings
    from enfilade.addon.presets import BUILT_IN

    scene = shop.bpy.context.scene
    scene.unit_settings.scale_length = 0.01
    scene.enfilade.bake.bake_name, scene.enfilade.bake.margin, scene.enfilade.solve.order = "Mine", 9, 1
    assert shop.bpy.ops.enfilade.use_preset(preset=key) == {"FINISHED"}
    _, _, solve, bake = BUILT_IN[key]
    assert settings(scene) == (Options(**solve), BakeOptions(**{**bake, "name": "Mine"}))


def test_own_presets_are_kept(shop, monkeypatch):
    bpy = shop.bpy
    # Blender gives the panel the name of the preset that was chosen or added last.
    monkeypatch.setattr(bpy.types.ENFILADE_PT_presets, "bl_label", bpy.types.ENFILADE_PT_presets.bl_label)
    bake = bpy.context.scene.enfilade.bake
    bake.texel_density, bake.target = 17.0, "texture"
    assert bpy.ops.enfilade.add_preset(name="Seventeen") == {"FINISHED"}
    bpy.ops.enfilade.use_preset(preset="VERTEX")
    assert (bake.texel_density, bake.target) == (32.0, "vertex")
    (path,) = [p for folder in bpy.utils.preset_paths("enfilade") for p in Path(folder).glob("*.py")]
    bpy.ops.script.execute_preset(filepath=str(path), menu_idname="ENFILADE_PT_presets")
    assert (bake.texel_density, bake.target) == (17.0, "texture")
    path.unlink()
