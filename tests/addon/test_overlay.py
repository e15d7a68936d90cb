"""Clusters, visible sets and leaks over the viewports: what would be drawn, and that nothing else is touched."""

import numpy as np
import pytest


@pytest.fixture
def rooms(shop):
    from enfilade.addon import overlay

    yield shop.two_rooms()
    overlay.hide()


def content():
    from enfilade.addon import overlay

    return overlay.content()


def layers(part):
    return [layer for layer in content().layers if layer.part == part]


def inspected(shop):
    from enfilade.addon.inspection import inspect

    shop.bpy.context.view_layer.update()
    return inspect(shop.bpy.context)


def test_clusters_are_those_of_the_solver(shop, rooms, tmp_path):
    from enfilade.core.clustering import Clusters
    from enfilade.core.options import Options
    from enfilade.core.pipeline import solve
    from enfilade.core.stage_files import load_stage
    from enfilade.core.visibility_graph import VisibilityGraph

    shop.bpy.context.scene.enfilade.solve.average = 3
    shop.bpy.context.scene.enfilade.solve.large_polygon = 100.0
    found = inspected(shop)
    solve(found.scene, Options(quality="draft", average=3, large_polygon=100.0, store=str(tmp_path)))
    clusters = load_stage(Clusters, tmp_path / "clusters.npz")
    assert np.array_equal(found.clusters.cluster_of, clusters.cluster_of)
    assert np.array_equal(found.graph.bits, load_stage(VisibilityGraph, tmp_path / "graph.npz").bits)
    # Polygons of one region are in the cluster of that region: none is left over or in two.
    assert np.array_equal(np.bincount(found.cluster_of, minlength=len(clusters)), clusters.polygons)


def test_clusters_are_drawn_on_their_faces_with_their_boxes(shop, rooms):
    settings = shop.bpy.context.scene.enfilade.solve
    settings.average, settings.large_polygon = 3, 100.0
    assert shop.bpy.ops.enfilade.show_clusters() == {"FINISHED"}
    found = inspected(shop)
    (surfaces,), (boxes,) = layers("surfaces"), layers("boxes")
    assert np.allclose(surfaces.position.reshape(-1, 3, 3), found.triangle)
    # Faces of one cluster have one hue, those of different clusters have not.
    cluster = found.cluster_of[found.polygon]
    chroma = surfaces.color[::3, :3] / surfaces.color[::3, :3].max(axis=1)[:, None]
    for c in range(len(found.clusters)):
        assert np.ptp(chroma[cluster == c], axis=0).max() < 1e-5
    firsts = chroma[[np.argmax(cluster == c) for c in range(len(found.clusters))]]
    assert len(np.unique(np.round(firsts, 4), axis=0)) == len(found.clusters)
    gathered = np.diff(found.clusters.start) > 1
    assert gathered.any()
    corners = boxes.position.reshape(gathered.sum(), 24, 3)
    assert np.allclose(corners.min(axis=1), found.clusters.box_min[gathered], atol=1e-6)
    assert np.allclose(corners.max(axis=1), found.clusters.box_max[gathered], atol=1e-6)
    assert content().title.startswith(f"{len(found.clusters)} clusters of 21 polygons in 2 rooms")


def test_levels_of_the_hierarchy_nest(shop, rooms):
    from enfilade.addon.inspection import groups_of

    settings = shop.bpy.context.scene.enfilade.solve
    settings.average, settings.large_polygon, settings.hierarchy_children = 1, 100.0, 2
    found = inspected(shop)
    finer = np.arange(len(found.clusters))
    for level in (9, 2, 1):
        groups = groups_of(found, level)
        pairs = np.unique(np.stack([finer, groups.of_cluster], axis=1), axis=0)
        assert len(pairs) == finer.max() + 1  # each of the finer groups is in one of these
        for g in range(len(groups.low)):
            members = groups.of_cluster == g
            assert len(np.unique(found.clusters.room[members])) == 1
            assert np.allclose(groups.low[g], found.clusters.box_min[members].min(axis=0))
            assert np.allclose(groups.high[g], found.clusters.box_max[members].max(axis=0))
        finer = groups.of_cluster
    assert len(groups.low) == 4
    shop.bpy.ops.enfilade.show_clusters(level=1)
    assert content().title.startswith(f"4 groups of {len(found.clusters)} clusters")
    assert len(layers("boxes")[0].position) <= 4 * 24


