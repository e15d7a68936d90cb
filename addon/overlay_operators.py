# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons that show what the solver works with, drawn over the viewports: clusters, visible sets, leaks."""

from __future__ import annotations

import bpy
import numpy as np
from bpy_extras import view3d_utils

from . import last_light, overlay
from .guards import REFUSALS, in_object_mode, sentence
from .inspection import Inspection, cluster_of_object, cluster_under, groups_of, inspect, leaks_of, sight_of
from .light_layers import elements_content, error_content, lux_content
from .overlay_layers import MOST_NAMED, Content, clusters_content, groups_content, leaks_content, sight_content


def _changed(_settings: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    overlay.redraw()


def _scale_changed(settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Draw the false colours anew where it is they that are drawn."""
    light, shown = last_light.of(context.scene), overlay.content()
    if light is not None and shown is not None and shown.scale is not None and shown.scale.unit == "lux":
        overlay.show(lux_content(light, settings.lux_top, settings.lux_logarithmic), overlay.shown_by())


class ENFILADE_PG_overlay(bpy.types.PropertyGroup):
    """What of a drawing is shown."""

    surfaces: bpy.props.BoolProperty(name="Surfaces", description="Colour the faces", default=True, update=_changed)
    boxes: bpy.props.BoolProperty(name="Boxes", description="Draw the bounding boxes of the clusters", default=True, update=_changed)
    windows: bpy.props.BoolProperty(
        name="Windows", description="Draw what is left of each portal as seen from the cluster", default=True, update=_changed
    )
    volumes: bpy.props.BoolProperty(
        name="Volumes", description="Draw the space that is seen behind each portal", default=False, update=_changed
    )
    level: bpy.props.IntProperty(
        name="Level", description="Level of the hierarchy that Show Clusters shows; 0: the clusters themselves", default=0, min=0, max=64
    )
    lux_top: bpy.props.FloatProperty(
        name="Scale to",
        description="Illuminance at the upper end of the scale of false colours (lux); 0: just above what nearly all surfaces receive",
        default=0.0,
        min=0.0,
        soft_max=10_000.0,
        precision=0,
        step=1000,
        update=_scale_changed,
    )
    lux_logarithmic: bpy.props.BoolProperty(
        name="Logarithmic", description="Equal steps of colour for equal factors of light, over a thousandfold", update=_scale_changed
    )
    in_front: bpy.props.BoolProperty(
        name="In Front", description="Draw over the walls and ceilings that are in the way", default=True, update=_changed
    )


class _Shows:
    """What all buttons that show something have in common."""

    bl_options = set()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return in_object_mode(cls, context)

    def read(self, context: bpy.types.Context) -> Inspection | None:
        """The clusters of the scene, or None after an error was reported."""
        try:
            return inspect(context)
        except REFUSALS as error:
            self.report({"ERROR"}, sentence(error))
            return None


class ENFILADE_OT_show_clusters(_Shows, bpy.types.Operator):
    """Colour the clusters of all rooms and draw their bounding boxes"""

    bl_idname = "enfilade.show_clusters"
    bl_label = "Show Clusters"

    level: bpy.props.IntProperty(
        name="Level",
        description="0: the clusters; 1: what the rooms are divided into by the hierarchy of clusters; 2: what that is divided into; ..",
        default=0,
        min=0,
        max=64,
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        found = self.read(context)
        if found is None:
            return {"CANCELLED"}
        content = groups_content(found, groups_of(found, self.level)) if self.level else clusters_content(found)
        overlay.show(content, "enfilade.show_clusters")
        self.report({"INFO"}, overlay.content().title)
        return {"FINISHED"}


class ENFILADE_OT_show_visible(_Shows, bpy.types.Operator):
    """Colour all that the cluster of the active object may see, by the number of portals between"""

    bl_idname = "enfilade.show_visible"
    bl_label = "Visible from Active Object"

    face: bpy.props.IntProperty(
        name="Face",
        description="Face of the active object whose cluster is meant; -1: the cluster with most of its area",
        default=-1,
        min=-1,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.active_object is None or context.active_object.type != "MESH":
            cls.poll_message_set("Make a mesh of a room the active object first")
            return False
        return super().poll(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        thing = context.active_object
        if self.face >= len(thing.data.polygons):
            self.report({"ERROR"}, f"Object '{thing.name}' has no face {self.face}: it has {len(thing.data.polygons)}")
            return {"CANCELLED"}
        found = self.read(context)
        if found is None:
            return {"CANCELLED"}
        near = None
        if self.face >= 0:
            near = np.array(thing.matrix_world @ thing.data.polygons[self.face].center) * found.metres_per_unit
        cluster = cluster_of_object(found, thing.name, near)
        if cluster < 0:
            self.report({"ERROR"}, f"Object '{thing.name}' is in no room: choose one that takes part in the bake")
            return {"CANCELLED"}
        overlay.show(sight_content(found, sight_of(found, cluster)), "enfilade.show_visible")
        self.report({"INFO"}, overlay.content().title)
        return {"FINISHED"}


class ENFILADE_OT_pick_visible(_Shows, bpy.types.Operator):
    """Click on faces in the viewport to see what their clusters may see"""

    bl_idname = "enfilade.pick_visible"
    bl_label = "Pick in Viewport"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if context.space_data is None or context.space_data.type != "VIEW_3D":
            self.report({"ERROR"}, "Start this in a 3D viewport")
            return {"CANCELLED"}
        context.window.cursor_modal_set("WAIT")
        self._found = self.read(context)
        context.window.cursor_modal_restore()
        if self._found is None:
            return {"CANCELLED"}
        context.window.cursor_modal_set("EYEDROPPER")
        context.workspace.status_text_set("Click on a face: all that its cluster may see is coloured   |   right click or ESC ends")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            self.cancel(context)
            return {"FINISHED"}
        if event.type != "LEFTMOUSE" or event.value != "PRESS":
            return {"PASS_THROUGH"}
        under = _view_under(context, event)
        if under is None:
            return {"PASS_THROUGH"}
        origin, direction, space = under
        # Where backs are not drawn, or drawn over, one clicks on what is behind them.
        fronts = space.shading.show_backface_culling or context.window_manager.enfilade_overlay.in_front
        cluster = cluster_under(self._found, origin * self._found.metres_per_unit, direction, fronts)
        if cluster >= 0:
            overlay.show(sight_content(self._found, sight_of(self._found, cluster)), "enfilade.pick_visible")
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Every way out: the cursor and the status bar are as before."""
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)


class ENFILADE_OT_find_leaks(_Shows, bpy.types.Operator):
    """Look for gaps between rooms: lines from one room into another that pass no portal"""

    bl_idname = "enfilade.find_leaks"
    bl_label = "Find Leaks"

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            found = leaks_of(context)
        except REFUSALS as error:
            self.report({"ERROR"}, sentence(error))
            return {"CANCELLED"}
        content = leaks_content(found)
        overlay.show(content, "enfilade.find_leaks")
        for leak in found.leaks[:MOST_NAMED]:
            names = " leaks into ".join(repr(found.scene.room_names[room]) for room in (leak.room, leak.other))
            self.report({"WARNING"}, f"{names} past the portals: close the gap or put a portal into it")
        self.report({"INFO"}, content.title)
        return {"FINISHED"}


class _ShowsLight:
    """What all buttons that show the light of the last bake have in common."""

    bl_options = set()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if last_light.of(context.scene) is None:
            cls.poll_message_set("Bake first: this light is not saved in the file, it is there from a bake until the file is closed")
            return False
        return True

    def show(self, content: Content, by: str) -> set[str]:
        overlay.show(content, by)
        self.report({"INFO"}, content.title)
        return {"FINISHED"}


class ENFILADE_OT_false_color(_ShowsLight, bpy.types.Operator):
    """Show the illuminance that the last bake found in false colours, with a scale in lux"""

    bl_idname = "enfilade.false_color"
    bl_label = "False Colour"

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.window_manager.enfilade_overlay
        return self.show(lux_content(last_light.of(context.scene), settings.lux_top, settings.lux_logarithmic), "enfilade.false_color")


class ENFILADE_OT_show_elements(_ShowsLight, bpy.types.Operator):
    """Show the elements that the last bake divided the surfaces into: small ones where the light changes quickly"""

    bl_idname = "enfilade.show_elements"
    bl_label = "Elements"

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.show(elements_content(last_light.of(context.scene)), "enfilade.show_elements")


class ENFILADE_OT_show_error(_ShowsLight, bpy.types.Operator):
    """Show how far the light of the last bake may be off on each element, in parts of the mean light of its room"""

    bl_idname = "enfilade.show_error"
    bl_label = "Error Estimate"

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self.show(error_content(last_light.of(context.scene)), "enfilade.show_error")


class ENFILADE_OT_hide_overlay(bpy.types.Operator):
    """Take the drawing off the viewports"""

    bl_idname = "enfilade.hide_overlay"
    bl_label = "Hide"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if overlay.content() is None:
            cls.poll_message_set("Nothing is drawn")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        overlay.hide()
        return {"FINISHED"}


def _view_under(context: bpy.types.Context, event: bpy.types.Event):
    """Origin and direction (3,), Blender's units, of the ray under the mouse, and the viewport; None beside all viewports."""
    for area in context.window.screen.areas:
        if area.type != "VIEW_3D":
            continue
        # Panels lie over the view where regions overlap.
        covered = [r for r in area.regions if r.type != "WINDOW" and r.width > 1 and r.height > 1 and _within(r, event)]
        view = next((r for r in area.regions if r.type == "WINDOW" and _within(r, event)), None)
        if view is None or covered:
            continue
        place = (event.mouse_x - view.x, event.mouse_y - view.y)
        eye = area.spaces.active.region_3d
        origin = view3d_utils.region_2d_to_origin_3d(view, eye, place)
        direction = view3d_utils.region_2d_to_vector_3d(view, eye, place)
        return np.array(origin), np.array(direction), area.spaces.active
    return None


def _within(region: bpy.types.Region, event: bpy.types.Event) -> bool:
    return 0 <= event.mouse_x - region.x < region.width and 0 <= event.mouse_y - region.y < region.height


_CLASSES = (
    ENFILADE_PG_overlay,
    ENFILADE_OT_show_clusters,
    ENFILADE_OT_show_visible,
    ENFILADE_OT_pick_visible,
    ENFILADE_OT_find_leaks,
    ENFILADE_OT_false_color,
    ENFILADE_OT_show_elements,
    ENFILADE_OT_show_error,
    ENFILADE_OT_hide_overlay,
)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.WindowManager.enfilade_overlay = bpy.props.PointerProperty(type=ENFILADE_PG_overlay, options={"HIDDEN", "SKIP_SAVE"})


def unregister() -> None:
    del bpy.types.WindowManager.enfilade_overlay
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
