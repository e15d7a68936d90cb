"""Buttons, registration, properties and the worker thread."""

import threading
import time

import numpy as np
import pytest
from enfilade.core.options import BakeOptions, OptionError, Options, describe
from fake_window import Event, FakeWindow


@pytest.fixture
def lit_room(shop):
    return shop.two_rooms()


def test_the_button_bakes_for_scripts(shop, lit_room):
    shop.bpy.context.scene.enfilade.solve.quality = "draft"
    assert shop.bpy.ops.enfilade.bake() == {"FINISHED"}
    walls = shop.colors(lit_room["West"])[:, :3]
    dark = shop.colors(lit_room["East"])[:, :3]
    assert walls.min() > 0
    assert 0 < dark.mean() < 0.2 * walls.mean()
    lamp = shop.colors(shop.bpy.data.objects["Lamp"])[:, :3]
    assert lamp == pytest.approx(10.0, abs=1.0)
    assert shop.bpy.context.scene.enfilade.summary.startswith("2 rooms, 21 polygons, 5 objects")
    assert shop.bpy.ops.enfilade.clear() == {"FINISHED"}
    assert len(lit_room["West"].data.color_attributes) == 0
    assert shop.bpy.context.scene.enfilade.summary == ""


def test_the_button_bakes_textures_with_the_same_options(shop, lit_room):
    settings = shop.bpy.context.scene.enfilade
    settings.solve.quality, settings.bake.target, settings.bake.atlas, settings.bake.bake_name = "draft", "texture", "room", "Map"
    settings.bake.texel_density = 8.0
    shop.bpy.ops.enfilade.bake()
    assert {i.name for i in shop.bpy.data.images if i.enfilade.made} == {"Map West", "Map East"}


def test_errors_reach_scripts_as_one_sentence(shop):
    with pytest.raises(RuntimeError, match="no mesh that is visible in renders"):
        shop.bpy.ops.enfilade.bake()
    thing = shop.box((0, 0, 0), (1, 1, 1), "Broken")
    thing.data.vertices[0].co.x = float("nan")
    before = shop.state()
    with pytest.raises(RuntimeError, match="bject 'Broken' has vertices that are not numbers"):
        shop.bpy.ops.enfilade.bake()
    assert shop.state() == before


def test_polls_say_why_not(shop, lit_room):
    bpy = shop.bpy
    for operator in (bpy.ops.enfilade.clear, bpy.ops.enfilade.show_bake):
        with pytest.raises(RuntimeError, match="no bake in this scene"):
            operator()
    with pytest.raises(RuntimeError, match="No bake is running"):
        bpy.ops.enfilade.cancel()
    bpy.context.view_layer.objects.active = lit_room["West"]
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match="object mode"):
        bpy.ops.enfilade.bake()
    bpy.ops.object.mode_set(mode="OBJECT")


def test_all_options_go_through_the_properties(shop):
    from enfilade.addon.properties import read_options, write_options

    settings = shop.bpy.context.scene.enfilade
    for group, cls in ((settings.solve, Options), (settings.bake, BakeOptions)):
        assert read_options(group, cls) == cls()
        changed = {}
        for info in describe(cls):
            if info.kind == "choice":
                changed[info.name] = info.choices[-1]
            elif info.kind == "bool":
                changed[info.name] = not info.default
            elif info.kind == "size":
                changed[info.name] = 3 * 2**20
            elif info.kind == "name":
                changed[info.name] = "Other"
            elif info.kind == "path":
                changed[info.name] = "/some/where"
            elif info.kind == "int":
                changed[info.name] = max(int(info.minimum), min(int(info.maximum), info.default + 1))
            else:
                changed[info.name] = 0.7
        options = cls(**changed)
        assert options != cls()
        write_options(group, options, 0.01)
        assert read_options(group, cls, 0.01) == options


def test_ranges_of_the_properties_are_those_of_the_options(shop):
    settings = shop.bpy.context.scene.enfilade
    settings.solve.order = 99
    settings.bake.margin = -5
    assert (settings.solve.order, settings.bake.margin) == (3, 1)
    settings.bake.bake_name = ""
    from enfilade.addon import job

    with pytest.raises(OptionError, match="name"):
        job.settings(shop.bpy.context.scene)


def test_settings_are_saved_in_the_file(shop, tmp_path):
    bpy = shop.bpy
    shop.two_rooms()
    bpy.context.scene.enfilade.solve.quality = "fine"
    bpy.context.scene.enfilade.rooms = bpy.data.collections["Rooms"]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    assert bpy.context.scene.enfilade.solve.quality == "fine"
    assert bpy.context.scene.enfilade.rooms.name == "Rooms"


def viewports(bpy):
    return [space.shading for screen in bpy.data.screens for area in screen.areas for space in area.spaces if space.type == "VIEW_3D"]


