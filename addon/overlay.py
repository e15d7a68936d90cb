# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws over the 3D viewports and takes it away again; nothing in the file is touched."""

from __future__ import annotations

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

from .overlay_layers import Content, Layer, Scale

TOWARDS_EYE = 5e-4
"""Part of its distance by which a drawing comes closer than the surface that it lies on; lines come three times as much closer."""

_content: Content | None = None
_shown_by = ""
_handles: list = []
_batches: dict[int, tuple] = {}


def content() -> Content | None:
    """What is drawn now."""
    return _content


def shown_by() -> str:
    """The button that had drawn what is drawn now, as ``enfilade.show_clusters``; empty where nothing is, or no button had."""
    return _shown_by if _content is not None else ""


def show(new: Content, by: str = "") -> None:
    """Draw this in all viewports, in the place of what was drawn before; ``by`` is the button that asks for it."""
    global _content, _shown_by
    hide()
    _content, _shown_by = new, by
    if not bpy.app.background:
        space = bpy.types.SpaceView3D
        _handles.append(space.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW"))
        _handles.append(space.draw_handler_add(_draw_legend, (), "WINDOW", "POST_PIXEL"))
    redraw()


def hide() -> None:
    """Draw nothing."""
    global _content
    _content = None
    _batches.clear()
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    redraw()


def redraw() -> None:
    """Have the viewports drawn again."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _draw() -> None:
    context = bpy.context
    if _content is None or context.space_data is None or not context.space_data.overlay.show_overlays:
        return
    settings, region, eye = context.window_manager.enfilade_overlay, context.region, context.region_data
    if settings.in_front:
        gpu.state.active_framebuffer_get().clear(depth=1.0)
    gpu.state.blend_set("ALPHA")
    try:
        with gpu.matrix.push_pop():
            for layer in _content.layers:
                if getattr(settings, layer.part, True) and len(layer.position):
                    gpu.matrix.load_matrix(_nearer(eye, TOWARDS_EYE * (3 if layer.lines else 1)) @ eye.view_matrix)
                    _draw_layer(layer, region)
    finally:
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)
        gpu.state.face_culling_set("NONE")
        gpu.state.blend_set("NONE")


def _nearer(eye: bpy.types.RegionView3D, part: float) -> Matrix:
    """Brings what is drawn closer by a part of its distance: lines on faces, and faces on surfaces, would flicker otherwise."""
    return Matrix.Scale(1.0 - part, 4) if eye.is_perspective else Matrix.Translation((0.0, 0.0, part * eye.view_distance))


def _draw_layer(layer: Layer, region: bpy.types.Region) -> None:
    shader, batch = _batch(layer)
    solid = not layer.lines and layer.part != "volumes"
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(solid)
    # Seen from outside a room, its walls would hide what is in it.
    gpu.state.face_culling_set("BACK" if solid else "NONE")
    shader.bind()
    if layer.lines:
        shader.uniform_float("viewportSize", (region.width, region.height))
        shader.uniform_float("lineWidth", layer.width * bpy.context.preferences.system.ui_scale)
    batch.draw(shader)


def _batch(layer: Layer) -> tuple:
    if id(layer) not in _batches:
        shader = gpu.shader.from_builtin("POLYLINE_FLAT_COLOR" if layer.lines else "SMOOTH_COLOR" if layer.smooth else "FLAT_COLOR")
        data = {"pos": layer.position, "color": layer.color}
        _batches[id(layer)] = (shader, batch_for_shader(shader, "LINES" if layer.lines else "TRIS", data))
    return _batches[id(layer)]


def _draw_legend() -> None:
    context = bpy.context
    if _content is None or context.space_data is None or not context.space_data.overlay.show_overlays:
        return
    scale = context.preferences.system.ui_scale
    x = 16 * scale + sum(r.width for r in context.area.regions if r.type == "TOOLS")
    # Blender's own box with the last operator lies in the same corner.
    y, step = 18 * scale + sum(r.height for r in context.area.regions if r.type == "HUD" and r.height > 1), 20 * scale
    blf.size(0, 12 * scale)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 5, 0.0, 0.0, 0.0, 0.8)
    if _content.scale is not None:
        y = _draw_scale(x, y, scale, _content.scale) + 18 * scale  # clear of the uppermost number
    for color, text in reversed(_content.legend):
        if color is not None:
            _swatch(x, y - 2 * scale, (13 * scale, 13 * scale), color)
        _write(x + (22 * scale if color is not None else 0), y, text)
        y += step
    _write(x, y + 2 * scale, _content.title)
    blf.disable(0, blf.SHADOW)


def _draw_scale(x: float, y: float, unit: float, scale: Scale) -> float:
    """A bar that stands at (x, y), pixels, with its numbers at the right; returns where it ends above."""
    width, height, count = 16 * unit, 200 * unit, len(scale.colors)
    place = y + height * np.arange(count + 1) / count
    low, high = place[:-1], place[1:]
    left, right, flat = np.full(count, x), np.full(count, x + width), np.zeros(count)
    corners = np.stack([np.stack(c, 1) for c in ((left, low, flat), (right, low, flat), (right, high, flat), (left, high, flat))], axis=1)
    position = corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.float32)
    color = np.repeat(np.column_stack([scale.colors, np.ones(count)]), 6, axis=0).astype(np.float32)
    shader = gpu.shader.from_builtin("FLAT_COLOR")
    shader.bind()
    batch_for_shader(shader, "TRIS", {"pos": position, "color": color}).draw(shader)
    for at, text in scale.ticks:
        _swatch(x + width, y + at * height - 0.5 * unit, (5 * unit, max(unit, 1.0)), (1.0, 1.0, 1.0))
        _write(x + width + 10 * unit, y + at * height - 4 * unit, text)
    return y + height


def _write(x: float, y: float, text: str) -> None:
    blf.color(0, 1.0, 1.0, 1.0, 1.0)
    blf.position(0, x, y, 0.0)
    blf.draw(0, text)


def _swatch(x: float, y: float, size: tuple[float, float], color: tuple[float, float, float]) -> None:
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    right, top = x + size[0], y + size[1]
    corners = [(x, y), (right, y), (right, top), (x, y), (right, top), (x, top)]
    shader.bind()
    shader.uniform_float("color", (*color, 1.0))
    batch_for_shader(shader, "TRIS", {"pos": [(a, b, 0.0) for a, b in corners]}).draw(shader)


@bpy.app.handlers.persistent
def _before_load(*_) -> None:
    """The drawing of one file means nothing in another."""
    hide()


def register() -> None:
    bpy.app.handlers.load_pre.append(_before_load)


def unregister() -> None:
    hide()
    bpy.app.handlers.load_pre.remove(_before_load)
