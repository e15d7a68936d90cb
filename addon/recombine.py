# SPDX-License-Identifier: GPL-3.0-or-later
"""The light groups of a bake after it: dimmed and coloured by their sliders, they are added up anew, and nothing is solved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy

from . import bake_texture, bake_vertex

_shown: dict[int, dict[str, tuple[float, ...]]] = {}
"""By scene: the factors of its groups that its images show. Undo takes the sliders back, but not the pixels of images."""


UNTOUCHED = 1.0, (1.0, 1.0, 1.0)
"""Strength and colour of a light group as it was baked."""


def factors_of(scene: bpy.types.Scene) -> dict[str, tuple[float, ...]]:
    """Strength times colour of every light group of a scene, by its name."""
    return {group.name: tuple(group.strength * channel for channel in group.color) for group in scene.enfilade.groups}


@contextmanager
def kept_groups(scene: bpy.types.Scene, names: Sequence[str], everything: bool) -> Iterator[None]:
    """Afterwards a scene lists the light groups of a new bake, whatever happens to its list within; known ones keep their sliders.

    everything : the bake is of all rooms: groups that it does not have are gone
    """
    groups = scene.enfilade.groups
    known = {group.name: (group.strength, tuple(group.color)) for group in groups}
    yield
    groups.clear()
    for name in [*names, *(name for name in known if not everything and name not in names)]:
        made = groups.add()
        made.name = name
        strength, color = known.get(name, UNTOUCHED)
        if (strength, color) != UNTOUCHED:
            made.strength, made.color = strength, color


def recombine(scene: bpy.types.Scene) -> None:
    """Add up the light groups of all that carries a bake, each with its strength and colour."""
    factors = factors_of(scene)
    for mesh in {thing.data: None for thing in scene.objects if thing.type == "MESH" and thing.library is None}:
        bake_vertex.recombine(mesh, factors)
    _recombine_images(scene)


def settle(scene: bpy.types.Scene) -> None:
    """Have what a new bake has written, as it was solved, follow the sliders."""
    if all(factor == UNTOUCHED[1] for factor in factors_of(scene).values()):
        _shown[scene.session_uid] = factors_of(scene)
    else:
        recombine(scene)


def _recombine_images(scene: bpy.types.Scene) -> None:
    factors = factors_of(scene)
    for image in _images(scene):
        bake_texture.recombine(image, factors)
    _shown[scene.session_uid] = factors


def _images(scene: bpy.types.Scene) -> list[bpy.types.Image]:
    """The lightmaps of a scene that have light groups."""
    found = (thing.data.enfilade.image for thing in scene.objects if thing.type == "MESH")
    return [image for image in dict.fromkeys(found) if image is not None and len(image.enfilade.parts)]


@bpy.app.handlers.persistent
def _after_undo(*_) -> None:
    for scene in bpy.data.scenes:
        if len(scene.enfilade.groups) and _shown.get(scene.session_uid) != factors_of(scene):
            _recombine_images(scene)


@bpy.app.handlers.persistent
def _before_save(*_) -> None:
    for image in bpy.data.images:
        if image.enfilade.made and len(image.enfilade.parts) and image.is_dirty:
            bake_texture.keep(image)


@bpy.app.handlers.persistent
def _after_load(*_) -> None:
    _shown.clear()
    for scene in bpy.data.scenes:
        _shown[scene.session_uid] = factors_of(scene)


_HANDLERS = (("undo_post", _after_undo), ("redo_post", _after_undo), ("save_pre", _before_save), ("load_post", _after_load))


def register() -> None:
    for name, function in _HANDLERS:
        getattr(bpy.app.handlers, name).append(function)


def unregister() -> None:
    for name, function in _HANDLERS:
        getattr(bpy.app.handlers, name).remove(function)
    _shown.clear()