def test_viewports_show_the_bake_and_come_back(shop, lit_room):
    bpy = shop.bpy
    views = viewports(bpy)
    assert views
    own = {(v.type, v.light, v.color_type) for v in views}
    assert not bpy.ops.enfilade.show_bake.poll()
    shop.bake()
    assert bpy.ops.enfilade.show_bake() == {"FINISHED"}
    assert {(v.type, v.light, v.color_type) for v in views} == {("SOLID", "FLAT", "VERTEX")}
    # What is shown is what there is, not what the next bake would make.
    bpy.context.scene.enfilade.bake.target = "texture"
    bpy.ops.enfilade.show_bake()
    assert {(v.type, v.light, v.color_type) for v in views} == own
    bpy.ops.enfilade.show_bake()
    bpy.ops.enfilade.clear()
    assert {(v.type, v.light, v.color_type) for v in views} == own


def test_textures_are_shown_by_their_materials_only(shop, lit_room):
    shop.bake(target="texture", texel_density=2.0)
    with pytest.raises(RuntimeError, match="switch Material on under Output and bake again"):
        shop.bpy.ops.enfilade.show_bake()
    shop.bake(target="texture", texel_density=2.0, material=True)
    shop.bpy.ops.enfilade.show_bake()
    assert {v.type for v in viewports(shop.bpy)} == {"MATERIAL"}


def test_undo_of_a_bake_gives_the_viewports_back(shop, lit_room):
    bpy = shop.bpy
    own = [(v.type, v.light, v.color_type) for v in viewports(bpy)]
    bpy.ops.ed.undo_push(message="before")
    shop.bake()
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.enfilade.show_bake()
    assert [(v.type, v.light, v.color_type) for v in viewports(bpy)] != own
    bpy.ops.ed.undo()
    assert len(bpy.data.objects["West walls"].data.color_attributes) == 0
    assert [(v.type, v.light, v.color_type) for v in viewports(bpy)] == own
    assert not bpy.ops.enfilade.show_bake.poll()


def test_nothing_is_left_after_unregister(shop):
    import bpy
    import enfilade

    def ours():
        kinds = (bpy.types.Scene, bpy.types.Object, bpy.types.Mesh, bpy.types.Image, bpy.types.Material, bpy.types.WindowManager)
        kinds = (*kinds, bpy.types.Collection, bpy.types.Light, bpy.types.World)
        found = [f"{kind.__name__}.{name}" for kind in kinds for name, _ in kind.bl_rna.properties.items() if "enfilade" in name]
        found += [n for n in dir(bpy.types) if "ENFILADE" in n.upper()]
        for name in dir(bpy.app.handlers):
            functions = getattr(bpy.app.handlers, name)
            if isinstance(functions, list):
                found += [f"{name}: {f.__name__}" for f in functions if (f.__module__ or "").startswith("enfilade")]
        for menu in (bpy.types.VIEW3D_MT_object, bpy.types.VIEW3D_MT_edit_mesh_faces):
            drawn = getattr(menu.draw, "_draw_funcs", [])
            found += [f"{menu.__name__}: {f.__name__}" for f in drawn if (f.__module__ or "").startswith("enfilade")]
        if any(
            "ENFILADE" in kind.__name__ for kind in bpy.types.AddonPreferences.__subclasses__() if getattr(kind, "is_registered", False)
        ):
            found.append("preferences")
        return found + [f"ops.{n}" for n in dir(bpy.ops.enfilade)]

    before = ours()
    assert {"preferences", "VIEW3D_MT_object: _in_object_menu"} <= set(before)
    assert len(before) > 40
    assert any(name.startswith("depsgraph_update_post") for name in before)
    from enfilade.addon import command_line

    assert command_line._handle is not None
    enfilade.unregister()
    try:
        assert ours() == []
        assert command_line._handle is None
    finally:
        enfilade.register()
    assert ours() == before


# ---------------------------------------------------------------------------------------------------- the worker


def wait(worker, seconds=5.0):
    worker.join(seconds)
    assert worker.done


def test_a_worker_runs_to_the_end():
    from enfilade.addon.worker import Worker

    def count():
        yield from range(5)
        return "ready"

    worker = Worker(count())
    wait(worker)
    assert (worker.latest, worker.result, worker.error) == (4, "ready", None)


def test_a_worker_keeps_its_error():
    from enfilade.addon.worker import Worker

    def fail():
        yield 1
        raise ValueError("no")

    worker = Worker(fail())
    wait(worker)
    assert isinstance(worker.error, ValueError)
    assert worker.result is None


def test_a_cancelled_worker_closes_its_generator():
    from enfilade.addon.worker import Worker

    closed = threading.Event()

    def forever():
        try:
            while True:
                time.sleep(0.01)
                yield
        finally:
            closed.set()

    worker = Worker(forever())
    assert not worker.done
    worker.cancel()
    wait(worker)
    assert closed.is_set()
    assert worker.result is None
    assert worker.error is None


