# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the bake of a scene is still that of the scene: looked into a moment after something was changed, bit by bit."""

from __future__ import annotations

import time
from collections.abc import Generator

import bpy

from ..core.options import BakeOptions, OptionError, Options
from .fingerprint import fingerprinting
from .properties import read_options

CALM = 0.4
"""Seconds without a change after which is looked."""

SLICE = 0.05
"""Longest time at once, seconds."""

_found: dict[int, bool] = {}
"""By scene: what was found when it was last looked."""
_looking: Generator[None, None, bool] | None = None
_scene = 0


def outdated(scene: bpy.types.Scene) -> bool:
    """What is known without looking: the bake is not that of the scene. False where there is no bake."""
    return bool(scene.enfilade.baked_from) and _found.get(scene.session_uid, False)


def look(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> bool:
    """Look at once and say what :func:`outdated` says."""
    steps = _steps(scene, view_layer)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            _found[scene.session_uid] = end.value
            return outdated(scene)


def _steps(scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer) -> Generator[None, None, bool]:
    """Look bit by bit; returns whether the bake is not that of the scene."""
    scale = scene.unit_settings.scale_length
    try:
        options = read_options(scene.enfilade.solve, Options, scale), read_options(scene.enfilade.bake, BakeOptions, scale)
    except OptionError:
        return True
    found = yield from fingerprinting(scene, view_layer, *options)
    return found != scene.enfilade.baked_from


def baked(scene: bpy.types.Scene, made_from: str, everything: bool) -> None:
    """Remember what a bake was made from. A bake of some rooms leaves the others as old as they were."""
    if everything or scene.enfilade.baked_from == "":
        scene.enfilade.baked_from = made_from
    _found.pop(scene.session_uid, None)
    _soon()


def _soon() -> None:
    """Look when nothing has changed for a moment; a look that is under way begins anew."""
    global _looking
    _looking = None
    if bpy.app.background:
        return
    if bpy.app.timers.is_registered(_look_on):
        bpy.app.timers.unregister(_look_on)
    bpy.app.timers.register(_look_on, first_interval=CALM)


def _look_on() -> float | None:
    """One slice of looking; returns when to go on, None at the end."""
    global _looking, _scene
    scene, view_layer = bpy.context.scene, bpy.context.view_layer
    if scene is None or not scene.enfilade.baked_from:
        return None
    if _looking is None or _scene != scene.session_uid:
        _looking, _scene = _steps(scene, view_layer), scene.session_uid
    until = time.perf_counter() + SLICE
    try:
        next(_looking)
        while time.perf_counter() < until:
            next(_looking)
    except StopIteration as end:
        _looking = None
        if end.value != _found.get(scene.session_uid, False):
            _redraw()
        _found[scene.session_uid] = end.value
        return None
    except ReferenceError:  # something was removed: its own notice starts anew
        _looking = None
        return None
    return 0.01


def _redraw() -> None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("PROPERTIES", "VIEW_3D"):
                for region in area.regions:
                    if region.type in ("WINDOW", "UI") and (area.type, region.type) != ("VIEW_3D", "WINDOW"):
                        region.tag_redraw()


@bpy.app.handlers.persistent
def _after_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if scene.enfilade.baked_from and (len(depsgraph.updates) or depsgraph.id_type_updated("SCENE")):
        _soon()


@bpy.app.handlers.persistent
def _after_load(*_) -> None:
    global _looking
    _looking = None  # it holds objects of the file that was open
    _found.clear()
    if any(scene.enfilade.baked_from for scene in bpy.data.scenes):
        _soon()


_HANDLERS = (("depsgraph_update_post", _after_change), ("load_post", _after_load), ("undo_post", _after_load), ("redo_post", _after_load))


def register() -> None:
    for name, function in _HANDLERS:
        getattr(bpy.app.handlers, name).append(function)


def unregister() -> None:
    global _looking
    for name, function in _HANDLERS:
        getattr(bpy.app.handlers, name).remove(function)
    if bpy.app.timers.is_registered(_look_on):
        bpy.app.timers.unregister(_look_on)
    _looking = None
    _found.clear()
