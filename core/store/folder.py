"""The folder of a run: what each stage has finished, so that a run that was ended in any way goes on from there.

``manifest.json`` names the stages that are done, with the length and checksum of each of their files. Files are written
under other names and moved into place; the manifest is replaced in one step, and last. So it never names a file that is
not there whole, and a run that ends at any moment leaves what it had before.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..stage_files import StageError, load_stage, save_stage
from .errors import StoreError, refused
from .lock import locked
from .npy_files import checksum, map_array, write_array
from .space import Space

FORMAT, VERSION = "enfilade store", 2
_PART = ".part"

Stage = TypeVar("Stage")


class Saved:
    """What a stage has left: ``facts``, and its arrays or its result."""

    def __init__(self, folder: Path, files: Sequence[str], facts: dict[str, Any], space: Space) -> None:
        self._folder, self._files, self._space, self.facts = folder, files, space, facts

    def result(self, cls: type[Stage]) -> Stage:
        """The dataclass that was kept. Raises :class:`StoreError`."""
        try:
            return load_stage(cls, self._folder / self._files[0])
        except StageError as error:
            raise StoreError(str(error)) from error

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays that were kept, read-only, in the memory of their files. Raises :class:`StoreError`."""
        out = {}
        for name in self._files:
            path = self._folder / name
            try:
                out[path.stem], mapped = map_array(path)
            except (OSError, ValueError) as error:
                raise _damaged(path) from error
            if mapped is not None:
                self._space.watch(mapped)
        return out


class Nowhere:
    """In place of a store when there is none."""

    def recall(self, stage: str, key: str = "") -> Saved | None:
        """Nothing is ever found."""

    def keep(self, stage: str, result: object, facts: Mapping[str, Any] | None = None) -> None:
        """Nothing is kept."""

    def keep_arrays(self, stage: str, arrays: Mapping[str, Any], facts: Mapping[str, Any] | None = None, key: str = "") -> None:
        """Nothing is kept."""

    def drop(self, stage: str) -> None:
        """Nothing is there."""

    def close(self) -> None:
        """Nothing is open."""


