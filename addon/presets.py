# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets: settings of a bake under a name, those that come with the add-on and the user's own."""

from __future__ import annotations

import dataclasses

import bpy
from bl_operators.presets import AddPresetBase
from bl_ui.utils import PresetPanel

from ..core.options import BakeOptions, Options
from .properties import write_options

FOLDER = "enfilade"
"""Presets of the user lie in this folder among those of Blender."""

BUILT_IN = {
    "PREVIEW": ("Quick Look", "Vertex colours at draft quality: seconds, to see where the light goes", {"quality": "draft"}, {}),
    "VERTEX": ("Vertex Colours", "Light in a colour attribute of each mesh, for game engines and the web", {}, {}),
    "FINE_VERTEX": (
        "Fine Vertex Colours",
        "A subdivided copy of each mesh carries the light, with edges of 20 cm, where the meshes themselves are coarse",
        {},
        {"subdivide": 0.2, "material": True},
    ),
    "LIGHTMAP": (
        "Lightmaps",
        "One texture for each room, 32 texels for a metre, with materials that show it",
        {},
        {"target": "texture", "atlas": "room", "material": True},
    ),
    "ENGINE": (
        "Lightmaps for Engines",
        "Light without the colours of the surfaces, one texture for each object, to be multiplied with the materials",
        {},
        {"target": "texture", "quantity": "lighting", "image_format": "exr"},
    ),
    "LUX": ("Illuminance", "How much light falls on every surface, in lux, at fine quality", {"quality": "fine"}, {"quantity": "lux"}),
}
"""By identifier: name, description, and the options that differ from their defaults."""
_ITEMS = [(key, name, text) for key, (name, text, _, _) in BUILT_IN.items()]


class ENFILADE_OT_use_preset(bpy.types.Operator):
    """Set all options of the bake as this preset says"""

    bl_idname = "enfilade.use_preset"
    bl_label = "Use Preset"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    preset: bpy.props.EnumProperty(name="Preset", items=_ITEMS)

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return BUILT_IN[properties.preset][1]

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.enfilade
        scale = context.scene.unit_settings.scale_length
        _, _, solve, bake = BUILT_IN[self.preset]
        name = settings.bake.bake_name or BakeOptions().name
        write_options(settings.solve, Options(**solve), scale)
        write_options(settings.bake, dataclasses.replace(BakeOptions(**bake), name=name), scale)
        return {"FINISHED"}


class ENFILADE_OT_add_preset(AddPresetBase, bpy.types.Operator):
    """Keep the options of the bake under a name, or forget those of this name"""

    bl_idname = "enfilade.add_preset"
    bl_label = "Add Bake Preset"
    preset_menu = "ENFILADE_PT_presets"
    preset_subdir = FOLDER
    preset_defines = ("solve = bpy.context.scene.enfilade.solve", "bake = bpy.context.scene.enfilade.bake")

    @property
    def preset_values(self) -> list[str]:
        names = [f"solve.{f.name}" for f in dataclasses.fields(Options) if f.name not in ("threads", "store", "memory")]
        return names + [f"bake.{f.name}" for f in dataclasses.fields(BakeOptions) if f.name not in ("name", "image_folder")]


class ENFILADE_PT_presets(PresetPanel, bpy.types.Panel):
    """Presets of the bake."""

    bl_label = "Bake Presets"
    preset_subdir = FOLDER
    preset_operator = "script.execute_preset"
    preset_add_operator = "enfilade.add_preset"

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(align=True)
        for key, (name, *_) in BUILT_IN.items():
            column.operator("enfilade.use_preset", text=name).preset = key
        self.layout.separator()
        super().draw(context)


_CLASSES = (ENFILADE_OT_use_preset, ENFILADE_OT_add_preset, ENFILADE_PT_presets)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
