"""Measures how long a Blender window does nothing while it bakes, and how long merely to draw it takes.

``blender --window-geometry 0 0 700 450 FILE.blend --python pauses.py`` with the extension enabled: redraws the whole window for some
seconds, bakes, prints the longest pauses by what went on, seconds, and quits. Where there is no graphics card, drawing takes most of
every pause: the small window keeps that short, and ``drawing`` says what is left of it.
"""

import json
import os
import sys
import time

import bpy

LOOK, WARM_UP, DRAWING = 0.01, 4.0, 4.0
_longest = {}
_now = {"what": "warm-up", "since": time.perf_counter(), "last": time.perf_counter(), "stage": "drawing"}


def _step():
    operators = sys.modules.get("bl_ext.user_default.enfilade.addon.operators")
    return operators.progress() if operators else None


def _go_on(what):
    _now.update(what=what, since=time.perf_counter())


def _bake():
    window = bpy.context.window_manager.windows[0]
    area = next(a for a in window.screen.areas if a.type == "VIEW_3D")
    with bpy.context.temp_override(window=window, area=area, region=next(r for r in area.regions if r.type == "WINDOW")):
        bpy.ops.enfilade.bake("INVOKE_DEFAULT")
    _go_on("bake")


def _look():
    now, step = time.perf_counter(), _step()
    stage = _now["what"] if _now["what"] != "bake" else step.stage if step is not None else "idle"
    during = stage if stage == _now["stage"] else f"{_now['stage']} to {stage}"
    if _now["what"] != "warm-up":
        _longest[during] = max(_longest.get(during, 0.0), now - _now["last"] - LOOK)
    _now["stage"] = stage
    passed = now - _now["since"]
    if _now["what"] == "warm-up" and passed > WARM_UP:
        _go_on("drawing")
    elif _now["what"] == "drawing":
        for area in bpy.context.window_manager.windows[0].screen.areas:
            area.tag_redraw()
        if passed > DRAWING:
            _bake()
    elif _now["what"] == "bake" and step is None:
        summary = bpy.context.scene.enfilade.summary
        print(json.dumps({"pauses": {k: round(v, 3) for k, v in _longest.items()}, "summary": summary}), flush=True)
        os._exit(0)  # an orderly end would ask what is to become of the file
    _now["last"] = time.perf_counter()
    return LOOK


bpy.context.preferences.view.show_splash = False
bpy.app.timers.register(_look, persistent=True)
