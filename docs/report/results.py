"""Results of runs, kept in a file while they come, so that a report that was interrupted goes on where it was."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import asdict
from pathlib import Path

from ..processes import run_module
from .plan import Setting

PACKAGE = "enfilade.docs.report"
CORE = Path(__file__).resolve().parents[2] / "core"


class Results:
    """Results of settings on one machine, in a JSON file; runs of Enfilade count only while its code stays as it is.

    Raises ValueError when the file comes from another machine or other versions.
    """

    def __init__(self, path: Path, machine: dict[str, str]) -> None:
        self._path, self._code = path, code_version()
        self._data = {"machine": machine, "runs": {}}
        if path.exists():
            self._data = json.loads(path.read_text(encoding="utf-8"))
            if self._data["machine"] != machine:
                raise ValueError(f"{path} comes from another machine or other versions; begin anew with --fresh, or move it away")

    @property
    def machine(self) -> dict[str, str]:
        return self._data["machine"]

    def of(self, setting: Setting) -> list[dict]:
        """What the runs of a setting gave, oldest first."""
        runs = self._data["runs"].get(setting.key, {"results": []})["results"]
        return [r for r in runs if setting.tool != "enfilade" or r["code"] == self._code]

    def add(self, setting: Setting, result: dict) -> None:
        """Keep a result, at once also in the file."""
        if setting.tool == "enfilade":
            result = result | {"code": self._code}
        self._data["runs"][setting.key] = {"setting": asdict(setting), "results": [*self.of(setting), result]}
        self._path.parent.mkdir(parents=True, exist_ok=True)
        rest = self._path.with_suffix(".tmp")
        rest.write_text(json.dumps(self._data, indent=1), encoding="utf-8")
        os.replace(rest, self._path)


def code_version() -> str:
    """A fingerprint of the solver's code."""
    digest = hashlib.sha256()
    for path in sorted(CORE.rglob("*.py")):
        digest.update(path.relative_to(CORE).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def run(setting: Setting, threads: int) -> dict:
    """One run in a process of its own. Raises :class:`enfilade.docs.processes.RunError`."""
    if setting.tool == "enfilade":
        return run_module(f"{PACKAGE}.enfilade_run", setting.scene, setting.quality, threads)
    return run_module(f"{PACKAGE}.cycles_run", setting.scene, setting.way, setting.samples, setting.fineness, threads)
