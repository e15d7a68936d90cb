"""Light groups in Blender: which lamp is in which, and sliders that dim a bake without a new solve."""

import time

import numpy as np
import pytest
from enfilade.addon import bake_vertex
from enfilade.core.options import Options
from enfilade.core.scene import SceneError

DRAFT = Options(quality="draft", threads=1)


def solver(scene, options):
    from enfilade.core.pipeline import run

    return run(scene, options)


@pytest.fixture
def lit_rooms(shop):
    """Two rooms with a panel in the first, and in each a bulb: those of the collection Bulbs."""
    made = shop.two_rooms()
    bulbs = shop.collection("Bulbs")
    for name, x, energy in (("Bulb West", 3.0, 30.0), ("Bulb East", 5.5, 20.0)):
        light = shop.bpy.data.lights.new(name, "POINT")
        light.energy, light.color, light.shadow_soft_size = energy, (1.0, 0.5, 0.25), 0.05
        made[name] = shop.bpy.data.objects.new(name, light)
        made[name].location = (x, 1.5, 1.8)
        bulbs.objects.link(made[name])
    return made


def bake(shop, groups="collections", **more):
    return shop.bake(solver=solver, options=DRAFT, groups=groups, **more)


def groups_of(shop):
    return shop.bpy.context.scene.enfilade.groups


def lit(shop):
    """{object: (C, 3)} the bake on all that carries one."""
    return {o.name: shop.colors(o)[:, :3] for o in shop.bpy.data.objects if o.type == "MESH" and o.data.enfilade.attribute}


def pixels(shop, name):
    """(H, W, 4) values of an image; asked for anew, since opening a file and undo replace what Blender's data points at."""
    return shop.pixels(shop.bpy.data.images[name])


def difference(found, expected):
    """Root mean square difference over the mean."""
    return float(np.sqrt(((found - expected) ** 2).mean()) / expected.mean())


def read_groups(shop, groups):
    from enfilade.addon.extract import extract

    shop.bpy.context.view_layer.update()
    return extract(shop.bpy.context, groups=groups).scene


# ------------------------------------------------------------------------------------------------------ membership


def test_groups_are_the_collections_of_lamps(shop, lit_rooms):
    scene = read_groups(shop, "collections")
    assert scene.groups.names == ("Bulbs", "West")
    assert scene.groups.points.tolist() == [0, 0]
    assert [scene.object_names[k] for k in np.flatnonzero(scene.groups.object >= 0)] == ["Lamp"]
    assert scene.groups.object.max() == 1
    assert read_groups(shop, "none").groups is None


def test_a_collection_that_is_no_room_is_meant(shop, lit_rooms):
    shop.collection("Panels").objects.link(lit_rooms["Lamp"])
    assert read_groups(shop, "collections").groups.names == ("Bulbs", "Panels")


def test_groups_are_lamps_and_the_world(shop, lit_rooms):
    world = shop.bpy.data.worlds.new("Lamp")
    if world.node_tree is None:
        world.use_nodes = True
    node = next(n for n in world.node_tree.nodes if n.type == "BACKGROUND")
    node.inputs["Color"].default_value = (1, 1, 1, 1)
    shop.bpy.context.scene.world = world
    groups = read_groups(shop, "lamps").groups
    assert groups.names == ("Bulb East", "Bulb West", "Lamp", "Lamp (world)")
    assert groups.sky == 3
    assert groups.points.tolist() == [1, 0]


