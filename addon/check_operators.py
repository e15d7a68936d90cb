# SPDX-License-Identifier: GPL-3.0-or-later
"""The check before a bake: a list of findings, each of which selects what it is about when it is clicked."""

from __future__ import annotations

import textwrap

import bmesh
import bpy
from mathutils import Vector

from .checks import Finding, check, cost
from .guards import REFUSALS, in_object_mode, redraw_panels, sentence

ICONS = {"ERROR": "CANCEL", "WARNING": "ERROR", "NOTE": "INFO"}


class ENFILADE_PG_finding(bpy.types.PropertyGroup):
    """One finding; the objects' names one to a line."""

    level: bpy.props.StringProperty(options={"HIDDEN"})
    title: bpy.props.StringProperty(options={"HIDDEN"})
    message: bpy.props.StringProperty(options={"HIDDEN"})
    objects: bpy.props.StringProperty(options={"HIDDEN"})
    faces: bpy.props.StringProperty(options={"HIDDEN"})
    has_place: bpy.props.BoolProperty(options={"HIDDEN"})
    place: bpy.props.FloatVectorProperty(options={"HIDDEN"}, subtype="XYZ")


def _clicked(checked: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    if 0 <= checked.active < len(checked.findings):
        select(context, checked.findings[checked.active])


class ENFILADE_PG_check(bpy.types.PropertyGroup):
    """The findings of the last check and the one that is looked at."""

    done: bpy.props.BoolProperty(options={"HIDDEN"})
    estimate: bpy.props.StringProperty(options={"HIDDEN"})
    basis: bpy.props.StringProperty(options={"HIDDEN"})
    findings: bpy.props.CollectionProperty(type=ENFILADE_PG_finding, options={"HIDDEN"})
    active: bpy.props.IntProperty(
        name="Finding", description="Click to select what this is about", default=-1, update=_clicked, options={"HIDDEN"}
    )


def select(context: bpy.types.Context, finding: ENFILADE_PG_finding) -> None:
    """Select the objects of a finding, and in their meshes its faces; look at them in the viewports."""
    if context.mode != "OBJECT":
        return
    things = [o for name in finding.objects.split("\n") if (o := context.view_layer.objects.get(name)) is not None]
    for thing in context.view_layer.objects:
        thing.select_set(thing in things)
    things = [o for o in things if o.visible_get()]
    if things:
        context.view_layer.objects.active = things[0]
        if finding.faces and things[0].type == "MESH" and things[0].data.library is None:
            _select_faces(things[0].data, {int(face) for face in finding.faces.split()})
    places = [Vector(finding.place)] if finding.has_place else [o.matrix_world @ Vector(c) for o in things for c in o.bound_box]
    if places:
        _look_at(context, places)


def _select_faces(mesh: bpy.types.Mesh, faces: set[int]) -> None:
    """Leave exactly these faces selected, as one finds them in edit mode."""
    work = bmesh.new()
    work.from_mesh(mesh)
    for part in (work.verts, work.edges, work.faces):
        for item in part:
            item.select = False
    for face in work.faces:
        if face.index in faces:
            face.select_set(True)
    work.to_mesh(mesh)
    work.free()


def _look_at(context: bpy.types.Context, places: list[Vector]) -> None:
    """Turn no view, but bring the places into the middle of each, from a little farther than they are wide."""
    low = Vector([min(p[k] for p in places) for k in range(3)])
    high = Vector([max(p[k] for p in places) for k in range(3)])
    for area in context.screen.areas if context.screen is not None else ():
        if area.type == "VIEW_3D":
            eye = area.spaces.active.region_3d
            if eye.view_perspective == "CAMERA":
                eye.view_perspective = "PERSP"
            eye.view_location = (low + high) / 2
            eye.view_distance = max(1.5 * (high - low).length, 4.0 / context.scene.unit_settings.scale_length)


def fill(checked: ENFILADE_PG_check, found: list[Finding]) -> None:
    """Put findings into the list."""
    checked.findings.clear()
    checked.active = -1
    for finding in found:
        item = checked.findings.add()
        item.level, item.title, item.message = finding.level, finding.title, finding.message
        item.objects, item.faces = "\n".join(finding.objects), " ".join(map(str, finding.faces))
        item.has_place = finding.place is not None
        item.place = finding.place or (0.0, 0.0, 0.0)
    checked.estimate = checked.basis = ""
    checked.done = True


class ENFILADE_OT_check(bpy.types.Operator):
    """Look for what would go wrong or look wrong: portals, leaks, normals, lights; and for what the bake will cost"""

    bl_idname = "enfilade.check"
    bl_label = "Check"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return in_object_mode(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        checked = context.window_manager.enfilade_check
        try:
            fill(checked, check(context))
            checked.estimate, checked.basis = cost(context)
        except REFUSALS as error:
            self.report({"ERROR"}, sentence(error))
            return {"CANCELLED"}
        redraw_panels(context)
        self.report({"INFO"}, headline(checked))
        return {"FINISHED"}


def headline(checked: ENFILADE_PG_check) -> str:
    """How many findings of each level there are."""
    counts = [(sum(f.level == level for f in checked.findings), word) for level, word in (("ERROR", "error"), ("WARNING", "warning"))]
    said = [f"{n} {word}{'s' * (n != 1)}" for n, word in counts if n]
    return ", ".join(said) if said else "Ready to bake"


class ENFILADE_UL_findings(bpy.types.UIList):
    """Findings by level."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0) -> None:
        layout.label(text=item.title, icon=ICONS[item.level], translate=False)


class _CheckPanel:
    bl_label = "Check"
    bl_order = 1
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        checked = context.window_manager.enfilade_check
        layout.operator("enfilade.check", icon="CHECKMARK")
        if not checked.done:
            return
        errors = any(f.level == "ERROR" for f in checked.findings)
        warnings = any(f.level == "WARNING" for f in checked.findings)
        layout.label(text=headline(checked), icon="CANCEL" if errors else "ERROR" if warnings else "CHECKMARK")
        if len(checked.findings):
            rows = min(max(3, len(checked.findings)), 8)
            layout.template_list("ENFILADE_UL_findings", "", checked, "findings", checked, "active", rows=rows)
        if 0 <= checked.active < len(checked.findings):
            _paragraph(layout, context, checked.findings[checked.active].message)
        if checked.estimate:
            layout.label(text=checked.estimate, icon="TIME")
            _paragraph(layout, context, checked.basis)


def _paragraph(layout: bpy.types.UILayout, context: bpy.types.Context, text: str) -> None:
    """A text in lines as wide as the panel."""
    scale = context.preferences.system.ui_scale
    width = max(20, int((context.region.width / scale - 40) / 6.4))
    column = layout.column(align=True)
    column.scale_y = 0.8
    for line in textwrap.wrap(text, width):
        column.label(text=line, translate=False)


class ENFILADE_PT_check(_CheckPanel, bpy.types.Panel):
    """What to know before a bake."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_parent_id = "ENFILADE_PT_render"


class ENFILADE_PT_sidebar_check(_CheckPanel, bpy.types.Panel):
    """What to know before a bake."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Enfilade"
    bl_parent_id = "ENFILADE_PT_sidebar"


@bpy.app.handlers.persistent
def _before_load(*_) -> None:
    """The findings of one file mean nothing in another."""
    checked = bpy.context.window_manager.enfilade_check
    checked.findings.clear()
    checked.done = False
    checked.estimate = checked.basis = ""


_CLASSES = (
    ENFILADE_PG_finding,
    ENFILADE_PG_check,
    ENFILADE_OT_check,
    ENFILADE_UL_findings,
    ENFILADE_PT_check,
    ENFILADE_PT_sidebar_check,
)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.WindowManager.enfilade_check = bpy.props.PointerProperty(type=ENFILADE_PG_check, options={"HIDDEN", "SKIP_SAVE"})
    bpy.app.handlers.load_pre.append(_before_load)


def unregister() -> None:
    bpy.app.handlers.load_pre.remove(_before_load)
    del bpy.types.WindowManager.enfilade_check
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
