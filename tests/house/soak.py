"""Many bakes in one Blender process, which must neither grow nor leave anything behind: ``python tests/house/soak.py 100``.

Bakes two small rooms by the button, into vertex colours and into textures by turns, and prints the resident size after every
tenth bake. The size after the last bake may be 5 % above that after the tenth. Afterwards Clear must leave the file as it was.
"""

import importlib.util
import os
import sys
import tempfile
import time
from pathlib import Path

GROWTH = 0.05
SETTLED = 10
"""Bakes after which the process has everything that it will keep."""


def soak(shop, count: int, tell=lambda bake, size: None) -> tuple[list[int], list[str]]:
    """Resident size in bytes after each of ``count`` bakes, and what was left behind."""
    from enfilade.core.memory import resident_bytes

    shop.two_rooms()
    settings, bpy = shop.bpy.context.scene.enfilade, shop.bpy
    settings.solve.quality, settings.solve.threads, settings.bake.texel_density = "draft", 1, 8.0
    before, faults, sizes = shop.state(), [], []
    made: dict[str, dict] = {}
    for bake in range(count):
        settings.bake.target = "texture" if bake % 2 else "vertex"
        if bpy.ops.enfilade.bake() != {"FINISHED"}:
            faults.append(f"bake {bake + 1} did not finish")
        sizes.append(resident_bytes())
        # The first bakes of either kind add what is theirs; later ones put new values into the same places.
        if bake >= 2 and shop.state() != made.setdefault(settings.bake.target, shop.state()):
            faults.append(f"bake {bake + 1} left the file other than those before")
        if (bake + 1) % 10 == 0:
            tell(bake + 1, sizes[-1])
    bpy.ops.enfilade.clear()
    if shop.state() != before:
        faults.append("Clear did not leave the file as it was")
    return sizes, faults


def main(count: int) -> int:
    os.environ.setdefault("BLENDER_USER_RESOURCES", tempfile.mkdtemp(prefix="blender-user-"))
    place = Path(__file__).resolve().parents[1] / "addon" / "conftest.py"
    spec = importlib.util.spec_from_file_location("workshop", place)
    workshop = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(workshop)
    import bpy
    import enfilade

    bpy.ops.wm.read_factory_settings(use_empty=True)
    enfilade.register()
    started = time.process_time()
    sizes, faults = soak(workshop.Workshop(), count, lambda bake, size: print(f"after bake {bake:4}: {size / 1e6:8.1f} MB", flush=True))
    growth = sizes[-1] / sizes[min(SETTLED, count) - 1] - 1
    if growth > GROWTH:
        faults.append(f"the process grew by {growth:.1%}")
    print(
        *faults, f"{count} bakes in {time.process_time() - started:.0f} s of processor time, {growth:+.2%} since bake {SETTLED}", sep="\n"
    )
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
