# SPDX-License-Identifier: GPL-3.0-or-later
"""The buttons: bake, cancel, clear, show."""

from __future__ import annotations

import bpy

from ..core.scene import SceneError
from . import job, last_light, overlay, viewport
from .clear import clear, has_bake
from .guards import REFUSALS, capital, in_object_mode, redraw_panels, sentence
from .membership import membership
from .preview import Previews, PreviewWindow
from .worker import Worker

POLL_SECONDS = 0.1
"""How often the window looks after the solver."""

_running: ENFILADE_OT_bake | None = None


def progress() -> job.Step | None:
    """The state of the bake that runs in this window, None when there is none."""
    return _running.step if _running is not None else None


def _idle(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """True in object mode while no bake runs; otherwise the operator's poll message says why not."""
    if _running is not None:
        operator.poll_message_set("A bake is running")
        return False
    return in_object_mode(operator, context)


class ENFILADE_OT_bake(bpy.types.Operator):
    """Compute the light between all surfaces and write it onto the meshes"""

    bl_idname = "enfilade.bake"
    bl_label = "Bake"
    bl_options = {"UNDO"}  # one step to undo; not "REGISTER", whose panel would bake again at a touch

    show: bpy.props.BoolProperty(
        name="Show", description="Show the light in the viewports when it is done", default=True, options={"SKIP_SAVE"}
    )
    scope: bpy.props.EnumProperty(
        name="Rooms",
        description="Which rooms get new light; all rooms light them either way",
        items=[
            ("ALL", "All Rooms", "Bake all rooms"),
            ("SELECTED", "Rooms of Selection", "Bake the rooms of the selected objects and leave the bake of all others as it is"),
        ],
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _idle(cls, context)

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        if properties.scope == "SELECTED":
            return "Bake the rooms of the selected objects anew, lit by all rooms; all other rooms keep the bake they have"
        return cls.__doc__

    def read(self, context: bpy.types.Context) -> job.Reading:
        """Read the scene; raises what is refused."""
        rooms = rooms_of_selection(context) if self.scope == "SELECTED" else ()
        return job.read(context, *job.settings(context.scene), rooms)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Straight through, for scripts: errors are raised by Blender as RuntimeError."""
        try:
            reading = self.read(context)
            baked = job.solve_all(reading)
            self._write(context, reading, baked)
        except REFUSALS as error:
            return self._refuse(error)
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """With a window: beside it, with progress, until it is done or ESC is pressed."""
        return self.execute(context) if bpy.app.background else self.begin(context)

    def begin(self, context: bpy.types.Context) -> set[str]:
        """Read the scene, start the thread and the timer that looks after it."""
        global _running
        try:
            self._reading = self.read(context)
        except REFUSALS as error:
            return self._refuse(error)
        self.step = job.Step("start", 0.0, "")
        self.cancelled = False
        self._preview = PreviewWindow()
        self._previews = Previews(self._reading.extraction.metres_per_unit)
        self._worker = Worker(self._previews.of(job.work_beside(self._reading)))
        self._timer = context.window_manager.event_timer_add(POLL_SECONDS, window=context.window)
        context.window_manager.progress_begin(0, 100)
        context.window_manager.modal_handler_add(self)
        _running = self
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS":
            self.cancelled = True
        elif event.type != "TIMER":
            return {"PASS_THROUGH"}
        if self.cancelled:
            self._finish(context)
            self.report({"INFO"}, "Bake cancelled, nothing was changed")
            return {"CANCELLED"}
        if not self._worker.done:
            self._show_progress(context)
            return {"PASS_THROUGH"}
        self._finish(context)
        try:
            if self._worker.error is not None:
                raise self._worker.error
            self._write(context, self._reading, self._worker.result)
        except REFUSALS as error:
            return self._refuse(error)
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Called by Blender when the file or the window is closed during a bake."""
        self._finish(context)

    def _show_progress(self, context: bpy.types.Context) -> None:
        step = self._worker.latest
        if step is None or step == self.step:
            return
        self.step = step
        if (preview := self._previews.take()) is not None:
            self._preview.show(preview)
        context.window_manager.progress_update(100 * step.fraction)
        text = f"Enfilade  {100 * step.fraction:.0f} %  {capital(step.stage)}: {step.message}   {step.time_left}"
        context.workspace.status_text_set(f"{text.rstrip()}   |   ESC cancels")
        redraw_panels(context)

    def _finish(self, context: bpy.types.Context) -> None:
        """What every way out of a modal bake does."""
        global _running
        _running = None
        self._worker.cancel()
        self._preview.close()
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        redraw_panels(context)

    def _refuse(self, error: BaseException) -> set[str]:
        self.report({"ERROR"}, sentence(error))
        return {"CANCELLED"}

    def _write(self, context: bpy.types.Context, reading: job.Reading, baked: job.Baked) -> None:
        written = job.write(context, reading, baked)
        for warning in written.warnings:
            self.report({"WARNING"}, capital(warning))
        line = job.summary_line(reading, baked, written)
        bpy.data.scenes[reading.scene_name].enfilade.summary = line
        if self.show and not bpy.app.background:
            overlay.hide()  # what was drawn over the surfaces before, such as the rooms that were found, would hide the light
            viewport.restore(context)
            viewport.show(context)
        self.report({"INFO"}, f"Baked {line}")


class ENFILADE_OT_cancel(bpy.types.Operator):
    """Stop the bake; nothing is changed"""

    bl_idname = "enfilade.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if _running is None:
            cls.poll_message_set("No bake is running")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        _running.cancelled = True
        return {"FINISHED"}


class ENFILADE_OT_clear(bpy.types.Operator):
    """Remove what bakes have made: colour attributes, lightmaps, their materials, images and copies"""

    bl_idname = "enfilade.clear"
    bl_label = "Clear Bake"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not _idle(cls, context):
            return False
        if not has_bake(context.scene):
            cls.poll_message_set("There is no bake in this scene")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        for kept in clear(context.scene):
            self.report({"WARNING"}, capital(kept))
        if viewport.shown(context.window_manager):
            viewport.restore(context)
        last_light.keep(context.scene, None)
        return {"FINISHED"}


class ENFILADE_OT_show_bake(bpy.types.Operator):
    """Show the bake in the viewports, or give them their own shading back"""

    bl_idname = "enfilade.show_bake"
    bl_label = "Show Bake"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if viewport.shown(context.window_manager) or viewport.way_to_show(context.scene):
            return True
        if has_bake(context.scene):
            cls.poll_message_set("No material uses the textures: switch Material on under Output and bake again")
        else:
            cls.poll_message_set("There is no bake in this scene")
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        if viewport.shown(context.window_manager):
            viewport.restore(context)
        else:
            viewport.show(context)
        return {"FINISHED"}


def rooms_of_selection(context: bpy.types.Context) -> tuple[str, ...]:
    """Names of the rooms that the selected objects are in. Raises SceneError where they are in none."""
    found = membership(context.scene, context.view_layer)
    chosen = {thing.enfilade.carries or thing for thing in context.selected_objects}
    numbers = sorted({number for thing in chosen for number in found.rooms.get(thing, ())})
    if not numbers:
        raise SceneError("no selected object is in a room: select something in each room that is to be baked")
    return tuple(found.room_names[number] for number in numbers)


_CLASSES = (ENFILADE_OT_bake, ENFILADE_OT_cancel, ENFILADE_OT_clear, ENFILADE_OT_show_bake)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