def test_visible_sets_are_coloured_by_portals(shop, rooms):
    from enfilade.addon.overlay_layers import CROSSED, PICKED

    bpy = shop.bpy
    bpy.context.view_layer.objects.active = rooms["Lamp"]
    assert bpy.ops.enfilade.show_visible() == {"FINISHED"}
    found = inspected(shop)
    faces, (windows,) = [layer for layer in content().layers if layer.part in ("surfaces", "picked") and not layer.lines], layers("windows")
    middles = np.concatenate([layer.position for layer in faces]).reshape(-1, 3, 3).mean(axis=1)
    chroma = np.concatenate([layer.color for layer in faces])[::3, :3]
    chroma /= chroma.max(axis=1)[:, None]

    def of(color, where):
        return np.abs(chroma[where] - np.array(color) / max(color)).max() < 1e-5

    lamp = np.abs(middles[:, 2] - 2.4) < 1e-3
    assert of(PICKED, lamp)
    assert of(CROSSED[0], (middles[:, 0] < 4.1) & ~lamp)
    assert of(CROSSED[1], middles[:, 0] > 4.1)
    # The lamp is at the height of 2.4 m over the door of 2 m: the ceiling next door is out of sight.
    beyond = middles[middles[:, 0] > 4.3]
    assert len(beyond)
    assert (beyond[:, 2] < 2.4).all()
    assert np.allclose(windows.position.min(axis=0), [4.1, 1, 0])
    assert np.allclose(windows.position.max(axis=0), [4.1, 2, 2])
    assert len(layers("volumes")) == 2
    for volume in layers("volumes"):
        assert volume.position[:, 0].min() > 4.2 - 1e-5
        assert volume.position[:, 0].max() < 7.2 + 1e-5
    held = [row for row in content().legend if "portal" in row[1]]
    assert len(held) == 1
    assert 0 < int(held[0][1].split(", ")[1].split()[0]) < found.clusters.polygons[found.clusters.room == 1].sum()


def test_a_face_of_the_active_object_can_be_named(shop, rooms):
    bpy = shop.bpy
    bpy.context.view_layer.objects.active = rooms["West"]
    for face, height in ((3, 0.0), (4, 2.5)):
        bpy.ops.enfilade.show_visible(face=face)
        assert np.allclose(layers("picked")[-1].position[:, 2], height)
    with pytest.raises(RuntimeError, match="has no face 77"):
        bpy.ops.enfilade.show_visible(face=77)


def test_rays_pick_the_nearest_face_that_is_shown(shop, rooms):
    from enfilade.addon.inspection import cluster_under

    found = inspected(shop)
    names = np.array(found.scene.object_names)[found.scene.object]
    lamp = set(found.cluster_of[names == "Lamp"])
    up = np.array([1.5, 1.5, 1.0]), np.array([0.0, 0.0, 1.0])
    assert cluster_under(found, *up, True) in lamp
    down = np.array([1.5, 1.5, 9.0]), np.array([0.0, 0.0, -1.0])
    through = cluster_under(found, *down, True)
    assert found.clusters.box_max[through][2] == 0
    assert cluster_under(found, *down, False) != through
    assert cluster_under(found, np.array([50.0, 0, 0]), np.array([1.0, 0, 0]), False) == -1
    rooms["Lamp"].hide_set(True)
    hidden = inspected(shop)
    assert cluster_under(hidden, *up, True) not in set(hidden.cluster_of[names == "Lamp"])


def test_a_closed_building_has_no_leaks_and_a_hole_is_shown(shop, rooms):
    bpy = shop.bpy
    assert bpy.ops.enfilade.find_leaks() == {"FINISHED"}
    assert content().layers == ()
    assert content().title.startswith("No room leaks")
    # Without the portal all that passes the door passes a hole.
    bpy.data.objects.remove(rooms["Door"])
    bpy.context.view_layer.update()
    assert bpy.ops.enfilade.find_leaks() == {"FINISHED"}
    line = layers("leaks")[0].position
    assert len(line) >= 2
    low, high = sorted(line[:2].tolist())
    assert low[0] < 4.0 + 1e-4
    assert high[0] > 4.2 - 1e-4
    share = (4.1 - low[0]) / (high[0] - low[0])
    at_the_door = np.array(low) + share * (np.array(high) - low)
    assert (at_the_door[1:] > [0.99, -0.01]).all()
    assert (at_the_door[1:] < [2.01, 2.01]).all()
    assert content().legend[0][1].split(":")[0] in ("from West into East", "from East into West")


def test_lengths_are_in_the_units_of_the_scene(shop, rooms):
    shop.bpy.context.scene.unit_settings.scale_length = 0.01
    shop.bpy.context.scene.enfilade.solve.large_polygon = 1e4
    shop.bpy.ops.enfilade.show_clusters()
    assert np.allclose(layers("surfaces")[0].position.max(axis=0), [7.2, 3, 2.5])
    assert np.allclose(layers("boxes")[0].position.max(axis=0), [7.2, 3, 2.5])


def test_the_file_is_as_before(shop, rooms):
    bpy = shop.bpy
    bpy.context.view_layer.objects.active = rooms["Lamp"]
    before = shop.state()
    for operator in ("show_clusters", "show_visible", "find_leaks", "hide_overlay"):
        getattr(bpy.ops.enfilade, operator)()
        assert shop.state() == before
    assert content() is None
    with pytest.raises(RuntimeError, match="Nothing is drawn"):
        bpy.ops.enfilade.hide_overlay()


def test_drawings_go_with_their_file_and_with_the_add_on(shop, rooms):
    import enfilade

    shop.bpy.ops.enfilade.show_clusters()
    shop.bpy.ops.wm.read_factory_settings(use_empty=True)
    assert content() is None
    shop.two_rooms()
    shop.bpy.ops.enfilade.show_clusters()
    enfilade.unregister()
    try:
        assert content() is None
    finally:
        enfilade.register()


