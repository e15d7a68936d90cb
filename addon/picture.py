# SPDX-License-Identifier: GPL-3.0-or-later
"""A rendered picture of a bake, made without a window and without a graphics card."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from . import job, materials

SAMPLES = 24
"""Most samples of a pixel; nothing is left to chance but where edges run through it, and only there all of them are taken."""

SIZE = (1280, 960)
"""Of a picture whose view was chosen here."""

BACKDROP = (0.012, 0.014, 0.018, 1.0)
"""Linear colour behind a building that is seen from above."""

MIDDLE = 0.32
"""The bright half of the building is shown at about this part of white."""


def render(context: bpy.types.Context, reading: job.Reading, baked: job.Baked, written: job.Written, path: Path) -> None:
    """Render the bake by Cycles as it is seen by the scene's camera, or from above by one that goes when it is done.

    Raises OSError when the file cannot be written. The scene is left as it was.
    """
    scene = bpy.data.scenes[reading.scene_name]
    own_view = scene.camera is not None
    with _kept(scene), _shown(reading, baked, written, open_backs=not own_view):
        extra = [] if own_view else _overview(scene, written)
        try:
            _set_up(scene, own_view)
            if scene.view_settings.exposure == 0.0:
                scene.view_settings.exposure = exposure(reading, baked)
            part = path.with_name(f".{path.stem}.{os.getpid()}.png")
            scene.render.filepath = str(part)
            try:
                bpy.ops.render.render(write_still=True, scene=scene.name)
                if not part.exists():
                    raise OSError(f"{path}: the picture could not be rendered")
                os.replace(part, path)
            finally:
                part.unlink(missing_ok=True)
        finally:
            for restore in extra:
                restore()


def exposure(reading: job.Reading, baked: job.Baked) -> float:
    """Stops that bring the bright half of the values to a fit place of the display's range."""
    if reading.bake.quantity == "lux":
        return 0.0
    values = np.concatenate([v.reshape(-1, 4)[:, :3].mean(axis=1) for v in (*baked.colors, *baked.images)])
    values = values[values > 0]
    if len(values) == 0:
        return 0.0
    return float(np.clip(math.log2(MIDDLE / float(np.quantile(values, 0.7))), -10.0, 10.0))


def _set_up(scene: bpy.types.Scene, own_view: bool) -> None:
    render = scene.render
    if "CYCLES" not in {item.identifier for item in render.bl_rna.properties["engine"].enum_items} | {render.engine}:
        import addon_utils

        addon_utils.enable("cycles")
    render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.use_denoising = "CPU", SAMPLES, False
    cycles.use_adaptive_sampling, cycles.adaptive_threshold, cycles.adaptive_min_samples = True, 0.05, 6
    cycles.max_bounces, cycles.transparent_max_bounces = 0, 64
    render.use_stamp_filename = False  # a picture that is passed on must not tell where its file lies
    render.use_border = render.use_compositing = render.use_sequencer = False
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "IMAGE"
    render.image_settings.file_format, render.image_settings.color_mode, render.image_settings.color_depth = "PNG", "RGB", "8"
    if not own_view:
        render.resolution_x, render.resolution_y, render.resolution_percentage = *SIZE, 100
        scene.view_settings.view_transform = "AgX"


@contextmanager
def _shown(reading: job.Reading, baked: job.Baked, written: job.Written, open_backs: bool) -> Iterator[None]:
    """Within, the baked objects have materials that show the bake; those that were asked for stay afterwards."""
    if reading.bake.material:
        yield
        return
    images = {}
    names = {receiver.name: k for k, receiver in enumerate(reading.receivers)}
    for page, image in zip(baked.pages, written.images, strict=True):
        for member in page.members:
            images[reading.receivers[member].name] = image
    shown = {}
    for name in written.objects:
        source = bpy.data.objects[name].enfilade.carries
        shown[name] = source.name if source is not None else name
    try:
        job.show_materials(
            reading, [n for n in written.objects if shown[n] in names], {n: images[s] for n, s in shown.items() if s in images}, open_backs
        )
        yield
    finally:
        for name in written.objects:
            materials.hide(bpy.data.objects[name])
        for material in [m for m in bpy.data.materials if m.enfilade.made and m.users == 0]:
            bpy.data.materials.remove(material)


