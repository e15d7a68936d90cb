# SPDX-License-Identifier: GPL-3.0-or-later
"""The light so far, drawn over the viewports while a bake runs; the file itself is not touched."""

from __future__ import annotations

import time
from collections.abc import Callable

from ..core.element_mesh import element_mesh
from ..core.solution import Solution
from . import overlay
from .light_layers import SolvedLight, light_content
from .overlay_layers import Content

MOST_ELEMENTS = 40_000
"""Finer elements are not drawn while the solver works."""

SHARE = 0.05
"""Largest part of the solver's time that goes into pictures of the light so far."""

PAUSE = 0.5
"""Shortest time between two of them, seconds."""


class Previews:
    """Makes drawings of the light so far, seldom enough; to be called in the solver's thread."""

    def __init__(self, metres_per_unit: float) -> None:
        self._metres_per_unit = metres_per_unit
        self._next, self._made = 0.0, None

    def look(self, so_far: Callable[[], Solution] | None) -> None:
        """Make a drawing of the light, unless it is too early for another."""
        started = time.perf_counter()
        if so_far is None or started < self._next:
            return
        mesh = element_mesh(so_far(), MOST_ELEMENTS)
        content = light_content(SolvedLight(mesh, self._metres_per_unit), "The light so far")
        took = time.perf_counter() - started
        self._next = started + took + max(PAUSE, took / SHARE)
        self._made = content

    def take(self) -> Content | None:
        """The newest drawing, once; None where there is none since the last call. May be called in another thread."""
        made, self._made = self._made, None
        return made


class PreviewWindow:
    """Shows such drawings in the place of what is drawn over the viewports, and gives that back."""

    def __init__(self) -> None:
        self._before, self._shown = overlay.content(), None

    def show(self, content: Content) -> None:
        # What the user has called up meanwhile stays.
        if overlay.content() is (self._shown or self._before):
            self._shown = content
            overlay.show(content)

    def close(self) -> None:
        if self._shown is not None and overlay.content() is self._shown:
            if self._before is None:
                overlay.hide()
            else:
                overlay.show(self._before)
        self._shown = None