class Store(Nowhere):
    """Stages of the run of fingerprint ``key`` in ``folder``; what a run of another key has left there goes.

    space : releases the memory of the files that are read. Raises :class:`StoreError` in all methods when the disk refuses, another run
    uses the folder, or what is there is damaged; nothing that was kept before is lost.
    """

    def __init__(self, folder: str | Path, key: str, space: Space) -> None:
        self._folder, self._space = Path(folder), space
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._lock = locked(self._folder)
        except OSError as error:
            raise refused(folder, error) from error
        try:
            self._stages = self._read(key)
            self._key = key
            self._sweep()
        except BaseException:
            self._lock.close()
            raise

    def close(self) -> None:
        """Let other runs use the folder."""
        self._lock.close()

    def recall(self, stage: str, key: str = "") -> Saved | None:
        """What a stage has left, or None when it has to be done (again): not finished, of another ``key``, or its files are gone."""
        entry = self._stages.get(stage)
        if entry is None or entry["key"] != key:
            return None
        for name, (size, check) in entry["files"].items():
            path = self._folder / name
            try:
                if not path.exists():
                    return None
                intact = checksum(path) == (size, check)
            except OSError as error:
                raise _damaged(path) from error
            if not intact:
                raise _damaged(path)
        return Saved(self._folder, list(entry["files"]), dict(entry["facts"]), self._space)

    def keep(self, stage: str, result: object, facts: Mapping[str, Any] | None = None) -> None:
        """Keep a dataclass of arrays, as ``<stage>.npz``."""
        path = self._folder / f"{stage}.npz"
        try:
            self.drop(stage)
            save_stage(result, path)
            self._enter(stage, {path.name: checksum(path)}, facts, "")
        except OSError as error:
            raise refused(path, error) from error

    def keep_arrays(self, stage: str, arrays: Mapping[str, Any], facts: Mapping[str, Any] | None = None, key: str = "") -> None:
        """Keep arrays, each or each list of parts as a ``.npy`` of its name, in a folder of their own.

        Until all of them are written, what the stage has left before stays.
        """
        old = self._stages.get(stage, {"files": {}})["files"]
        home = next(h for h in (stage, f"{stage}-2") if not any(Path(name).parts[0] == h for name in old))
        folder = self._folder / (home + _PART)
        try:
            _remove(folder)
            folder.mkdir()
            files = {}
            for name, array in arrays.items():
                parts = array if isinstance(array, list) else [array]
                files[f"{home}/{name}.npy"] = write_array(folder / f"{name}.npy", parts, self._space.breathe)
            _remove(self._folder / home)
            os.replace(folder, self._folder / home)
            self._enter(stage, files, facts, key)
            self._sweep()
        except OSError as error:
            raise refused(self._folder, error) from error

    def drop(self, stage: str) -> None:
        """Forget a stage and remove its files."""
        if self._stages.pop(stage, None) is not None:
            try:
                self._write()
                self._sweep()
            except OSError as error:
                raise refused(self._folder, error) from error

    def _enter(self, stage: str, files: dict, facts: Mapping[str, Any] | None, key: str) -> None:
        before = self._stages.get(stage)
        self._stages[stage] = {"key": key, "files": files, "facts": dict(facts or {})}
        try:
            self._write()
        except OSError:
            self._stages.pop(stage)
            if before:
                self._stages[stage] = before
            raise

    def _read(self, key: str) -> dict[str, Any]:
        path = self._folder / "manifest.json"
        if not path.exists():
            return {}
        try:
            manifest = json.loads(path.read_text(encoding="utf-8"))
            known = manifest["format"] == FORMAT and manifest["version"] == VERSION
            stages = {
                stage: {
                    "key": str(entry["key"]),
                    "files": {_inside(name): (int(size), int(check)) for name, (size, check) in entry["files"].items()},
                    "facts": dict(entry["facts"]),
                }
                for stage, entry in manifest["stages"].items()
            }
        except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
            raise StoreError(f"{path}: the list of what is in the store cannot be read; delete this folder and run again") from error
        if not known:
            raise StoreError(f"{path}: this store is of another version of the format; name another folder or delete this one")
        return stages if manifest.get("key") == key else {}

    def _write(self) -> None:
        path = self._folder / "manifest.json"
        part = path.with_name(path.name + _PART)
        manifest = {"format": FORMAT, "version": VERSION, "key": self._key, "stages": self._stages}
        with part.open("w", encoding="utf-8") as stream:
            json.dump(manifest, stream, indent=1)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(part, path)

    def _sweep(self) -> None:
        """Remove what is not named by the manifest and bears a name that only a store gives."""
        named = {Path(name).parts[0] for entry in self._stages.values() for name in entry["files"]}
        for path in self._folder.iterdir():
            ours = path.name.endswith(_PART) or path.name.startswith("scratch-") or FOLDERS.fullmatch(path.name)
            if ours and path.name not in named:
                _remove(path)


FOLDERS = re.compile(r"(lamps|links|(group|shooting)(-g\d+)?)(-2)?")
"""Stages that are kept as folders of arrays; those of light groups have their numbers."""


def _inside(name: str) -> str:
    """The name, if it is that of a file in the folder. Raises ValueError when it leads elsewhere."""
    parts = Path(name).parts
    if not 1 <= len(parts) <= 2 or ".." in parts or Path(name).is_absolute() or "\0" in name:
        raise ValueError(name)
    return name


def _remove(path: Path) -> None:
    """Remove a file or a folder, as far as the system lets it; whatever is left is in nobody's way."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _damaged(path: Path) -> StoreError:
    return StoreError(f"{path}: the store is damaged, this file is not what was saved there; delete it and run again")
