"""Light groups as arrays of a scene file, written only where a scene has some: ``group_names``, ``group_object``, ``group_area``,
``group_points``, ``group_suns`` and ``group_sky`` (1,), the fields of :class:`LightGroups`.
"""

from __future__ import annotations

import numpy as np

from .lamp_files import Reader
from .light_groups import LightGroups

_KINDS = ("object", "area", "points", "suns")


def group_arrays(groups: LightGroups | None) -> dict[str, np.ndarray]:
    """The arrays of a file."""
    if groups is None:
        return {}
    kinds = {f"group_{name}": getattr(groups, name).astype(np.int32) for name in _KINDS}
    return kinds | {"group_names": np.array(groups.names, dtype=str), "group_sky": np.array([groups.sky], np.int32)}


def read_groups(reader: Reader) -> LightGroups | None:
    """The light groups of a file, None where it has none. Raises SceneError for arrays that are missing or of another form."""
    if "group_names" not in reader.arrays:
        return None
    kinds = {name: reader.integers(f"group_{name}", (None,)) for name in _KINDS}
    return LightGroups(reader.texts("group_names", []), **kinds, sky=int(reader.integers("group_sky", (1,))[0]))
