"""Damaged files, wrong command lines and random scenes in large numbers.

    python tests/house/fuzz.py inputs 10000     what readers and commands make of damaged input
    python tests/house/fuzz.py scenes 1000      what the solver makes of random small scenes, at quality good; or: scenes 1000 draft

Every input is either read or refused in one sentence, within ten seconds; every scene gives finite light within ten seconds
and accounts for its energy within 1 % at quality good, 3 % at draft. Prints what does not, by its seed, and the figures of all;
exit code 1 when something does not.
"""

import contextlib
import io
import json
import resource
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "core"))
from enfilade.__main__ import main
from enfilade.core.luminaire_files import read_luminaire
from enfilade.core.options import Options
from enfilade.core.pipeline import solve
from enfilade.core.regions import Regions
from enfilade.core.scene import SceneError
from enfilade.core.scene_checks import check
from enfilade.core.scene_files import load_scene, save_scene
from enfilade.core.stage_files import StageError, load_stage
from enfilade.core.store.errors import StoreError
from enfilade.core.store.folder import FORMAT, VERSION, Store
from enfilade.core.store.space import Space
from luminaire_samples import ies, ldt
from scenery import box, portals_of, rectangle, rotation, scene_of

SECONDS = 10.0
BALANCE = {"draft": 0.03, "good": 0.01}
SCENES = Path(__file__).resolve().parents[1] / "data" / "scenes"
ODD = [None, True, -1, 0, 1, 2**31, 2**63, 10**30, -1e308, 1e-320, float("inf"), float("nan"), "", "x", "é" * 50, [], {}, [[]], [None]]


# ------------------------------------------------------------------------------------------------------------ damage