def test_what_an_instance_shows_is_in_the_group_of_what_makes_it(shop, lit_rooms):
    fitting = shop.bpy.data.collections.new("Fitting")
    fitting.objects.link(lit_rooms["Bulb West"])
    shop.bpy.data.collections["Bulbs"].objects.unlink(lit_rooms["Bulb West"])
    for k in range(2):
        empty = shop.bpy.data.objects.new(f"Here {k}", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", fitting
        shop.bpy.data.collections["West"].objects.link(empty)
    assert read_groups(shop, "lamps").groups.names == ("Bulb East", "Here 0", "Here 1", "Lamp")
    assert read_groups(shop, "collections").groups.names == ("Bulbs", "West")


def test_a_dark_scene_has_no_groups(shop):
    shop.box((0, 0, 0), (1, 1, 1))
    assert read_groups(shop, "collections").groups is None


def test_too_many_groups_are_refused(shop, lit_rooms):
    for k in range(31):
        light = shop.bpy.data.lights.new(f"More {k}", "POINT")
        shop.bpy.data.collections["Bulbs"].objects.link(shop.bpy.data.objects.new(f"More {k}", light))
    before = shop.state()
    with pytest.raises(SceneError, match=r"34 light groups where 1 to 32.*fewer collections"):
        bake(shop, "lamps")
    assert shop.state() == before


# ------------------------------------------------------------------------------------------------------- vertices


@pytest.mark.parametrize(("quantity", "domain"), [("radiosity", "corner"), ("lighting", "point"), ("lux", "corner")])
def test_a_dimmed_bake_is_that_of_dimmed_lamps(shop, lit_rooms, quantity, domain):
    bake(shop, quantity=quantity, domain=domain)
    full = lit(shop)
    group = groups_of(shop)["Bulbs"]
    group.strength, group.color = 0.5, (0.2, 0.6, 1.0)
    dimmed = lit(shop)
    for name in ("Bulb West", "Bulb East"):
        light = lit_rooms[name].data
        light.energy *= 0.5
        light.color = np.array(light.color) * (0.2, 0.6, 1.0)
    group.strength, group.color = 1.0, (1, 1, 1)
    bake(shop, "none", quantity=quantity, domain=domain)
    anew = lit(shop)
    for name in ("West walls", "East walls", "Lamp"):
        assert difference(dimmed[name], anew[name]) < 0.10  # the error that the quality allows either of them
    assert difference(full["East walls"], anew["East walls"]) > 0.5


def test_each_group_is_kept_and_adds_up(shop, lit_rooms):
    bake(shop)
    mesh = lit_rooms["West"]
    names = ["Enfilade", "Enfilade.Bulbs", "Enfilade.West"]
    assert mesh.data.color_attributes.keys() == names
    assert mesh.data.attributes.active_color_name == "Enfilade"
    whole, *parts = (shop.colors(mesh, name) for name in names)
    assert (parts[0] + parts[1])[:, :3] == pytest.approx(whole[:, :3], rel=1e-5)
    for group in groups_of(shop):
        group.strength = 0.0
    dark = shop.colors(mesh)
    assert (dark[:, :3] == 0).all()
    assert (dark[:, 3] == 1).all()
    groups_of(shop)["West"].strength = 2.0
    assert shop.colors(mesh)[:, :3] == pytest.approx(2 * parts[1][:, :3], rel=1e-6)


def test_sliders_stay_where_they_are_at_the_next_bake(shop, lit_rooms):
    bake(shop)
    groups_of(shop)["Bulbs"].strength = 0.25
    dimmed = lit(shop)
    bake(shop)
    assert [(g.name, g.strength) for g in groups_of(shop)] == [("Bulbs", 0.25), ("West", 1.0)]
    for name, color in lit(shop).items():
        assert color == pytest.approx(dimmed[name], rel=1e-5)


def test_a_slider_does_not_put_a_bake_out_of_date(shop, lit_rooms):
    from enfilade.addon import api

    api.bake(quality="draft", groups="lamps", threads=1)
    groups_of(shop)["Bulb East"].strength = 0.5
    assert not api.out_of_date()
    lit_rooms["Bulb East"].data.energy *= 0.5
    assert api.out_of_date()


def test_a_bake_of_one_room_keeps_the_groups_of_the_others(shop, lit_rooms):
    from enfilade.addon import job
    from enfilade.core.options import BakeOptions

    bake(shop)
    shop.bpy.data.collections["Bulbs"].name = "Points"
    reading = job.read(shop.bpy.context, DRAFT, BakeOptions(groups="collections"), ["East"])
    job.write(shop.bpy.context, reading, job.solve_all(reading))
    assert [g.name for g in groups_of(shop)] == ["Points", "West", "Bulbs"]
    before = lit(shop)
    groups_of(shop)["Bulbs"].strength = 0.5
    after = lit(shop)
    assert (after["West walls"] < before["West walls"]).all()
    assert np.array_equal(after["East walls"], before["East walls"])


def test_what_was_edited_meanwhile_does_no_harm(shop, lit_rooms):
    bake(shop)
    west, east = lit_rooms["West"].data, lit_rooms["East"].data
    before = shop.colors(lit_rooms["West"])
    west.color_attributes.remove(west.color_attributes["Enfilade.West"])
    groups_of(shop)["West"].strength = 0.5
    assert np.array_equal(shop.colors(lit_rooms["West"]), before)
    whole = shop.colors(lit_rooms["East"])
    shop.bpy.context.view_layer.objects.active = lit_rooms["East"]
    shop.bpy.ops.object.mode_set(mode="EDIT")
    groups_of(shop)["West"].strength = 0.0
    shop.bpy.ops.object.mode_set(mode="OBJECT")
    assert np.array_equal(shop.colors(lit_rooms["East"]), whole)
    east.attributes.active_color_name = "Enfilade.Bulbs"
    groups_of(shop)["West"].strength = 0.25
    assert (shop.colors(lit_rooms["East"])[:, :3] < whole[:, :3]).all()


@pytest.mark.parametrize("target", ["vertex", "texture"])
def test_clear_leaves_nothing(shop, lit_rooms, target):
    before = shop.state()
    bake(shop, target=target, texel_density=4.0)
    groups_of(shop)["Bulbs"].strength = 0.5
    shop.bpy.ops.enfilade.clear()
    assert shop.state() == before
    assert len(groups_of(shop)) == 0
    assert not any(len(mesh.enfilade.parts) for mesh in shop.bpy.data.meshes)


def test_undo_takes_the_groups_back(shop, lit_rooms):
    bpy = shop.bpy
    bpy.context.preferences.edit.use_global_undo = True
    settings = bpy.context.scene.enfilade
    settings.solve.quality, settings.bake.groups = "draft", "collections"
    bpy.ops.ed.undo_push(message="before")
    before = shop.state()
    bpy.ops.enfilade.bake("EXEC_DEFAULT", True)
    full = lit(shop)
    groups_of(shop)["Bulbs"].strength = 0.5
    bpy.ops.ed.undo_push(message="dimmed")
    dimmed = lit(shop)
    bpy.ops.ed.undo()
    assert groups_of(shop)["Bulbs"].strength == 1.0
    for name, color in lit(shop).items():
        assert np.array_equal(color, full[name])
    bpy.ops.ed.redo()
    for name, color in lit(shop).items():
        assert np.array_equal(color, dimmed[name])
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    assert shop.state() == before
    assert len(groups_of(shop)) == 0


# ------------------------------------------------------------------------------------------------------- textures


@pytest.mark.parametrize(("image_format", "quantity"), [("exr", "radiosity"), ("exr", "lux"), ("png", "radiosity")])
def test_textures_follow_the_sliders_into_the_file(shop, lit_rooms, tmp_path, image_format, quantity):
    bake(shop, target="texture", atlas="room", texel_density=4.0, image_format=image_format, quantity=quantity)
    images = shop.bpy.data.images
    assert {i.name for i in images if i.enfilade.made} == {
        f"Enfilade {room}{part}" for room in ("West", "East") for part in ("", ".Bulbs", ".West")
    }
    parts = [shop.pixels(images[f"Enfilade East.{name}"])[..., :3] for name in ("Bulbs", "West")]
    whole = pixels(shop, "Enfilade East")[..., :3]
    groups_of(shop)["Bulbs"].strength = 0.25
    expected = 0.25 * parts[0] + parts[1]
    if quantity == "lux":
        expected = np.repeat((expected @ (0.2126, 0.7152, 0.0722))[..., None], 3, axis=-1)
    if image_format == "png":
        expected = np.clip(expected, 0, 1)
    found = pixels(shop, "Enfilade East")
    assert found[..., :3] == pytest.approx(expected, rel=1e-5, abs=1e-6)
    assert (found[..., 3] == 1).all()
    assert np.abs(whole - expected).max() > 0.1 * whole.mean()
    shop.bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "t.blend"))
    shop.bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "t.blend"))
    assert pixels(shop, "Enfilade East")[..., :3] == pytest.approx(expected, rel=1e-3, abs=1e-4)
    assert shop.bpy.data.images["Enfilade East"].packed_file is not None
    groups_of(shop)["Bulbs"].strength = 1.0
    assert pixels(shop, "Enfilade East")[..., :3] == pytest.approx(whole, rel=1e-3, abs=1e-4)


