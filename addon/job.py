# SPDX-License-Identifier: GPL-3.0-or-later
"""A bake in three phases: :func:`read` (Blender to arrays), :func:`work` (arrays only), :func:`write`.

Until :func:`write` nothing in the file is changed, so a bake may be left at any time before.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..core.bake_values import Carrier
from ..core.baking import Baked, Step, Task, bake
from ..core.beside import beside
from ..core.options import BakeOptions, Options
from ..core.scene import Scene, SceneError
from . import bake_texture, bake_vertex, fine_mesh, last_light, materials, outdated
from .clear import clear
from .extract import Extraction, Receiver, extract
from .fingerprint import fingerprint
from .light_layers import SolvedLight
from .membership import everything_evaluated
from .mesh_arrays import bulk
from .preferences import on_this_machine
from .properties import read_options, write_options
from .recombine import kept_groups, settle


@dataclass(frozen=True)
class Reading:
    """What was read: the scene of the solver, the objects that will carry light, all options and warnings.

    options : as the user chose them;  solving : as they are solved with, what was left open decided
    rooms : names of the rooms whose light is wanted, empty for all;  fingerprint : of the scene as it was read
    texel_scales : of the receivers
    """

    scene_name: str
    extraction: Extraction
    receivers: tuple[Receiver, ...]
    options: Options
    solving: Options
    bake: BakeOptions
    warnings: tuple[str, ...]
    rooms: tuple[str, ...]
    fingerprint: str
    texel_scales: tuple[float, ...]


@dataclass(frozen=True)
class Written:
    """What was written: names of objects that carry the light, of images, and what the user should know."""

    objects: tuple[str, ...]
    images: tuple[str, ...]
    warnings: tuple[str, ...]


def settings(scene: bpy.types.Scene) -> tuple[Options, BakeOptions]:
    """The options saved in a scene. Raises OptionError when one is out of its range."""
    scale = scene.unit_settings.scale_length
    return read_options(scene.enfilade.solve, Options, scale), read_options(scene.enfilade.bake, BakeOptions, scale)


def read(context: bpy.types.Context, options: Options, bake: BakeOptions, rooms: Sequence[str] = ()) -> Reading:
    """Read the scene of a context; changes nothing. Raises SceneError with one sentence for what cannot be baked.

    rooms : names of the rooms that are to carry new light, all others still light them; empty for all
    """
    if bake.target == "texture" and bake.image_folder:
        _check_folder(bake.image_folder)
    extraction = extract(context, groups=bake.groups)
    warnings = list(extraction.warnings)
    receivers = []
    for receiver in _wanted(extraction, bake, rooms):
        if not receiver.in_place and bake.subdivide == 0.0:
            warnings.append(
                f"object '{receiver.name}' carries no light because its modifiers ({receiver.modified_by}) change its faces: "
                "apply them, or set subdivide to bake a copy"
            )
            continue
        _check_names(local_object(receiver.name), bake)
        receivers.append(receiver)
    if not receivers:
        raise SceneError("no object can carry the light: " + (warnings[-1] if warnings else "the scene has no mesh objects of its own"))
    made_from = fingerprint(context.scene, context.view_layer, options, bake)
    solving = on_this_machine(_suited(options, bake))
    # Properties are of single precision: 0.1 must not come back as 0.10000000149.
    scales = tuple(float(f"{local_object(receiver.name).enfilade.texel_scale:.7g}") for receiver in receivers)
    name = context.scene.name
    return Reading(name, extraction, tuple(receivers), options, solving, bake, tuple(warnings), tuple(rooms), made_from, scales)


def _wanted(extraction: Extraction, bake: BakeOptions, rooms: Sequence[str]) -> tuple[Receiver, ...]:
    """The receivers with a face in one of the ``rooms``, and all that share a texture with one of them.

    Raises SceneError for a name that no room has.
    """
    if not rooms:
        return extraction.receivers
    names, room = extraction.scene.room_names, extraction.scene.room
    unknown = [name for name in rooms if name not in names]
    if unknown:
        raise SceneError(f"there is no room '{unknown[0]}' to bake: the rooms are {', '.join(names)}")
    number = [names.index(name) for name in rooms]
    inside = [bool(np.isin(room[r.triangle_polygon[r.triangle_polygon >= 0]], number).any()) for r in extraction.receivers]
    if bake.target == "texture" and bake.atlas == "room":
        shared = {r.room for r, good in zip(extraction.receivers, inside, strict=True) if good}
        inside = [r.room in shared for r in extraction.receivers]
    return tuple(r for r, good in zip(extraction.receivers, inside, strict=True) if good)


def _suited(options: Options, bake: BakeOptions) -> Options:
    """The options with what is left to the program decided.

    Texels lie close together: the faint streaks that a limited number of rays leaves would be seen in a texture, not in vertex colours.
    """
    return replace(options, reflected="elements") if options.reflected == "auto" and bake.target == "texture" else options


def local_object(name: str) -> bpy.types.Object | None:
    """The object of this name that is not linked from a library."""
    thing = bpy.data.objects.get(name)
    return thing if thing is None or thing.library is None else bpy.data.objects.get((name, None))


def _check_folder(folder: str) -> None:
    if not os.path.isdir(folder):
        raise SceneError(f"the image folder '{folder}' does not exist: create it or choose another")
    if not os.access(folder, os.W_OK):
        raise SceneError(f"the image folder '{folder}' cannot be written to: choose another")


def _check_names(thing: bpy.types.Object, bake: BakeOptions) -> None:
    """Raise SceneError where the user's own data has the name that the bake wants, or leaves no room for it."""
    mesh = thing.data
    if bake.target == "vertex":
        if bake.name in mesh.attributes and bake.name != mesh.enfilade.attribute:
            raise SceneError(f"object '{thing.name}' has an attribute '{bake.name}' of its own: choose another name for the bake")
        return
    name = bake_texture.uv_name(bake.name)
    if name in mesh.attributes and name != mesh.enfilade.uv_map:
        raise SceneError(f"object '{thing.name}' has an attribute '{name}' of its own: choose another name for the bake")
    if len(mesh.uv_layers) - bool(mesh.enfilade.uv_map) >= 8:
        raise SceneError(f"object '{thing.name}' has eight UV maps, which is the most there can be: remove one")


