"""``python -m enfilade bake``: what it writes, and what it refuses."""

import csv
import io
import json
import os

import numpy as np
import pytest


@pytest.fixture
def run(shop):
    from enfilade.addon.command_line import bake_main

    def bake(*words):
        out, err = io.StringIO(), io.StringIO()
        code = bake_main([str(word) for word in words], out, err)
        return code, out.getvalue(), err.getvalue()

    return bake


@pytest.fixture
def flat(shop, tmp_path):
    """A file with two rooms."""
    shop.two_rooms()
    path = tmp_path / "flat.blend"
    shop.bpy.ops.wm.save_as_mainfile(filepath=str(path))
    shop.bpy.ops.wm.read_factory_settings(use_empty=True)
    return path


def opened(shop, path):
    shop.bpy.ops.wm.open_mainfile(filepath=str(path))
    return shop.bpy.data


def read_picture(shop, path):
    image = shop.bpy.data.images.load(str(path))
    out = np.zeros(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(out)
    return out.reshape(image.size[1], image.size[0], 4)


def test_bake_picture_and_report(shop, run, flat, tmp_path):
    before = flat.read_bytes()
    out, picture, report = tmp_path / "baked.blend", tmp_path / "picture.png", tmp_path / "report.json"
    code, said, progress = run(flat, "--out", out, "--picture", picture, "--report", report, "--quality", "draft", "--name", "Light")
    assert code == 0, progress
    assert flat.read_bytes() == before
    assert said.splitlines()[-3:] == [f"written: {out}", f"written: {picture}", f"written: {report}"]
    assert "2 rooms, 21 polygons" in said
    assert "100 %" in progress
    assert sorted(p.name for p in tmp_path.iterdir()) == ["baked.blend", "flat.blend", "picture.png", "report.json"]
    figures = json.loads(report.read_text())
    assert (figures["rooms"], figures["portals"]) == (2, 1)
    assert figures["seconds"]["total"] >= figures["seconds"]["solve"]

    data = opened(shop, out)
    lit, dark = (shop.colors(data.objects[f"{side} walls"], "Light")[:, :3].mean() for side in ("West", "East"))
    assert lit > 5 * dark > 0
    # The camera of the overview and the materials of the picture are gone.
    assert len(data.cameras) == 0
    assert not [m.name for m in data.materials if "(bake)" in m.name]
    scene = shop.bpy.context.scene
    assert (scene.enfilade.bake.bake_name, scene.enfilade.solve.quality) == ("Light", "draft")
    assert scene.render.engine != "CYCLES"
    shown = read_picture(shop, picture)
    assert shown.shape == (960, 1280, 4)
    assert np.ptp(shown[:, :, :3]) > 0.5
    west, east = shown[300:660, 300:600, 0], shown[300:660, 700:1000, 0]
    assert west.mean() > 2 * east.mean()


def test_the_scene_is_as_before_after_a_picture(shop, run, flat, tmp_path):
    code, _, _ = run(flat, "--picture", tmp_path / "picture.png", "--quality", "draft")
    assert code == 0
    bpy = shop.bpy
    assert bpy.context.scene.camera is None
    assert len(bpy.data.cameras) == 0
    assert (bpy.context.scene.world, len(bpy.data.worlds)) == (None, 0)
    assert all(o.visible_camera for o in bpy.data.objects)
    assert not [m for m in bpy.data.materials if m.enfilade.made]


def test_textures_with_a_camera_of_ones_own(shop, run, tmp_path):
    bpy = shop.bpy
    shop.two_rooms()
    camera = bpy.data.objects.new("Mine", bpy.data.cameras.new("Mine"))
    bpy.context.scene.collection.objects.link(camera)
    camera.location, camera.rotation_euler = (0.3, 0.3, 1.5), (1.4, 0, -0.9)
    bpy.context.scene.camera = camera
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 160, 120
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "flat.blend"))
    out, picture = tmp_path / "baked.blend", tmp_path / "picture.png"
    words = ("--target", "texture", "--atlas", "room", "--texel-density", "8", "--quality", "draft", "--material")
    code, said, err = run(tmp_path / "flat.blend", "--out", out, "--picture", picture, *words)
    assert code == 0, err
    assert "2 lightmaps" in said
    shown = read_picture(shop, picture)
    assert shown.shape == (120, 160, 4)
    assert shown[:, :, :3].mean() > 0.1
    data = opened(shop, out)
    assert {i.name for i in data.images if i.packed_file} == {"Enfilade West", "Enfilade East"}
    assert data.objects["West walls"].material_slots[0].material.name == "West paint (bake)"


def test_collections_by_name(shop, run, tmp_path):
    shop.two_rooms()
    shop.bpy.data.collections["Rooms"].name, shop.bpy.data.collections["Portals"].name = "Flat", "Doors"
    shop.bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "flat.blend"))
    report = tmp_path / "report.json"
    words = ("--out", tmp_path / "out.blend", "--report", report, "--quality", "draft")
    assert run(tmp_path / "flat.blend", *words)[0] == 0
    assert json.loads(report.read_text())["rooms"] == 1
    assert run(tmp_path / "flat.blend", *words, "--rooms", "Flat", "--portals", "Doors")[0] == 0
    assert json.loads(report.read_text())["rooms"] == 2
    code, _, err = run(tmp_path / "flat.blend", *words, "--rooms", "Attic")
    assert code == 2
    assert "no collection 'Attic' to take as rooms" in err