def test_textures_in_a_folder_are_saved_there(shop, lit_rooms, tmp_path):
    bake(shop, target="texture", atlas="room", texel_density=2.0, image_folder=str(tmp_path))
    assert len(list(tmp_path.glob("*.exr"))) == 6
    groups_of(shop)["Bulbs"].strength = groups_of(shop)["West"].strength = 0.0
    shop.bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "t.blend"))
    loaded = shop.bpy.data.images.load(str(tmp_path / "Enfilade East.exr"))
    assert (shop.pixels(loaded)[..., :3] == 0).all()


def test_undo_takes_the_pixels_back(shop, lit_rooms):
    bpy = shop.bpy
    bpy.context.preferences.edit.use_global_undo = True
    bake(shop, target="texture", atlas="room", texel_density=2.0)
    bpy.ops.ed.undo_push(message="baked")
    full = pixels(shop, "Enfilade East")
    groups_of(shop)["Bulbs"].strength = 0.5
    bpy.ops.ed.undo_push(message="dimmed")
    dimmed = pixels(shop, "Enfilade East")
    bpy.ops.ed.undo()
    assert pixels(shop, "Enfilade East") == pytest.approx(full, rel=1e-6)
    bpy.ops.ed.redo()
    assert pixels(shop, "Enfilade East") == pytest.approx(dimmed, rel=1e-6)