def task(reading: Reading) -> Task:
    """What there is to compute, without anything of Blender."""
    pairs = zip(reading.receivers, reading.texel_scales, strict=True)
    return Task(
        reading.extraction.scene,
        reading.solving,
        reading.bake,
        tuple(_carrier(receiver, scale) for receiver, scale in pairs),
        tuple(receiver.name for receiver in reading.receivers),
        tuple(receiver.room for receiver in reading.receivers),
    )


def _carrier(receiver: Receiver, texel_scale: float) -> Carrier:
    mesh = receiver.mesh
    arrays = (mesh.position, mesh.corner_vertex, mesh.face_start, mesh.sharp, mesh.triangle, receiver.triangle_polygon, receiver.grids)
    return Carrier(*arrays, texel_scale)


def work(reading: Reading, run: Callable[[Scene, Options], Generator] | None = None) -> Generator[Step, None, Baked]:
    """Compute here; touches no Blender data. ``run`` is the solver, ``core.pipeline.run`` unless told otherwise.

    Raises SceneError for what only the solver finds; closing the generator cancels.
    """
    return bake(task(reading), run)


def work_beside(reading: Reading) -> Generator[Step, None, Baked]:
    """As :func:`work`, in a process of its own and with sketches of the light so far; for a thread that a window looks after."""
    return beside(bake, task(reading), None, True)


def solve_all(reading: Reading, progress: Callable[[Step], None] | None = None, run: Callable | None = None) -> Baked:
    """Run :func:`work` to its end."""
    steps = work(reading, run)
    while True:
        try:
            step = next(steps)
        except StopIteration as end:
            return end.value
        if progress is not None:
            progress(step)


def write(context: bpy.types.Context, reading: Reading, baked: Baked) -> Written:
    """Put the light onto the meshes, in place of an earlier bake.

    Objects that were deleted, are in edit mode or have other faces than when they were read are left alone, with a
    warning. Raises SceneError when none is left.
    """
    scene = bpy.data.scenes.get(reading.scene_name)
    if scene is None:
        raise SceneError(f"the scene '{reading.scene_name}' was deleted during the bake")
    warnings = [*reading.warnings, *baked.warnings]
    fit = [_unchanged(receiver, warnings) for receiver in reading.receivers]
    if not any(fit):
        raise SceneError("no object is as it was when the bake began: bake again")
    with kept_groups(scene, baked.groups, not reading.rooms):
        warnings += clear(scene, frozenset(receiver.name for receiver in reading.receivers) if reading.rooms else None)
    targets = _targets(context, scene, reading, baked, fit)
    if baked.pages:
        images = _write_textures(reading, baked, targets)
    else:
        images = {}
        for thing, color, parts in zip(targets, baked.colors, baked.parts, strict=True):
            if thing is not None:
                bake_vertex.write_colors(thing.data, reading.bake.name, reading.bake.domain, color)
                for group, part in zip(baked.groups, parts, strict=True):
                    bake_vertex.write_part(thing.data, group, reading.bake.domain, part)
    for thing in targets:
        if thing is not None:
            thing.data.enfilade.quantity = reading.bake.quantity
    settle(scene)
    outdated.baked(scene, reading.fingerprint, not reading.rooms)
    last_light.keep(scene, SolvedLight(baked.elements, reading.extraction.metres_per_unit) if baked.elements is not None else None)
    if reading.bake.material:
        show_materials(reading, [t.name if t is not None else None for t in targets], images)
    return Written(tuple(t.name for t in targets if t is not None), tuple(dict.fromkeys(images.values())), tuple(warnings))


