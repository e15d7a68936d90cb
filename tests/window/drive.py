"""Drives a real Blender window by mouse and keys from a plain model to a baked, saved and reopened file.

``python drive.py ZIP APARTMENT.blend FOLDER`` with ENFILADE_BLENDER_SHELL set to a command that runs its arguments where Xvfb, blender,
xdotool and ImageMagick's import are, in the same folder as it is called from. FOLDER receives a screenshot of every step
and ``seen.json``, what Blender itself said and the longest pauses of its window.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
SHELL = "ENFILADE_BLENDER_SHELL"
VIEW = (620, 700)
"""A place in the 3D viewport of the factory layout in a window of 1600 x 900."""
EDIT, MENU_SEARCH = (79, 14), (135, 178)
"""The menu Edit, and its entry that searches all menus."""
PREFERENCES = (131, 283)
"""The entry of that menu that opens the preferences."""
GET_EXTENSIONS = {4: (57, 164), 5: (57, 194)}
"""The place of a tab in their window, by Blender's first number."""


class Window:
    """A Blender on a virtual screen, with what its watcher sees."""

    def __init__(self, folder: Path, display: int = 93) -> None:
        self.folder, self.display = folder, f":{display}"
        self._shell = shlex.split(os.environ[SHELL])
        self._number = 0

    def inside(self, command: str, **more) -> subprocess.CompletedProcess:
        settings = f"export DISPLAY={self.display} BLENDER_USER_RESOURCES=$PWD/profile; "
        return subprocess.run([*self._shell, "bash", "-c", settings + command], cwd=self.folder, check=False, text=True, **more)

    def start(self, file: str) -> None:
        command = (
            f"Xvfb {self.display} -screen 0 1600x900x24 +extension GLX & x=$!; sleep 1; "
            "blender --gpu-backend opengl --window-geometry 0 0 1600 900 --python watch.py " + shlex.quote(file) + "; kill $x"
        )
        settings = f"export DISPLAY={self.display} BLENDER_USER_RESOURCES=$PWD/profile; "
        with open(self.folder / "blender.log", "w", encoding="utf-8") as log:
            self._process = subprocess.Popen([*self._shell, "bash", "-c", settings + command], cwd=self.folder, stdout=log, stderr=log)
        self.wait("the window", lambda s: s["count"] >= 20, 120)
        time.sleep(3)

    def seen(self) -> dict:
        try:
            return json.loads((self.folder / "seen.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {"count": 0}

    def wait(self, what: str, until, seconds: float) -> dict:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            state = self.seen()
            if "installed" in state and until(state):
                return state
            time.sleep(0.2)
        self.shot("failed")
        raise AssertionError(f"{what} did not come within {seconds:.0f} s: {self.seen()}")

    def do(self, steps: str) -> None:
        """Mouse and keys as xdotool takes them."""
        self.inside(f"xdotool {steps}")

    def search(self, words: str) -> None:
        """Run a menu entry by Blender's own search."""
        self.do(f"mousemove {EDIT[0] + 200} {EDIT[1]} sleep 0.5 mousemove {EDIT[0]} {EDIT[1]} sleep 1 click 1")
        self.rest()
        self.do(f"mousemove {MENU_SEARCH[0]} {MENU_SEARCH[1]} sleep 0.5 click 1")
        self.rest()
        self.do(f"type --delay 60 '{words}'")
        self.rest()
        self.do("key Return")
        self.rest()
        self.do(f"mousemove {VIEW[0]} {VIEW[1]}")

    def rest(self, looks: int = 350) -> None:
        """Let the window come after, which is drawn without a graphics card: it looked around so many times."""
        count = self.seen()["count"]
        self.wait("the window", lambda s: s["count"] > count + looks, 60)

    def beside(self, title: str, place: tuple[int, int]) -> tuple[int, int]:
        """Move another window of this Blender, as one would who wants to see what it covers; returns its width and height."""
        find = f"xdotool search --name '{title}'"
        end = time.monotonic() + 30
        while self.inside(find, capture_output=True).returncode:
            assert time.monotonic() < end, f"no window '{title}' opened"
            time.sleep(0.5)
        time.sleep(1)
        told = self.inside(f"{find} windowmove {place[0]} {place[1]} sleep 0.5 getwindowgeometry --shell", capture_output=True).stdout
        size = dict(line.split("=") for line in told.split())
        return int(size["WIDTH"]), int(size["HEIGHT"])

    def click(self, x: int, y: int) -> None:
        self.do(f"mousemove {x + 8} {y + 12} sleep 0.5 mousemove {x} {y} sleep 0.7 click 1")
        self.rest()

    def press(self, keys: str) -> None:
        """Keys over the 3D viewport."""
        self.do(f"mousemove {VIEW[0]} {VIEW[1]}")
        self.rest()
        self.do(f"key {keys}")

    def type_into(self, x: int, y: int, text: str) -> None:
        """Replace the text of a field."""
        self.do(f"mousemove {x + 8} {y} sleep 0.5 mousemove {x} {y} sleep 0.5 click --repeat 2 --delay 120 1 sleep 1 key ctrl+a")
        self.do(f"type --delay 60 '{text}'")
        self.do("sleep 0.5 key Return")
        self.rest()

    def shot(self, name: str) -> None:
        time.sleep(1.5)
        self._number += 1
        self.inside(f"import -window root {self._number:02d}-{name}.png")

    def stop(self) -> None:
        self.do("key ctrl+q")
        try:
            self._process.wait(15)
        except subprocess.TimeoutExpired:
            self.inside(f"kill {self.seen()['pid']}")
            self._process.wait(15)


def drive(package: Path, apartment: Path, folder: Path) -> dict:
    """All steps; returns what was seen last. Raises AssertionError at the first that does not come about."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(package, folder / "enfilade.zip")
    shutil.copy(apartment, folder / "apartment.blend")
    for script in ("watch.py", "prepare.py"):
        shutil.copy(HERE / script, folder / script)
    window = Window(folder)
    prepared = window.inside("blender --background --python prepare.py -- apartment.blend plain.blend")
    assert prepared.returncode == 0, "the plain model could not be made"
    assert (folder / "plain.blend").exists(), "the plain model could not be made"
    (folder / "profile" / "config").mkdir(parents=True)  # else Blender takes the preferences of whoever runs this
    window.start("plain.blend")
    try:
        _install(window)
        _steps(window)
    finally:
        window.stop()
    return window.seen()


def _install(window: Window) -> None:
    """Edit > Preferences > Get Extensions > Install from Disk, as the guide says."""
    version = window.seen()["version"][0]
    left, top = 300, 150
    window.click(*EDIT)
    window.click(*PREFERENCES)
    width, _ = window.beside("Preferences", (left, top))
    window.click(left + GET_EXTENSIONS[version][0], top + GET_EXTENSIONS[version][1])
    window.click(left + width - 20, top + 19)
    window.shot("get-extensions")
    window.do("key f")  # Install from Disk
    width, height = window.beside("File View", (left, top))
    here = window.inside("pwd", capture_output=True).stdout.strip()
    window.type_into(left + width // 2, top + 21, f"{here}/")
    window.type_into(left + width // 2, top + height - 22, "enfilade.zip")
    window.shot("from-disk")
    window.click(left + width - 74, top + height - 22)
    window.wait("the extension", lambda s: s["installed"], 60)
    window.shot("installed")
    window.beside("Preferences", (1590, 890))
    window.do("search --name 'Blender [0-9]' windowfocus")  # as a click does where windows are managed


def _steps(window: Window) -> None:
    window.do(f"mousemove {VIEW[0]} {VIEW[1]} key n")
    window.rest()
    window.shot("opened")
    window.search("portal from objects")
    window.wait("six portals", lambda s: s["portals"] == 6, 60)
    window.shot("portals")
    window.search("find rooms")
    window.wait("six rooms", lambda s: s["rooms"] == 6, 120)
    window.shot("rooms")

    window.search("bake light")
    window.wait("a bake that runs", lambda s: s["fraction"] > 0.25, 300)
    window.shot("baking")
    window.do("key Escape")
    state = window.wait("the end of the cancelled bake", lambda s: s["fraction"] < 0, 60)
    assert state["baked"] == 0, "a cancelled bake wrote something"
    window.shot("cancelled")

    window.search("bake light")
    state = window.wait("the light", lambda s: s["summary"] != "", 1200)
    carriers = state["baked"]
    assert carriers > 0
    assert state["shown"]
    window.shot("baked")
    window.press("ctrl+z")
    window.wait("the undo", lambda s: s["baked"] == 0 and not s["shown"], 60)
    window.shot("undone")
    window.press("ctrl+shift+z")
    window.wait("the redo", lambda s: s["baked"] == carriers, 60)
    window.search("show bake")
    window.wait("the bake in the viewport", lambda s: s["shown"], 60)
    window.shot("shown")
    window.search("false colour")
    window.wait("false colours", lambda s: "lux" in s["overlay"].lower() or s["overlay"] != "", 60)
    window.shot("false-colour")
    window.press("ctrl+s")
    window.wait("the saved file", lambda s: not s["dirty"], 60)
    window.search("revert")
    time.sleep(2)
    window.do("key Return")
    window.wait("the file opened again", lambda s: s["baked"] == carriers and not s["dirty"] and s["overlay"] == "", 60)
    window.shot("reopened")


if __name__ == "__main__":
    end = drive(*(Path(argument).resolve() for argument in sys.argv[1:4]))
    print(json.dumps({name: round(seconds, 3) for name, seconds in end["pauses"].items()}))
