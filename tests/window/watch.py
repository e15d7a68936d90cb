"""Watches a Blender that is driven by mouse and keys, and touches nothing: writes what it sees into ``seen.json``.

``pauses`` are the longest times, seconds, in which the window did nothing, by what went on; ``count`` grows with every look.
"""

import json
import os
import sys
import time

import bpy

LOOK = 0.01
_state = {"count": 0, "pauses": {}, "pid": os.getpid(), "version": bpy.app.version[:2]}
_last = [time.perf_counter(), "start"]


def _module(name):
    return sys.modules.get(f"bl_ext.user_default.enfilade.addon.{name}")


def _look():
    now = time.perf_counter()
    operators, viewport, overlay = (_module(name) for name in ("operators", "viewport", "overlay"))
    step = operators.progress() if operators else None
    doing = step.stage if step is not None else "idle"
    gap = now - _last[0] - LOOK
    during = doing if doing == _last[1] else f"{_last[1]} to {doing}"  # reading is from idle to start, writing from bake to idle
    _state["pauses"][during] = max(_state["pauses"].get(during, 0.0), gap)
    _last[1] = doing
    _state["count"] += 1
    if _state["count"] % 10 == 0:
        scene = bpy.context.scene
        meshes = [o for o in scene.objects if o.type == "MESH"]
        _state.update(
            installed=hasattr(scene, "enfilade"),
            file=os.path.basename(bpy.data.filepath),
            dirty=bpy.data.is_dirty,
            fraction=step.fraction if step is not None else -1.0,
            portals=len([o for o in meshes if o.name.startswith("Portal ")]),
            rooms=len(bpy.data.collections["Rooms"].children) if "Rooms" in bpy.data.collections else 0,
            baked=sum("Enfilade" in o.data.color_attributes for o in meshes),
            summary=scene.enfilade.summary if hasattr(scene, "enfilade") else "",
            shown=bool(viewport and viewport.shown(bpy.context.window_manager)),
            overlay=overlay.content().title if overlay and overlay.content() else "",
        )
        with open("seen.json.part", "w", encoding="utf-8") as out:
            json.dump(_state, out)
        os.replace("seen.json.part", "seen.json")
    _last[0] = time.perf_counter()
    return LOOK


bpy.context.preferences.view.show_splash = False
bpy.app.timers.register(_look, persistent=True)
