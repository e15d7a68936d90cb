"""Do the light groups of a scene hold all that shines?"""

from __future__ import annotations

import numpy as np

from .light_groups import MOST
from .scene import Scene, SceneError


def refuse_wrong_groups(scene: Scene) -> None:
    """Raise :class:`SceneError` with one sentence where the groups do not fit the scene, or leave out what shines."""
    groups, lamps = scene.groups, scene.lamps
    if groups is None:
        return
    if not 1 <= len(groups) <= MOST:
        remedy = "group lamps by collection, and put them together into fewer collections"
        raise SceneError(f"the scene has {len(groups)} light groups where 1 to {MOST} can be kept apart: {remedy}")
    shining = np.zeros(len(scene.object_names), bool)
    shining[scene.object[(scene.emission > 0).any(1)]] = True
    kinds = (
        ("object", groups.object, scene.object_names, shining),
        ("area", groups.area, lamps.area.names, np.ones(len(lamps.area), bool)),
        ("points", groups.points, lamps.points.names, np.ones(len(lamps.points), bool)),
        ("suns", groups.suns, lamps.suns.names, np.ones(len(lamps.suns), bool)),
        ("sky", np.array([groups.sky]), (lamps.sky.name if lamps.sky is not None else "",), np.array([lamps.sky is not None])),
    )
    for kind, group, names, shines in kinds:
        if len(group) != len(names):
            raise SceneError(f"the light groups have {len(group)} entries of kind {kind} where the scene has {len(names)}")
        if ((group < -1) | (group >= len(groups))).any():
            raise SceneError(f"the light groups of kind {kind} hold an index that is no group")
        alone = np.flatnonzero(shines & (group < 0))
        if len(alone):
            raise SceneError(f"'{names[alone[0]]}' shines but is in no light group: put it into one")