def test_what_cannot_be_shown_is_said(shop):
    bpy = shop.bpy
    with pytest.raises(RuntimeError, match="no mesh that is visible in renders"):
        bpy.ops.enfilade.show_clusters()
    with pytest.raises(RuntimeError, match="no mesh that is visible in renders"):
        bpy.ops.enfilade.find_leaks()
    with pytest.raises(RuntimeError, match="active object first"):
        bpy.ops.enfilade.show_visible()
    assert content() is None
    made = shop.two_rooms()
    bpy.context.view_layer.objects.active = made["Door"]
    with pytest.raises(RuntimeError, match="'Door' is in no room"):
        bpy.ops.enfilade.show_visible()


class Picking:
    """A window with one viewport that looks straight down, and the methods of the operator on a plain object."""

    def __init__(self, shop, monkeypatch):
        from enfilade.addon import overlay_operators
        from enfilade.addon.overlay_operators import ENFILADE_OT_pick_visible as cls

        self.cursors, self.status, self.handlers, self.said = [], "?", [], []
        self.mode = "OBJECT"
        self.enfilade_overlay = shop.bpy.context.window_manager.enfilade_overlay
        self.scene, self.view_layer = shop.bpy.context.scene, shop.bpy.context.view_layer
        self.evaluated_depsgraph_get = shop.bpy.context.evaluated_depsgraph_get
        self.window = self.workspace = self.window_manager = self
        self.space_data = self
        self.type = "VIEW_3D"
        for name in ("read", "invoke", "modal", "cancel"):
            setattr(self, f"do_{name}", getattr(cls, name).__get__(self))
        self.read, self.cancel = self.do_read, self.do_cancel
        monkeypatch.setattr(overlay_operators, "_view_under", self.view_under)

    def view_under(self, context, event):
        if event.at is None:
            return None
        space = type("Space", (), {"shading": type("Shading", (), {"show_backface_culling": False})})
        return np.array([*event.at, 50.0]), np.array([0.0, 0.0, -1.0]), space

    def cursor_modal_set(self, name):
        self.cursors.append(name)

    def cursor_modal_restore(self):
        self.cursors.append("")

    def status_text_set(self, text):
        self.status = text

    def modal_handler_add(self, operator):
        self.handlers.append(operator)

    def report(self, kind, text):
        self.said.append(text)


class Click:
    def __init__(self, kind="LEFTMOUSE", at=None, value="PRESS"):
        self.type, self.value, self.at = kind, value, at


def test_clicks_pick_one_cluster_after_the_other(shop, rooms, monkeypatch):
    window = Picking(shop, monkeypatch)
    assert window.do_invoke(window, Click()) == {"RUNNING_MODAL"}
    assert window.cursors[-1] == "EYEDROPPER"
    assert window.handlers == [window]
    assert window.do_modal(window, Click(at=(50.0, 50.0))) == {"RUNNING_MODAL"}
    assert content() is None
    for at, room in (((0.5, 0.5), "West"), ((6.0, 1.0), "East")):
        assert window.do_modal(window, Click(at=at)) == {"RUNNING_MODAL"}
        assert content().legend[0][1].endswith(f"in {room}")
        assert layers("picked")[-1].position[:, 2].max() == 0  # the floor: the back of the ceiling is drawn over
    window.enfilade_overlay.in_front = False
    try:
        window.do_modal(window, Click(at=(6.0, 1.0)))
        assert layers("picked")[-1].position[:, 2].max() == 2.5
    finally:
        window.enfilade_overlay.in_front = True
    # Navigation and clicks on panels are Blender's.
    assert window.do_modal(window, Click(at=None)) == {"PASS_THROUGH"}
    assert window.do_modal(window, Click("MIDDLEMOUSE", (0.5, 0.5))) == {"PASS_THROUGH"}
    assert window.do_modal(window, Click("LEFTMOUSE", (0.5, 0.5), "RELEASE")) == {"PASS_THROUGH"}
    assert window.do_modal(window, Click("ESC")) == {"FINISHED"}
    assert (window.cursors[-1], window.status) == ("", None)
    assert content() is not None


def test_picking_in_a_broken_scene_ends_at_once(shop, monkeypatch):
    window = Picking(shop, monkeypatch)
    assert window.do_invoke(window, Click()) == {"CANCELLED"}
    assert "no mesh that is visible in renders" in window.said[0]
    assert (window.cursors[-1], window.handlers) == ("", [])


def test_what_is_shown_knows_its_button(shop):
    from enfilade.addon import overlay

    shop.two_rooms()
    assert overlay.shown_by() == ""
    for operator, name in ((shop.bpy.ops.enfilade.show_clusters, "show_clusters"), (shop.bpy.ops.enfilade.find_leaks, "find_leaks")):
        operator()
        assert overlay.shown_by() == f"enfilade.{name}"
    shop.bpy.ops.enfilade.hide_overlay()
    assert overlay.shown_by() == ""