_CHANGED = {
    "render": (
        *("engine", "filepath", "resolution_x", "resolution_y", "resolution_percentage"),
        *("use_border", "use_compositing", "use_sequencer"),
    ),
    "render.image_settings": ("media_type", "file_format", "color_mode", "color_depth"),
    "view_settings": ("view_transform", "look", "exposure"),
    "cycles": (
        *("device", "samples", "use_denoising", "use_adaptive_sampling", "adaptive_threshold", "adaptive_min_samples"),
        *("max_bounces", "transparent_max_bounces"),
    ),
}
"""All that a render here changes, by the place in the scene; each place is looked up anew, for references go stale."""


def _place(scene: bpy.types.Scene, path: str) -> object | None:
    found = scene
    for name in path.split("."):
        found = getattr(found, name, None)
    return found


@contextmanager
def _kept(scene: bpy.types.Scene) -> Iterator[None]:
    """Afterwards the settings of renders are as they were."""
    before = [
        (path, name, getattr(_place(scene, path), name))
        for path, names in _CHANGED.items()
        for name in names
        if hasattr(_place(scene, path), name)
    ]
    camera = scene.camera
    try:
        yield
    finally:
        scene.camera = camera
        for path, name, value in before:
            setattr(_place(scene, path), name, value)


def _overview(scene: bpy.types.Scene, written: job.Written) -> list:
    """A camera above the building, looking in from a corner; what lies like a lid on it is hidden from the camera.

    Returns functions that undo all.
    """
    things = [bpy.data.objects[name] for name in written.objects]
    boxes = np.array([[thing.matrix_world @ Vector(c) for c in thing.bound_box] for thing in things])
    low, high = boxes.min(axis=(0, 1)), boxes.max(axis=(0, 1))
    undo = []
    footprint = np.prod((high - low)[:2])
    for thing, box in zip(things, boxes, strict=True):
        size = np.ptp(box, axis=0)
        if thing.visible_camera and box[:, 2].min() > 0.5 * (low + high)[2] and size[0] * size[1] > 0.05 * footprint:
            thing.visible_camera = False
            undo.append(lambda thing=thing: setattr(thing, "visible_camera", True))
    data = bpy.data.cameras.new("Overview")
    data.lens = 50.0
    camera = bpy.data.objects.new("Overview", data)
    scene.collection.objects.link(camera)
    back = Vector((-0.35, -0.62, 1.0)).normalized()
    camera.rotation_euler = (-back).to_track_quat("-Z", "Y").to_euler()
    turn = np.array(camera.rotation_euler.to_matrix())
    corners = boxes.reshape(-1, 3) @ turn
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    corners -= middle
    half = np.array([18.0 / data.lens, 18.0 / data.lens * SIZE[1] / SIZE[0]]) * 0.94
    distance = (np.abs(corners[:, :2]) / half + corners[:, 2:]).max()
    camera.location = Vector(turn @ middle) + back * float(distance)
    data.clip_start, data.clip_end = 0.01 * float(distance), 10.0 * float(distance)
    scene.camera = camera
    sky, world = scene.world, _backdrop()
    scene.world = world

    def remove() -> None:
        scene.camera = None
        scene.world = sky
        bpy.data.worlds.remove(world)
        bpy.data.objects.remove(camera)
        bpy.data.cameras.remove(data)

    return [remove, *undo]


def _backdrop() -> bpy.types.World:
    """A dark world that the building stands out from, its unlit parts too."""
    world = bpy.data.worlds.new("Overview")
    if world.node_tree is None:
        world.use_nodes = True
    for node in world.node_tree.nodes:
        if node.type == "BACKGROUND":
            node.inputs["Color"].default_value = BACKDROP
    return world
