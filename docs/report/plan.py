"""What the report runs: every scene with Enfilade at its qualities and with Cycles at several numbers of samples."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass

QUALITIES = ("draft", "good", "fine")
LEVELS = (0.05, 0.02, 0.01)
"""Relative errors whose times are compared."""

WAYS = {"points": "irradiance at the points", "vertices": "vertex colours", "texels": "light map", "denoised": "light map, denoised"}
"""Ways of Cycles to the light at the points, in words."""

# Longest edge (m) of meshes for vertex colours; texels per metre: what a user would choose for such a scene.
_FINENESS = {"vertices": 0.35, "texels": {"cornell": 12, "two_rooms": 30, "office": 20, "furnace": 30, "hard": 20}}

_SAMPLES = {
    "cornell": {"points": (64, 256, 1024, 4096), "vertices": (16, 64, 256), "texels": (4, 16, 64, 256)},
    "two_rooms": {"points": (64, 256, 1024, 4096), "vertices": (16, 64, 256), "texels": (4, 16, 64)},
    "office": {"points": (64, 256, 1024), "vertices": (4, 16), "texels": (4, 16)},
    "building": {"points": (64, 256, 1024)},
    "furnace": {"points": (16, 64, 256)},
    "hard": {"points": (64, 256, 1024), "vertices": (16, 64), "texels": (4, 16)},
}
_QUICK = {
    "cornell": {"points": (64, 256), "vertices": (16,), "texels": (4, 16)},
    "two_rooms": {"points": (64, 256), "texels": (4,)},
}


@dataclass(frozen=True)
class Setting:
    """One thing to run. tool is ``enfilade`` or ``cycles``; the other fields are those of the tool, else empty."""

    scene: str
    tool: str
    quality: str = ""
    way: str = ""
    samples: int = 0
    fineness: float = 0.0

    @property
    def key(self) -> str:
        return " ".join(str(value) for value in asdict(self).values() if value)


def settings(quick: bool, scenes: Iterable[str] = (), tools: Iterable[str] = ()) -> list[Setting]:
    """All settings, scene after scene, or those of some scenes and tools; ``quick``: a few minutes' worth of them."""
    chosen = _QUICK if quick else _SAMPLES
    out = []
    for scene in [s for s in chosen if not scenes or s in scenes]:
        # A large building at the finest quality would take hours and much memory, on either side.
        qualities = QUALITIES[:2] if quick or scene == "building" else QUALITIES
        out += [Setting(scene, "enfilade", quality=quality) for quality in qualities]
        for way, counts in chosen[scene].items():
            fineness = {"points": 0.0, "vertices": _FINENESS["vertices"], "texels": _FINENESS["texels"].get(scene, 0)}[way]
            out += [Setting(scene, "cycles", way=way, samples=n, fineness=fineness) for n in counts]
    return [s for s in out if not tools or s.tool in tools]
