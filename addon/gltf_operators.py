# SPDX-License-Identifier: GPL-3.0-or-later
"""The button that writes a baked scene for web viewers."""

from __future__ import annotations

import bpy
from bpy_extras.io_utils import ExportHelper

from .clear import has_bake
from .export_gltf import export
from .guards import REFUSALS, in_object_mode, sentence


class ENFILADE_OT_export_gltf(bpy.types.Operator, ExportHelper):
    """Write the baked meshes into a .glb file that web viewers show as Show Bake does: light in the colours, no lamps needed"""

    bl_idname = "enfilade.export_gltf"
    bl_label = "Export Baked glTF"
    bl_options = {"PRESET"}
    filename_ext = ".glb"

    filter_glob: bpy.props.StringProperty(default="*.glb", options={"HIDDEN"})
    exposure: bpy.props.FloatProperty(
        name="Exposure", description="Stops by which the light is made brighter", default=0.0, soft_min=-10.0, soft_max=10.0
    )
    double_sided: bpy.props.BoolProperty(
        name="Double-Sided", description="Show also the backs of faces; without it one looks into rooms from outside", default=False
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not in_object_mode(cls, context):
            return False
        if not has_bake(context.scene):
            cls.poll_message_set("There is no bake in this scene: bake first, then export")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            done = export(context, self.filepath, self.exposure, self.double_sided)
        except REFUSALS as error:
            self.report({"ERROR"}, sentence(error))
            return {"CANCELLED"}
        for warning in done.warnings:
            self.report({"WARNING"}, warning[:1].upper() + warning[1:])
        self.report({"INFO"}, f"Written: {len(done.objects):,} objects in {self.filepath}")
        return {"FINISHED"}


def _menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.operator(ENFILADE_OT_export_gltf.bl_idname, text="Enfilade Bake (.glb)")


def register() -> None:
    bpy.utils.register_class(ENFILADE_OT_export_gltf)
    bpy.types.TOPBAR_MT_file_export.append(_menu)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_export.remove(_menu)
    bpy.utils.unregister_class(ENFILADE_OT_export_gltf)
