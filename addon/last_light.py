# SPDX-License-Identifier: GPL-3.0-or-later
"""The light of the last bake of every scene, for as long as the file is open: what false colours and errors are drawn from."""

from __future__ import annotations

import bpy

from .light_layers import SolvedLight

_kept: dict[int, SolvedLight] = {}


def keep(scene: bpy.types.Scene, light: SolvedLight | None) -> None:
    """Remember the light of a scene, or forget it."""
    _kept.pop(scene.session_uid, None)
    if light is not None:
        _kept[scene.session_uid] = light


def of(scene: bpy.types.Scene) -> SolvedLight | None:
    """The light of the last bake of a scene; None where there was none since the file was opened."""
    return _kept.get(scene.session_uid)


@bpy.app.handlers.persistent
def _before_load(*_) -> None:
    _kept.clear()


def register() -> None:
    bpy.app.handlers.load_pre.append(_before_load)


def unregister() -> None:
    bpy.app.handlers.load_pre.remove(_before_load)
    _kept.clear()