# ---------------------------------------------------------------------------------------------------------- speed


@pytest.mark.parametrize("objects", [1, 500])
def test_a_hundred_thousand_corners_recombine_in_a_fifth_of_a_second(shop, objects):
    scene, rng = shop.bpy.context.scene, np.random.default_rng(0)
    side = {1: 158, 500: 7}[objects]
    grid = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], -1).reshape(-1, 4)
    for k in range(objects):
        mesh = shop.mesh(np.zeros((grid.size, 3)), quads, f"Thing {k}").data
        bake_vertex.write_colors(mesh, "Light", "corner", np.zeros((quads.size, 4), np.float32))
        for name in ("one", "two", "three"):
            bake_vertex.write_part(mesh, name, "corner", rng.random((quads.size, 4), np.float32))
        mesh.enfilade.quantity = "radiosity"
    for name in ("one", "two", "three"):
        scene.enfilade.groups.add().name = name
    started = time.process_time()
    scene.enfilade.groups["two"].strength = 0.5
    took = time.process_time() - started
    assert quads.size * objects >= 98_000
    parts = [shop.colors(shop.bpy.data.objects["Thing 0"], f"Light.{name}")[:, :3] for name in ("one", "two", "three")]
    assert shop.colors(shop.bpy.data.objects["Thing 0"], "Light")[:, :3] == pytest.approx(parts[0] + 0.5 * parts[1] + parts[2], rel=1e-6)
    assert took < 0.2
