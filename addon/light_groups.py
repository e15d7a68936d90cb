# SPDX-License-Identifier: GPL-3.0-or-later
"""Which light group every lamp of a scene belongs to, by its collection or by itself."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ..core.light_groups import LightGroups
from .roles import roles


def light_groups(
    scene: bpy.types.Scene,
    groups: str,
    objects: Sequence[bpy.types.Object],
    shining: np.ndarray,
    lamps: tuple[Sequence[bpy.types.Object], Sequence[bpy.types.Object], Sequence[bpy.types.Object]],
    world_suns: int,
    sky: bool,
) -> LightGroups | None:
    """The light groups of what shines, None where nothing does or ``groups`` (as in ``BakeOptions``) asks for none.

    objects : (O,) the owner of each object of the scene to be solved, what makes an instance or the object itself;  shining : (O,) bool
    lamps : the owners of its area lamps, its points and the suns that are lamps;  world_suns : further suns, of the world
    """
    if groups == "none":
        return None
    owners = [thing for thing, lit in zip(objects, shining, strict=True) if lit] + [thing for kind in lamps for thing in kind]
    name_of = _collections(scene, owners) if groups == "collections" else {thing: thing.name for thing in owners}
    names = sorted(set(name_of.values()), key=str.casefold)
    world = -1
    if sky or world_suns:
        world = len(names)
        title = scene.world.name
        names.append(f"{title} (world)" if title in names else title)
    if not names:
        return None
    number = {name: k for k, name in enumerate(names)}
    of = [number[name_of[thing]] if lit else -1 for thing, lit in zip(objects, shining, strict=True)]
    area, points, suns = ([number[name_of[thing]] for thing in kind] for kind in lamps)
    arrays = (np.array(kind, np.int32) for kind in (of, area, points, suns + [world] * world_suns))
    return LightGroups(tuple(names), *arrays, sky=world if sky else -1)


def _collections(scene: bpy.types.Scene, things: Sequence[bpy.types.Object]) -> dict[bpy.types.Object, str]:
    """The collection of each object: of several the first that is neither a room nor the scene's own, as who made it meant it for this."""
    kinds, wanted = roles(scene), set(things)
    out: dict[bpy.types.Object, str] = {}
    everything = list(scene.collection.children_recursive)
    for collection in [c for c in everything if c not in kinds] + [c for c in everything if c in kinds] + [scene.collection]:
        for thing in collection.objects:
            if thing in wanted:
                out.setdefault(thing, collection.name)
    return out
