"""Segment tests a second inside a solve, against the bare arithmetic over blocks of the same shapes."""

from __future__ import annotations

import time

import numpy as np

from ...core.options import Options
from ...core.pipeline import solve
from ..bench import Bench
from .tables import Table, met
from .witness import segment_tests

BLOCK = 1 << 16
"""Numbers in one array of the bare loop, as in the solver: a handful of such arrays stay in the cache of a core."""


def measure(quick: bool) -> Table:
    """CPU seconds in one process, of one solve for each scene and of the bare loop right after it."""
    rows, worst = [], np.inf
    for name in ("two_rooms",) if quick else ("cornell", "two_rooms", "office"):
        scene = Bench(name).scene
        with segment_tests() as timed:
            started = time.process_time()
            solve(scene, Options(quality="draft" if quick else "good", threads=1))
            whole = time.process_time() - started
        bare = bare_rate(timed.shapes)
        rate = timed.tests / timed.seconds
        worst = min(worst, rate / bare)
        seconds = [f"{timed.seconds:.2f}", f"{whole:.1f}"]
        rows.append([name, f"{timed.tests / 1e6:.1f}", *seconds, f"{rate / 1e6:.0f}", f"{bare / 1e6:.0f}", f"{rate / bare:.2f}"])
    head = ["scene", "segment tests, million", "CPU seconds in them", "of the solve", "million a second", "bare loop", "ratio"]
    text = (
        "The test whether segments between two sets of nodes meet a blocker, as the solver calls it: rows of pairs and blockers "
        "that are gathered, "
        "cut to what one large blocker does not hide, and brought together by pair. The bare loop is its dozen of operations in float32 on "
        "arrays that lie ready, in blocks of the same numbers of rows and nodes."
    )
    line = ["segment tests a second in the solver over those of a bare loop", "0.5", f"{worst:.2f}", met(worst >= 0.5)]
    return Table("Segment tests", text, head, rows, [line])


def bare_rate(shapes: list[tuple[int, int, int]]) -> float:
    """Tests a second of the bare arithmetic over blocks of (rows, nodes, nodes)."""
    rng = np.random.default_rng(0)
    tests, seconds, most = 0, 0.0, 2_000_000
    for rows, i, j in shapes:
        step = max(1, BLOCK // (i * j))
        for start in range(0, rows, step):
            n = min(step, rows - start)
            points = [rng.random((k, n), np.float32) for k in (i, j) for _ in range(3)]
            started = time.process_time()
            _bare(points[:3], points[3:])
            seconds += time.process_time() - started
            tests += n * i * j
        # The shapes of the first blocks are those of all.
        if tests > most and seconds > 0.5:
            break
    return tests / max(seconds, 1e-9)


def _bare(a: list[np.ndarray], b: list[np.ndarray]) -> np.ndarray:
    """Whether segments cross a rectangle, from heights and coordinates (i, n) and (j, n) in its frame."""
    ha, hb = a[0][:, None], b[0][None]
    hit = ha * hb < 0
    span = np.abs(ha - hb)
    for xa, xb in zip(a[1:], b[1:], strict=True):
        x = ha * xb[None]
        x -= hb * xa[:, None]
        np.abs(x, out=x)
        hit &= x <= span
    return hit
