# SPDX-License-Identifier: GPL-3.0-or-later
"""Illuminance and daylight factor room by room: an operator that computes a table, and the panel that shows it."""

from __future__ import annotations

import csv
from dataclasses import replace

import bpy

from ..core.beside import beside
from ..core.light_report import RoomLight, as_csv
from ..core.light_tables import daylight, illuminance
from ..core.progress import words
from .extract import extract
from .guards import REFUSALS, capital, in_object_mode, sentence
from .job import settings
from .preferences import on_this_machine
from .worker import Worker

POLL_SECONDS = 0.1
"""How often the window looks after the solver."""
TABLES = {"illuminance": illuminance, "daylight": daylight}
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

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return in_object_mode(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Straight through, for scripts."""
        try:
            steps = TABLES[self.what](*self._task(context))
            while True:
                next(steps)
        except StopIteration as end:
            return self._write(end.value)
        except REFUSALS as error:
            return self._refuse(error)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """With a window: beside it, until it is done or ESC is pressed."""
        return self.execute(context) if bpy.app.background else self.begin(context)

    def begin(self, context: bpy.types.Context) -> set[str]:
        """Read the scene, start the thread and the timer that looks after it."""
        try:
            self._worker = Worker(beside(TABLES[self.what], *self._task(context)))
        except REFUSALS as error:
            return self._refuse(error)
        self._timer = context.window_manager.event_timer_add(POLL_SECONDS, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show how far it is, until it is done or ESC is pressed."""
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"INFO"}, "Light report cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER" or not self._worker.done:
            self._show_progress(context)
            return {"PASS_THROUGH"}
        self.cancel(context)
        error = self._worker.error
        if isinstance(error, REFUSALS):
            return self._refuse(error)
        if error is not None:
            raise error
        return self._write(self._worker.result)

    def cancel(self, context: bpy.types.Context) -> None:
        """What every way out does; also called by Blender when the file or the window is closed."""
        self._worker.cancel()
        context.window_manager.event_timer_remove(self._timer)
        if context.workspace is not None:
            context.workspace.status_text_set(None)

    def _task(self, context: bpy.types.Context) -> tuple:
        scale = context.scene.unit_settings.scale_length
        # The cache folder is the bake's: it holds one run.
        options = replace(on_this_machine(settings(context.scene)[0]), store="")
        return extract(context).scene, options, self.height * scale, self.border * scale

    def _show_progress(self, context: bpy.types.Context) -> None:
        step = self._worker.latest
        if step is not None and context.workspace is not None:
            left = "" if step.remaining is None else words(step.remaining)
            text = f"Light report  {100 * step.fraction:.0f} %  {capital(step.stage)}: {step.message}   {left}"
            context.workspace.status_text_set(f"{text.rstrip()}   |   ESC cancels")

    def _refuse(self, error: BaseException) -> set[str]:
        self.report({"ERROR"}, sentence(error))
        return {"CANCELLED"}

    def _write(self, rows: list[RoomLight]) -> set[str]:
        text, name = as_csv(rows, UNITS[self.what]), TEXTS[self.what]
        block = bpy.data.texts.get(name) or bpy.data.texts.new(name)
        block.clear()
        block.write(text)
        if self.filepath:
            try:
                with open(bpy.path.abspath(self.filepath), "w", encoding="utf-8") as file:
                    file.write(text)
            except OSError as error:
                self.report({"ERROR"}, f"the file '{self.filepath}' cannot be written ({error.strerror}): the text '{name}' has the table")
                return {"CANCELLED"}
        self.report({"INFO"}, f"{len(rows)} rows in the text '{name}'")
        return {"FINISHED"}


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
