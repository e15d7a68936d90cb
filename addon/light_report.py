# SPDX-License-Identifier: GPL-3.0-or-later
"""Illuminance and daylight factor room by room: an operator that computes a table, and the panel that shows it."""

from __future__ import annotations

import csv

import bpy

from ..core.daylight_factor import daylight_factors
from ..core.light_report import RoomLight, as_csv, report_of_light
from ..core.options import OptionError
from ..core.pipeline import solve
from ..core.scene import SceneError
from .extract import extract
from .job import settings

TEXTS = {"illuminance": "Enfilade Illuminance.csv", "daylight": "Enfilade Daylight Factor.csv"}
UNITS = {"illuminance": "lx", "daylight": "%"}


class ENFILADE_OT_light_report(bpy.types.Operator):
    """Compute the light of every room on its surfaces and on a work plane, as a table in the text editor"""

    bl_idname = "enfilade.light_report"
    bl_label = "Light Report"
    bl_options = {"REGISTER"}

    what: bpy.props.EnumProperty(
        name="Figures",
        items=(
            ("illuminance", "Illuminance", "Average, minimum, maximum and uniformity in lux"),
            ("daylight", "Daylight Factor", "The same in per cent of the light outside, under the CIE overcast sky without lamps"),
        ),
    )
    height: bpy.props.FloatProperty(name="Work Plane", description="Height over the floor", default=0.8, min=0.0, max=10.0, unit="LENGTH")
    border: bpy.props.FloatProperty(
        name="Border", description="Strip along the walls that the work plane leaves out", default=0.5, min=0.0, max=10.0, unit="LENGTH"
    )
    filepath: bpy.props.StringProperty(name="File", description="A CSV file to write too; empty: the text alone", subtype="FILE_PATH")

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            rows = self._rows(context)
            text = as_csv(rows, UNITS[self.what])
            if self.filepath:
                with open(bpy.path.abspath(self.filepath), "w", encoding="utf-8") as file:
                    file.write(text)
        except (SceneError, OptionError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        except OSError as error:
            self.report({"ERROR"}, f"the file '{self.filepath}' cannot be written ({error.strerror}): choose another")
            return {"CANCELLED"}
        name = TEXTS[self.what]
        block = bpy.data.texts.get(name) or bpy.data.texts.new(name)
        block.clear()
        block.write(text)
        self.report({"INFO"}, f"{len(rows)} rows in the text '{name}'")
        return {"FINISHED"}

    def _rows(self, context: bpy.types.Context) -> list[RoomLight]:
        scale = context.scene.unit_settings.scale_length
        scene, (options, _) = extract(context).scene, settings(context.scene)
        height, border = self.height * scale, self.border * scale
        if self.what == "daylight":
            return daylight_factors(scene, options, height, border)
        return report_of_light(solve(scene, options), height, border)


class ENFILADE_PT_light_report(bpy.types.Panel):
    """The light of every room."""

    bl_label = "Light Report"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_parent_id = "ENFILADE_PT_render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        row = layout.row(align=True)
        row.operator("enfilade.light_report", text="Illuminance").what = "illuminance"
        row.operator("enfilade.light_report", text="Daylight Factor").what = "daylight"
        for what, name in TEXTS.items():
            block = bpy.data.texts.get(name)
            if block is not None:
                self._table(layout, block, UNITS[what])

    def _table(self, layout: bpy.types.UILayout, block: bpy.types.Text, unit: str) -> None:
        grid = layout.grid_flow(row_major=True, columns=5, even_columns=False, align=True)
        for head in ("Room", "Part", f"Average ({unit})", "Minimum", "Uniformity"):
            grid.label(text=head)
        for row in rows_of(block.as_string()):
            for cell in row:
                grid.label(text=cell)


def rows_of(text: str) -> list[tuple[str, str, str, str, str]]:
    """Room, part, average, minimum and uniformity of the rows of a table, as they are written."""
    rows = list(csv.reader(text.splitlines()))[1:]
    return [(row[0], row[1], row[3], row[4], row[6]) for row in rows if len(row) == 8]


_CLASSES = (ENFILADE_OT_light_report, ENFILADE_PT_light_report)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
