"""The table of the light of a building, made step by step."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

from .daylight_factor import in_per_cent, under_overcast_sky
from .light_report import RoomLight, report_of_light
from .options import Options
from .pipeline import run
from .progress import Progress
from .scene import Scene

Table = Generator[Progress, None, list[RoomLight]]


def illuminance(scene: Scene, options: Options, height: float, border: float) -> Table:
    """Rows of :func:`light_report` in lux, with the work plane at ``height`` and ``border`` metres from the walls."""
    return report_of_light((yield from _told(scene, options)), height, border)


def daylight(scene: Scene, options: Options, height: float, border: float) -> Table:
    """The same in per cent of the light outside, under the CIE overcast sky without lamps."""
    return in_per_cent(report_of_light((yield from _told(under_overcast_sky(scene), options)), height, border))


def _told(scene: Scene, options: Options):
    """A solve, with steps that can be sent to another process."""
    steps = run(scene, options)
    try:
        while True:
            try:
                yield replace(next(steps), so_far=None)
            except StopIteration as end:
                return end.value
    finally:
        steps.close()
