# SPDX-License-Identifier: GPL-3.0-or-later
"""For scripts: the bake and all that belongs to it as plain functions on the open scene.

In a Blender with the extension::

    from bl_ext.user_default.enfilade.addon import api

and in plain Python with the packages ``bpy`` and ``enfilade``::

    from enfilade.addon import api

    bpy.ops.wm.open_mainfile(filepath="building.blend")
    done = api.bake(quality="draft", target="texture", progress=lambda step: print(step.stage, step.fraction))
    api.export_gltf("building.glb")
    bpy.ops.wm.save_as_mainfile(filepath="baked.blend")

What is refused comes as one of ``REFUSALS`` with a sentence that names the object and the remedy; nothing is changed then.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from . import job, last_light, outdated
from .clear import clear as _clear
from .export_gltf import Exported
from .export_gltf import export as _export
from .guards import REFUSALS
from .membership import membership

__all__ = ["REFUSALS", "Result", "bake", "clear", "export_gltf", "out_of_date", "rooms"]


@dataclass(frozen=True)
class Result:
    """What a bake did: names of the objects and images that carry light, warnings, the figures of the run, and a line for people."""

    objects: tuple[str, ...]
    images: tuple[str, ...]
    warnings: tuple[str, ...]
    report: dict[str, Any]
    summary: str


def bake(rooms: Sequence[str] = (), progress: Callable[[job.Step], None] | None = None, **options: Any) -> Result:
    """Bake the open scene and write the light onto its meshes.

    rooms : names of the rooms that get new light, all others light them and keep the bake that they have; empty for all
    progress : is told of every step, with ``stage``, ``fraction`` (0..1) and ``message``; an exception from it cancels the bake
    options : any of docs/options.md by name, such as ``quality="draft"``; what is not given is as the file has it, and the file
    remembers what is given. Raises TypeError for a name that is no option.
    """
    _ready()
    context, scene = bpy.context, bpy.context.scene
    solve, where = job.settings(scene)
    known = [{f.name for f in dataclasses.fields(one)} for one in (solve, where)]
    unknown = set(options) - set.union(*known)
    if unknown:
        raise TypeError(f"there is no option '{sorted(unknown)[0]}': see docs/options.md")
    solve = dataclasses.replace(solve, **{k: v for k, v in options.items() if k in known[0]})
    where = dataclasses.replace(where, **{k: v for k, v in options.items() if k in known[1]})
    reading = job.read(context, solve, where, tuple(rooms))
    baked = job.solve_all(reading, progress)
    written = job.write(context, reading, baked)
    job.remember(scene, reading, baked, written)
    return Result(written.objects, written.images, written.warnings, baked.report, scene.enfilade.summary)


def clear() -> list[str]:
    """Remove what bakes have made from the open scene; returns what was kept and why."""
    _ready()
    last_light.keep(bpy.context.scene, None)
    return _clear(bpy.context.scene)


def rooms() -> tuple[str, ...]:
    """Names of the rooms of the open scene; one that is named like the scene where no collections say otherwise."""
    _ready()
    return membership(bpy.context.scene, bpy.context.view_layer).room_names


def out_of_date() -> bool:
    """True where the scene or its options have changed since its bake; False also where there is no bake."""
    _ready()
    return outdated.look(bpy.context.scene, bpy.context.view_layer)


def export_gltf(path: str | Path, exposure: float = 0.0, double_sided: bool = False) -> Exported:
    """Write the baked meshes into a .glb file; see :func:`enfilade.addon.export_gltf.export`."""
    _ready()
    return _export(bpy.context, path, exposure, double_sided)


def _ready() -> None:
    """Where nobody has enabled the extension its properties are missing. Meshes in edit mode could not be written."""
    if not hasattr(bpy.types.Scene, "enfilade"):
        from . import register

        register()
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