def scrambled(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes changed, cut off, left out, doubled or put in, a few times over."""
    out = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        at, length = int(rng.integers(0, len(out) + 1)), int(rng.integers(1, 64))
        kind = rng.integers(6)
        if kind == 0:
            del out[at:]
        elif kind == 1:
            del out[at : at + length]
        elif kind == 2:
            out[at:at] = out[at : at + length]
        elif kind == 3:
            out[at:at] = rng.integers(0, 256, length, dtype=np.uint8).tobytes()
        elif kind == 4:
            out[at : at + 1] = bytes([int(rng.integers(256))])
        else:
            out[at : at + 4] = [b"\xff\xff\xff\xff", b"\0\0\0\0", b"9999", b"-1e9"][int(rng.integers(4))]
    return bytes(out)


def odd_array(array: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """An array of another shape, kind or with values that cannot be."""
    kind = rng.integers(8)
    if kind == 0:
        return array[: rng.integers(0, len(array) + 1)] if array.ndim else array.reshape(1)
    if kind == 1:
        return np.concatenate([array, array]) if array.ndim else array
    if kind == 2:
        return array.reshape(-1)
    if kind == 3:
        kinds = ["U8"] if array.dtype.kind == "U" else [np.float32, np.int64, np.uint8, np.complex64, "U8", bool]
        return array.astype(kinds[int(rng.integers(len(kinds)))])
    if kind == 4:
        return np.zeros(tuple(rng.integers(0, 4, rng.integers(0, 4))))
    out = array.copy()
    if out.size and out.dtype.kind in "fiu":
        odd = [np.nan, np.inf, -np.inf, 1e38, -1.0] if out.dtype.kind == "f" else [-1, 0, 2**31 - 1, -(2**31), 77]
        out.reshape(-1)[rng.integers(0, out.size, rng.integers(1, 4))] = odd[int(rng.integers(5))]
    return out


def npz(rng: np.random.Generator) -> bytes:
    scene = random_scene(rng)
    stream = io.BytesIO()
    with tempfile.TemporaryDirectory() as folder:
        save_scene(scene, Path(folder) / "a.npz")
        content = (Path(folder) / "a.npz").read_bytes()
    if rng.random() < 0.4:
        return scrambled(content, rng)
    with np.load(io.BytesIO(content)) as data:
        arrays = {key: data[key] for key in data.files}
    for _ in range(rng.integers(1, 3)):
        key = list(arrays)[int(rng.integers(len(arrays)))]
        if rng.random() < 0.2:
            del arrays[key]
        else:
            arrays[key] = odd_array(arrays[key], rng)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        np.savez(stream, **arrays)
    if rng.random() < 0.1:  # another array beside, packed or headed in a way of its own
        with zipfile.ZipFile(stream, "a") as archive:
            archive.writestr(
                "verts2.npy", scrambled(b"\x93NUMPY\x01\x00\x46\x00{'descr': '<f8', 'fortran_order': False, 'shape': (99,)}", rng)
            )
    return stream.getvalue()


def building(rng: np.random.Generator) -> bytes:
    document = json.loads((SCENES / "cie171-5.7.json").read_text(encoding="utf-8"))
    if rng.random() < 0.3:
        return scrambled(json.dumps(document).encode(), rng)
    for _ in range(rng.integers(1, 4)):
        node, place = document, None
        while isinstance(node, dict | list) and len(node) and (place is None or rng.random() < 0.85):
            place = (node, list(node)[int(rng.integers(len(node)))] if isinstance(node, dict) else int(rng.integers(len(node))))
            node = place[0][place[1]]
        if place is None:
            continue
        if rng.random() < 0.2:
            del place[0][place[1]]
        else:
            place[0][place[1]] = ODD[int(rng.integers(len(ODD)))]
    return json.dumps(document).encode()


def luminaire(rng: np.random.Generator, suffix: str) -> bytes:
    v, h = np.linspace(0, 90, int(rng.integers(2, 6))), np.linspace(0, 90, int(rng.integers(1, 4)))
    if suffix == ".ies":
        text = ies(v, h, rng.uniform(0, 100, (len(h), len(v))))
    else:
        planes = np.arange(0, 360, 90)
        text = ldt(0, planes, np.linspace(0, 180, 5), rng.uniform(0, 100, (4, 5)))
    if rng.random() < 0.5:
        words = text.split(" " if suffix == ".ies" else "\n")
        for _ in range(rng.integers(1, 4)):
            words[int(rng.integers(len(words)))] = str(ODD[int(rng.integers(len(ODD)))])
        text = (" " if suffix == ".ies" else "\n").join(words)
    return text.encode() if rng.random() < 0.3 else scrambled(text.encode(), rng)


def manifest(rng: np.random.Generator) -> bytes:
    entry = {"key": "", "files": {"regions.npz": [100, 7], "links/a.npy": [9, 9]}, "facts": {"iterations": 3}}
    document = {"format": FORMAT, "version": VERSION, "key": "k", "stages": {"regions": entry, "lamps": dict(entry)}}
    if rng.random() < 0.5:
        return scrambled(json.dumps(document).encode(), rng)
    document["stages"]["regions"] = {**entry, list(entry)[int(rng.integers(3))]: ODD[int(rng.integers(len(ODD)))]}
    if rng.random() < 0.3:
        document["stages"]["lamps"] = {**entry, "files": {["", "/", "../x", "a\0b"][int(rng.integers(4))]: [1, 1]}}
    return json.dumps(document).encode()


def arguments(rng: np.random.Generator, folder: Path) -> list[str]:
    """A command line of right and wrong words, that names no scene that there is."""
    words = [
        "solve",
        "bake",
        "--help",
        "--version",
        "--out",
        "--report",
        "--quality",
        "good",
        "fine",
        "--order",
        "2",
        "9",
        "-1",
        "--memory",
    ]
    words += [
        "2G",
        "1e400",
        "nan",
        "--threads",
        "--seed",
        "--store",
        "--ordering",
        "",
        "x",
        "--average=",
        "--no",
        "-",
        "--",
        "\udcff",
        "é",
        "9" * 5000,
    ]
    words += [str(folder / "none.npz"), str(folder), "none.json", "/dev/null", "a\0b", "--picture", "--min-element-size", "--texel-density"]
    first = [["solve"], ["solve", str(folder / "none.npz")], ["bake"], []][int(rng.integers(4))]
    return first + [words[int(k)] for k in rng.integers(0, len(words), rng.integers(0, 9))]


# ------------------------------------------------------------------------------------------------------------ reading


def read(kind: str, seed: int, folder: Path) -> str:
    """What became of one damaged input: "read" or "refused"; anything else is raised."""
    rng = np.random.default_rng((seed, KINDS.index(kind)))
    if kind == "arguments":
        said, told = io.StringIO(), io.StringIO()
        with contextlib.redirect_stderr(told), contextlib.redirect_stdout(said):
            try:
                code = main(arguments(rng, folder))
            except SystemExit as stop:
                code = stop.code
        if code not in (0, None) and (code != 2 or not told.getvalue().strip()):
            raise AssertionError(f"exit code {code!r} after {told.getvalue()!r}")
        return "refused" if code else "read"
    suffix, make, reader, refusal = READERS[kind]
    path = folder / f"input{suffix}"
    path.write_bytes(make(rng))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            reader(path)
    except refusal as error:
        if "\n" in str(error) or not str(error) or len(str(error)) > 600:
            raise AssertionError(f"not one sentence: {error}") from error
        return "refused"
    return "read"


def stage(rng: np.random.Generator) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, centre=np.zeros(3), polygon_region=np.zeros(4, np.int32))
    return scrambled(stream.getvalue(), rng)


def open_store(path: Path) -> None:
    (path.parent / "manifest.json").write_bytes(path.read_bytes())
    store = Store(path.parent, "k", Space())
    try:
        for name in ("regions", "lamps"):
            store.recall(name)
    finally:
        store.close()


READERS = {
    "npz": (".npz", npz, lambda path: check(load_scene(path)), SceneError),
    "json": (".json", building, lambda path: check(load_scene(path)), SceneError),
    "ies": (".ies", lambda rng: luminaire(rng, ".ies"), read_luminaire, SceneError),
    "ldt": (".ldt", lambda rng: luminaire(rng, ".ldt"), read_luminaire, SceneError),
    "stage": (".npz", stage, lambda path: load_stage(Regions, path), StageError),
    "store": (".store", manifest, open_store, StoreError),
}
KINDS = [*READERS, "arguments"]


# ------------------------------------------------------------------------------------------------------- random scenes


def random_scene(rng: np.random.Generator):
    """One to three rooms in a row, doors between them, furniture that may run into anything, one lamp or more; turned and shifted."""
    rooms = int(rng.integers(1, 4))
    polygons, room, thing, emission, doors, links = [], [], [], [], [], []
    x = 0.0
    for r in range(rooms):
        size = rng.uniform([2, 2, 2], [6, 5, 4])
        size[1:] = (4.0, 2.5) if rooms > 1 else size[1:]
        low, high = np.array([x, 0, 0]), np.array([x, 0, 0]) + size
        leave = " ".join(side for side, other in (("x-", r > 0), ("x+", r < rooms - 1)) if other)
        parts = [box(low, high, leave_out=leave)]
        for side, other in ((0, r > 0), (1, r < rooms - 1)):
            if other:  # a wall around a door 1 m wide and 2 m high
                at = (low, high)[side][0]
                wall = [rectangle((at, 0, 0), (0, 1.5, 0), (0, 0, 2.5)), rectangle((at, 2.5, 0), (0, 1.5, 0), (0, 0, 2.5))]
                wall.append(rectangle((at, 1.5, 2), (0, 1, 0), (0, 0, 0.5)))
                parts.append([w if side == 0 else w[::-1] for w in wall])
        if r < rooms - 1:
            doors.append(rectangle((high[0], 1.5, 0), (0, 1, 0), (0, 0, 2)))
            links.append((r, r + 1))
        for _ in range(rng.integers(0, 5)):
            half = rng.uniform(0.02, 0.6, 3)
            middle = rng.uniform(low + half, high - half)
            if rng.random() < 0.5:
                middle[2] = half[2]  # stands on the floor
            parts.append(box(middle - half, middle + half, inward=False))
        if r == 0 or rng.random() < 0.5:
            lamp = rng.uniform(0.02, 0.5, 2)
            parts.append([rectangle((*(low[:2] + 0.3 * size[:2]), high[2] - 0.01), (0, lamp[1], 0), (lamp[0], 0, 0))])
        for k, part in enumerate(parts):
            shines = len(part) == 1 and k == len(parts) - 1
            polygons += part
            room += [r] * len(part)
            thing += [max(thing, default=-1) + 1] * len(part)
            emission += [10 ** rng.uniform(-2, 3) if shines else 0.0] * len(part)
        x = high[0]
    turn, offset = (rotation(int(rng.integers(1000))), rng.uniform(-100, 100, 3)) if rng.random() < 0.5 else (np.eye(3), np.zeros(3))
    reflectance = rng.uniform(0, 0.85, (len(polygons), 3))
    colour = np.array(emission)[:, None] * rng.uniform(0.2, 1, 3)
    portals = portals_of([d @ turn.T + offset for d in doors], links) if doors else None
    return scene_of([p @ turn.T + offset for p in polygons], reflectance, colour, room, thing, portals)


def solve_one(seed: int, quality: str) -> tuple[float, float]:
    """Energy accounted for over emitted energy, and seconds; raises when the light is not finite."""
    rng = np.random.default_rng((seed, 99))
    scene, _ = check(random_scene(rng))
    started = time.process_time()
    solution = solve(scene, Options(quality=quality, order=int(rng.integers(1, 4)), threads=1))
    middle = np.array(
        [scene.vertices[scene.corner_vertex[a:b]].mean(0) for a, b in zip(scene.loop_start[:-1], scene.loop_start[1:], strict=True)]
    )
    light = solution.irradiance(middle, np.arange(len(middle)))
    seconds = time.process_time() - started
    if not np.isfinite(light).all() or not np.isfinite(solution.polygon_exitance()).all() or light.min() < 0:
        raise AssertionError("the light is not finite, or below zero")
    energy = solution.report["energy"]
    return (energy["absorbed"] + energy["escaped"]) / energy["emitted"], seconds


# ------------------------------------------------------------------------------------------------------------ commands


def fuzz_inputs(count: int, _: str) -> bool:
    outcomes, faults, slowest = Counter(), 0, 0.0
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(count):
            kind = KINDS[seed % len(KINDS)]
            started = time.process_time()
            try:
                outcomes[kind, read(kind, seed, Path(folder))] += 1
            except Exception:
                faults += 1
                print(f"{kind} {seed}:\n{traceback.format_exc(limit=-3)}")
            seconds = time.process_time() - started
            slowest = max(slowest, seconds)
            if seconds > SECONDS:
                faults += 1
                print(f"{kind} {seed}: {seconds:.1f} s")
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    for (kind, outcome), number in sorted(outcomes.items()):
        print(f"{kind:10} {outcome:8} {number:6}")
    print(f"{count} inputs, {faults} faults, slowest {slowest:.2f} s of processor time, memory grew by {grown:.0f} MB")
    return faults == 0


def fuzz_scenes(count: int, quality: str) -> bool:
    errors, seconds, faults = [], [], 0
    for seed in range(count):
        try:
            balance, took = solve_one(seed, quality)
        except Exception:
            faults += 1
            print(f"scene {seed}:\n{traceback.format_exc(limit=-3)}")
            continue
        errors.append(abs(balance - 1))
        seconds.append(took)
        if errors[-1] > BALANCE[quality] or took > SECONDS:
            faults += 1
            print(f"scene {seed}: {balance:.2%} of the energy accounted for, {took:.1f} s")
    share = np.quantile(errors, [0.5, 0.99, 1]) if errors else np.full(3, np.nan)
    print(
        f"{count} scenes, {faults} faults; energy off by {share[0]:.3%} in the middle, {share[1]:.3%} at 99 of 100, {share[2]:.3%} at most;"
    )
    print(f"{np.mean(seconds):.2f} s of processor time on average, {np.max(seconds):.2f} s at most")
    return faults == 0


if __name__ == "__main__":
    command = {"inputs": fuzz_inputs, "scenes": fuzz_scenes}[sys.argv[1]]
    sys.exit(0 if command(int(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else "good") else 1)