def test_a_bake_left_before_writing_changes_nothing(shop, lit_room):
    from enfilade.addon import job

    before = shop.state()
    reading = job.read(shop.bpy.context, Options(quality="draft"), BakeOptions(subdivide=0.5))
    steps = job.work(reading)
    seen = [next(steps) for _ in range(4)]
    steps.close()
    assert [s.fraction for s in seen] == sorted(s.fraction for s in seen)
    assert shop.state() == before


def test_progress_runs_from_start_to_end(shop, lit_room):
    from enfilade.addon import job

    reading = job.read(shop.bpy.context, Options(quality="draft"), BakeOptions())
    seen = []
    baked = job.solve_all(reading, seen.append)
    fractions = [step.fraction for step in seen]
    assert fractions == sorted(fractions)
    assert fractions[-1] == pytest.approx(1.0)
    assert all(step.stage and step.message for step in seen)
    assert baked.report["seconds"]["total"] == pytest.approx(sum(v for k, v in baked.report["seconds"].items() if k != "total"))


class FakeOperator:
    """The methods of the operator on a plain object: Blender makes instances itself, in a window only."""

    def __init__(self):
        from enfilade.addon.operators import ENFILADE_OT_bake

        self.said = []
        self.show, self.scope = True, "ALL"
        for name in ("read", "execute", "modal", "cancel", "_show_progress", "_finish", "_refuse", "_write"):
            setattr(self, name, getattr(ENFILADE_OT_bake, name).__get__(self))
        self.start = ENFILADE_OT_bake.begin.__get__(self)

    def report(self, kind, text):
        self.said.append((next(iter(kind)), text))


def test_a_modal_bake_finishes(shop, lit_room):
    from enfilade.addon import operators, overlay

    shop.bpy.context.scene.enfilade.solve.quality = "draft"
    window, operator = FakeWindow(shop.bpy), FakeOperator()
    assert operator.start(window) == {"RUNNING_MODAL"}
    assert operators.progress() is not None
    assert window.handlers == [operator]
    before, drawn = shop.state(), []
    deadline = time.monotonic() + 60
    outcome = {"PASS_THROUGH"}
    while outcome == {"PASS_THROUGH"} and time.monotonic() < deadline:
        assert operator.modal(window, Event("MOUSEMOVE")) == {"PASS_THROUGH"}
        outcome = operator.modal(window, Event("TIMER"))
        shown = overlay.content()
        if outcome == {"PASS_THROUGH"} and shown is not None and not any(shown is one for one in drawn):
            drawn.append(shown)
            assert shop.state() == before
        time.sleep(0.01)
    assert outcome == {"FINISHED"}, operator.said
    # The light so far was shown over the viewports meanwhile, and is gone.
    assert {content.title for content in drawn} == {"The light so far"}
    assert overlay.content() is None
    assert operators.progress() is None
    assert window.status is None
    assert window.handlers == []
    assert operator.said[-1][0] == "INFO"
    assert shop.colors(lit_room["West"]).shape == (20, 4)


@pytest.mark.parametrize("how", ["escape", "button", "file closed"])
def test_a_modal_bake_is_cancelled(shop, lit_room, how):
    from enfilade.addon import operators

    before = shop.state()
    window, operator = FakeWindow(shop.bpy), FakeOperator()
    operator.start(window)
    operator.modal(window, Event("TIMER"))
    if how == "escape":
        assert operator.modal(window, Event("ESC", "PRESS")) == {"CANCELLED"}
    elif how == "button":
        shop.bpy.ops.enfilade.cancel()
        assert operator.modal(window, Event("TIMER")) == {"CANCELLED"}
    else:
        operator.cancel(window)
    operator._worker.join(60)
    assert operator._worker.done
    assert operators.progress() is None
    assert window.status is None
    assert shop.state() == before


def test_a_modal_bake_that_fails_says_so(shop, lit_room, monkeypatch):
    from enfilade.addon import job
    from enfilade.core.scene import SceneError

    def work(reading):
        yield job.Step("solve", 0.1, "")
        raise SceneError("the roof leaks")

    monkeypatch.setattr(job, "work_beside", work)
    window, operator = FakeWindow(shop.bpy), FakeOperator()
    operator.start(window)
    operator._worker.join(5)
    assert operator.modal(window, Event("TIMER")) == {"CANCELLED"}
    assert operator.said == [("ERROR", "The roof leaks")]
    assert window.handlers == []


def test_numbers_are_the_same_from_button_and_function(shop, lit_room):
    """The button adds nothing of its own: the solver's values stand on the mesh."""
    from enfilade.addon import job

    shop.bpy.context.scene.enfilade.solve.quality = "draft"
    reading = job.read(shop.bpy.context, *job.settings(shop.bpy.context.scene))
    baked = job.solve_all(reading)
    shop.bpy.ops.enfilade.bake()
    for receiver, color in zip(reading.receivers, baked.colors, strict=True):
        assert np.array_equal(shop.colors(shop.bpy.data.objects[receiver.name]), color)