def _unchanged(receiver: Receiver, warnings: list[str]) -> bool:
    thing = local_object(receiver.name)
    if thing is None or thing.type != "MESH":
        warnings.append(f"object '{receiver.name}' was deleted or renamed during the bake: it carries no light")
    elif thing.mode != "OBJECT":
        warnings.append(f"object '{receiver.name}' is not in object mode: it carries no light")
    elif receiver.in_place and not np.array_equal(bulk(thing.data.loops, "vertex_index", np.int32), receiver.mesh.corner_vertex):
        warnings.append(f"the faces of object '{receiver.name}' were changed during the bake: it carries no light")
    else:
        return True
    return False


def _targets(context, scene, reading: Reading, baked: Baked, fit: list[bool]) -> list[bpy.types.Object | None]:
    """The objects that get the light: the receivers themselves, with meshes of their own, or subdivided copies."""
    users = Counter(o.data for o in bpy.data.objects if o.type == "MESH")
    targets: list[bpy.types.Object | None] = []
    if any(fine is not None for fine in baked.fine):
        with everything_evaluated(scene, context.view_layer):
            depsgraph = context.evaluated_depsgraph_get()
            for receiver, fine, good in zip(reading.receivers, baked.fine, fit, strict=True):
                thing = local_object(receiver.name)
                made = fine_mesh.make_mesh(thing, depsgraph, fine, receiver.mesh.triangle) if good else None
                targets.append((thing, made))
        return [fine_mesh.make_copy(scene, *pair) if pair[1] is not None else None for pair in targets]
    for receiver, good in zip(reading.receivers, fit, strict=True):
        thing = local_object(receiver.name) if good else None
        if thing is not None and (users[thing.data] > 1 or thing.data.library is not None):
            shared = thing.data
            thing.enfilade.own_mesh_of = shared
            thing.data = shared.copy()
            thing.data.name = f"{shared.name} (bake)"
            thing.data.enfilade.made = True
        targets.append(thing)
    return targets


def _write_textures(reading: Reading, baked: Baked, targets: list[bpy.types.Object | None]) -> dict[str, str]:
    """Images and UV maps; returns the image of every object by their names."""
    bake, shown = reading.bake, {}
    for page, name, pixels, parts in zip(baked.pages, baked.page_names, baked.images, baked.parts, strict=True):
        if all(targets[m] is None for m in page.members):
            continue
        image = bake_texture.write_image(name, pixels, bake.image_format, bake.image_folder)
        image.enfilade.quantity = bake.quantity
        for group, part in zip(baked.groups, parts, strict=True):
            made = image.enfilade.parts.add()
            made.name = group
            made.image = bake_texture.write_image(f"{name}.{group}", part, "exr", bake.image_folder)
        for member, uv in zip(page.members, page.uv, strict=True):
            if targets[member] is not None:
                bake_texture.write_uv(targets[member].data, bake_texture.uv_name(bake.name), (uv + 0.5) / (page.width, page.height))
                targets[member].data.enfilade.image = image
                shown[targets[member].name] = image.name
    return shown


def show_materials(reading: Reading, targets: list[str | None], images: dict[str, str], open_backs: bool = False) -> None:
    """Give all targets materials that show their bake."""
    made: dict = {}
    for name in targets:
        thing = bpy.data.objects[name] if name is not None else None
        if thing is None:
            continue
        tags = thing.data.enfilade
        source = {"image": images[name], "uv_map": tags.uv_map} if name in images else {"attribute": tags.attribute}
        materials.show(thing, materials.Display(reading.bake.quantity, open_backs=open_backs, **source), made)


def remember(scene: bpy.types.Scene, reading: Reading, baked: Baked, written: Written) -> None:
    """Have the scene say how it was baked, so that the button in Blender repeats a bake that began elsewhere."""
    scale = scene.unit_settings.scale_length
    write_options(scene.enfilade.solve, reading.options, scale)
    write_options(scene.enfilade.bake, reading.bake, scale)
    scene.enfilade.summary = summary_line(reading, baked, written)


def summary_line(reading: Reading, baked: Baked, written: Written) -> str:
    """One line about a finished bake."""
    report, scene = baked.report, reading.extraction.scene
    seconds = report.get("seconds", {}).get("total")
    rooms = scene.room_count
    parts = [
        f"{rooms} room{'s' if rooms != 1 else ''}",
        f"{scene.polygon_count:,} polygons",
        f"{len(written.objects):,} objects" if len(written.objects) != 1 else "1 object",
    ]
    if "unshot_fraction" in report:
        parts.append(f"{100 * float(report['unshot_fraction']):.2g} % of the light unshot")
    if seconds is not None:
        parts.append(f"{seconds:.1f} s")
    return ", ".join(parts)
