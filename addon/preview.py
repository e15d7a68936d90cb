# SPDX-License-Identifier: GPL-3.0-or-later
"""The light so far, drawn over the viewports while a bake runs; the file itself is not touched."""

from __future__ import annotations

from collections.abc import Generator

from ..core.baking import Baked, Step
from . import overlay
from .light_layers import SolvedLight, light_content
from .overlay_layers import Content


class Previews:
    """Makes drawings of the sketches that come with the steps of a bake."""

    def __init__(self, metres_per_unit: float) -> None:
        self._metres_per_unit = metres_per_unit
        self._made: Content | None = None

    def of(self, steps: Generator[Step, None, Baked]) -> Generator[Step, None, Baked]:
        """The steps as they are, looked at on their way; for the thread that asks for them."""
        try:
            while True:
                step = next(steps)
                if step.sketch is not None:
                    self._made = light_content(SolvedLight(step.sketch, self._metres_per_unit), "The light so far")
                yield step
        except StopIteration as end:
            return end.value
        finally:
            steps.close()

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