def test_options_that_are_not_given_are_those_of_the_file(shop, run, tmp_path):
    shop.two_rooms()
    settings = shop.bpy.context.scene.enfilade
    settings.solve.quality, settings.bake.domain, settings.bake.bake_name = "draft", "point", "Saved"
    shop.bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "flat.blend"))
    assert run(tmp_path / "flat.blend", "--out", tmp_path / "out.blend", "--name", "Given")[0] == 0
    data = opened(shop, tmp_path / "out.blend")
    assert data.objects["West walls"].data.color_attributes["Given"].domain == "POINT"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["none.blend", "--out", "out.blend"], "none.blend: there is no such file"),
        (["notes.txt", "--out", "out.blend"], "notes.txt: this is not a .blend file"),
        (["broken.blend", "--out", "out.blend"], "broken.blend: Blender .* cannot open this file"),
        (["flat.blend"], "nothing would be written"),
        ([], "the following arguments are required"),
        (["flat.blend", "--out", "no/such/out.blend"], "the folder of --out does not exist"),
        (["flat.blend", "--out", "out.txt"], "--out must name a .blend file"),
        (["flat.blend", "--picture", "out.jpg"], "--picture must name a .png file"),
        (["flat.blend", "--out", "folder.blend"], "folder.blend: --out names a folder"),
        (["flat.blend", "--out", "out.blend", "--report", "out.blend"], "names the same file as --out"),
        (["flat.blend", "--out", "out.blend", "--order", "7"], "order: 7 must be between 1 and 3"),
        (["flat.blend", "--out", "out.blend", "--quality", "best"], "best"),
        (["flat.blend", "--out", "out.blend", "--target", "texture", "--image-folder", "none"], "'none' does not exist"),
        (["empty.blend", "--out", "out.blend"], "no mesh that is visible in renders"),
    ],
)
def test_bad_input_is_one_sentence_and_writes_nothing(shop, run, flat, tmp_path, monkeypatch, words, sentence):
    import re

    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("hello")
    (tmp_path / "broken.blend").write_bytes(b"BLENDER-nothing")
    (tmp_path / "folder.blend").mkdir()
    shop.bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "empty.blend"))
    before = sorted(os.listdir(tmp_path))
    code, out, err = run(*words)
    assert code == 2
    assert out == ""
    last = [line for line in err.splitlines() if line.startswith("enfilade: ")]
    assert len(last) == 1
    assert re.search(sentence, last[0])
    assert "Traceback" not in err
    assert sorted(os.listdir(tmp_path)) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written(run, flat, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir()
    locked.chmod(0o500)
    code, _, err = run(flat, "--out", locked / "out.blend")
    assert code == 2
    assert "cannot be written" in err


def test_interrupted(run, flat, tmp_path, monkeypatch):
    from enfilade.addon import job

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(job, "solve_all", interrupted)
    code, _, err = run(flat, "--out", tmp_path / "out.blend")
    assert code == 130
    assert "nothing was written" in err
    assert not (tmp_path / "out.blend").exists()


def test_help_lists_all_options(run, capsys):
    code, _, _ = run("--help")
    assert code == 0
    text = capsys.readouterr().out
    for flag in ("--out", "--picture", "--report", "--rooms", "--portals", "--quality", "--texel-density", "--image-folder"):
        assert flag in text


def test_one_room_and_a_web_page(run, flat, tmp_path):
    out, web = tmp_path / "baked.blend", tmp_path / "east.glb"
    code, said, progress = run(flat, "--out", out, "--gltf", web, "--only", "East", "--quality", "draft", "--exposure", "2")
    assert code == 0, progress
    assert said.splitlines()[-3:] == ["2 objects carry the light", f"written: {out}", f"written: {web}"]
    data = web.read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert sorted(node["name"] for node in document["nodes"]) == ["East door wall", "East walls"]
    assert document["scenes"][0]["extras"]["enfilade"]["exposure"] == 2.0
    code, _, progress = run(flat, "--gltf", tmp_path / "none.glb", "--only", "Attic")
    assert (code, progress.splitlines()[-1]) == (2, "enfilade: there is no room 'Attic' to bake: the rooms are West, East")
    assert not (tmp_path / "none.glb").exists()


def test_the_light_of_every_room_as_a_table(shop, flat, tmp_path, capsys):
    """In Blender's own command line, with the options of the file and the lamp in one of the two rooms."""
    from enfilade.addon.command_line import blender_main

    assert blender_main(["light", str(flat), "--out", str(tmp_path / "light.csv"), "--quality", "draft"]) == 0
    assert "2 rooms" in capsys.readouterr().out
    rows = {(row["room"], row["part"]): float(row["average (lx)"]) for row in csv.DictReader((tmp_path / "light.csv").open())}
    assert rows["West", "floor"] > 5 * rows["East", "floor"] > 0
    assert ("East", "work plane") in rows
    assert blender_main(["light", str(tmp_path / "none.blend"), "--out", str(tmp_path / "a.csv")]) == 2
    assert "none.blend" in capsys.readouterr().err
    assert blender_main([str(flat), "--out", str(tmp_path / "light.csv")]) == 2  # without the word it is a bake, of .blend files
    assert "--out must name a .blend file" in capsys.readouterr().err
