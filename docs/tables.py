"""``python -m enfilade tables``: tables 8, 9 and 10 of the paper for scenes of the same size, beside the paper's figures.

Every figure comes from a solve of its own, in a process of its own. What is finished is kept in the folder, and the tables are
written anew after every solve: an interrupted command goes on where it was.
"""

from __future__ import annotations

import csv
import io
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, TextIO

from ..core.arguments import Parser, format_size, parse_size
from ..core.options import ORDERINGS, OptionError
from ..core.progress import words
from .processes import RunError, machine, run_module

SCENES = {"test_scene": "Test scene", "labyrinth": "Labyrinth", "octogon": "Octogon"}
SHORT = dict(zip(ORDERINGS, ("RND", "ME", "GS", "GC", "BS", "BC", "TS"), strict=True))
PAPER_ORDERINGS = {
    "cells": ("112h54", "132h34", "100h46", "79h16", "108h36", "97h12", "56h30"),
    "clusters": ("7h36", "9h20", "5h21", "4h39", "45h54", "32h30", "several days"),
}
"""Table 8 of the paper, its Test scene."""
PAPER = {
    "test_scene": (58_608, 648, 4_759, "15 s", "39 s", "3 Gb", "300 Mb", "79h16", "70 Mb", "4h39", 3_250, 808),
    "labyrinth": (146_266, 182, 16_610, "69 s", "60 s", "7.3 Gb", "1.5 Gb", "-", "250 Mb", "45h06", 25_000, 3_973),
    "octogon": (277_942, 28, 3_690, "120 mn 21 s", "20 s", "13.9 Gb", "7.3 Gb", "-", "5.7 Gb", "-", 146_286, 114_542),
}
"""Polygons, rooms, clusters, seconds of clustering and of visibility (table 9); estimated memory of all, memory with rooms and time,
memory with clusters and time (table 10, Greedy C); polygons of the largest potentially visible sets of a room and of a cluster."""

PAPER_RATIOS = {
    "test_scene": ("17", "", "", "", "4.3"),
    "labyrinth": ("", "", "", "", "6.0"),
    "octogon": ("", "", "", "", "1.3"),
}
"""Time and memory with rooms over those with clusters, from the same tables."""


@dataclass(frozen=True)
class Row:
    """One solve. ``memory`` 0: without budget, ``kept``: links are taken from, and left for, other rows of the same emitters."""

    scene: str
    emitters: str
    ordering: str
    memory: int
    kept: bool

    @property
    def name(self) -> str:
        size = f"-{format_size(self.memory)}" if self.memory else ""
        return f"{self.scene}-{self.emitters}-{self.ordering}{size}{'' if self.kept else '-alone'}"


def tables_main(argv: Sequence[str], out: TextIO | None = None, err: TextIO | None = None) -> int:
    """Run ``tables`` with its arguments and return the exit code: 0, 2 after one sentence of what is wrong, 130 when interrupted."""
    out, err = out or sys.stdout, err or sys.stderr
    folder = None
    try:
        given = _parser().parse_args(argv)
        folder, settings = given.out, _settings(given)
        rows = list(_rows(given))
        folder.mkdir(parents=True, exist_ok=True)
        results = {}
        begin, spent = time.monotonic(), 0
        for number, row in enumerate(rows):
            file = folder / f"{row.name}.json"
            results[row] = kept(file, settings)
            if results[row] is None:
                left = f", about {words((time.monotonic() - begin) / spent * (len(rows) - number))}" if spent else ""
                err.write(f"{number + 1} of {len(rows)}: {row.name}{left}\n")
                results[row] = _solve(row, given, folder, settings, err)
                write_whole(file, json.dumps(results[row], indent=1))
                spent += 1
            _write(folder, results, settings)
    except SystemExit as leave:  # --help
        return int(leave.code or 0)
    except KeyboardInterrupt:
        err.write(f"enfilade: interrupted, what is finished is in {folder}; the same command goes on from there\n")
        return 130
    except (OptionError, RunError, OSError) as error:
        err.write(f"enfilade: {error}\n")
        return 2
    out.write(f"written: {folder / 'tables.md'}\nwritten: {folder / 'tables.csv'}\n")
    return 0


def _parser() -> Parser:
    parser = Parser(prog="enfilade tables", description=__doc__)
    parser.add_argument("--out", metavar="FOLDER", type=Path, required=True, help="folder for tables.md, tables.csv and all figures")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES), help="scenes to solve [all]")
    parser.add_argument("--scale", type=Fraction, default=Fraction(1), help="part of the rooms and polygons of each scene, such as 1/8 [1]")
    parser.add_argument("--quality", choices=("draft", "good", "fine"), default="good", help="target error of the light [good]")
    parser.add_argument("--orderings", nargs="+", choices=ORDERINGS, default=list(ORDERINGS), help="orderings of table 8 [all]")
    parser.add_argument("--memory", type=parse_size, default=parse_size("70M"), help="budget of the runs with little memory [70M]")
    parser.add_argument("--threads", type=int, default=0, help="workers; 0 uses every core [0]")
    parser.add_argument("--seed", type=int, default=1, help="seed of the scenes [1]")
    return parser


def _settings(given: Any) -> dict[str, Any]:
    return {"scale": str(given.scale), "quality": given.quality, "threads": given.threads, "seed": given.seed}


def _rows(given: Any) -> Iterator[Row]:
    """The cheapest first. All orderings for the first scene, as in the paper; Greedy C for all."""
    for scene in given.scenes:
        yield Row(scene, "clusters", "greedy_c", 0, False)
    for scene in given.scenes:
        for emitters in ("clusters", "cells"):
            orderings = given.orderings if scene == given.scenes[0] else [o for o in given.orderings if o == "greedy_c"]
            yield from (Row(scene, emitters, ordering, 0, True) for ordering in orderings)
    for scene in given.scenes:
        for emitters in ("clusters", "cells"):
            yield Row(scene, emitters, "greedy_c", given.memory, False)


def kept(path: Path, settings: dict[str, Any]) -> dict[str, Any] | None:
    """The figures of a row that was finished before."""
    if not path.exists():
        return None
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
        same = result["settings"] == settings
    except (ValueError, KeyError, TypeError) as error:
        raise OptionError(f"{path}: these figures cannot be read, delete this file and run again") from error
    if not same:
        raise OptionError(f"{path}: these figures are of other settings ({result['settings']}), name another folder")
    return result


def _solve(row: Row, given: Any, folder: Path, settings: dict[str, Any], err: TextIO) -> dict[str, Any]:
    options: dict[str, Any] = {
        "quality": given.quality, "threads": given.threads, "emitters": row.emitters, "ordering": row.ordering, "memory": row.memory,
    }  # fmt: skip
    if row.kept or row.memory:
        options["store"] = str(folder / f"store-{row.scene}-{row.emitters}{'' if row.kept else '-alone'}")
    started = time.monotonic()
    shown = err if hasattr(err, "fileno") else None
    result = run_module("enfilade.docs.tables_row", row.scene, float(given.scale), given.seed, json.dumps(options), err=shown)
    return result | {"row": asdict(row), "settings": settings, "wall": time.monotonic() - started}


# ------------------------------------------------------------------------------------------------ the tables


def _write(folder: Path, results: dict[Row, dict[str, Any]], settings: dict[str, Any]) -> None:
    write_whole(folder / "tables.md", "\n".join(_markdown(results, settings)) + "\n")
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(_COLUMNS)
    for row, result in results.items():
        writer.writerows(_lines(row, result))
    write_whole(folder / "tables.csv", text.getvalue())


_COLUMNS = (
    "scene", "emitters", "ordering", "budget_bytes", "polygons", "rooms", "clusters", "elements", "links", "iterations", "shots",
    "cluster_seconds", "graph_seconds", "solve_seconds", "shoot_seconds", "peak_above_base_bytes", "largest_set_bytes", "all_bytes",
    "largest_pvs_polygons", "memory_limit_bytes", "read_bytes", "written_bytes", "least_read_bytes", "links_read_bytes",
)  # fmt: skip


def _lines(row: Row, result: dict[str, Any]) -> Iterator[list[Any]]:
    report, replay = result["report"], result["replay"]
    seconds = report["seconds"]
    for traffic in replay["traffic"]:
        yield [
            row.scene, row.emitters, row.ordering, row.memory, report["polygons"], report["rooms"], report["clusters"], report["elements"],
            report["links"], report["iterations"], replay["shots"], seconds["cluster"], seconds["graph"], seconds["solve"],
            report["solve_seconds"]["shoot"], _above_base(result), replay["set_bytes"], replay["all_bytes"], report["pvs_polygons_max"],
            traffic["limit"], traffic["read"], traffic["written"], traffic["least"], replay["links_read"],
        ]  # fmt: skip


def _above_base(result: dict[str, Any]) -> int:
    return result["peak_bytes"] - result["base_bytes"]


def _markdown(results: dict[Row, dict[str, Any]], settings: dict[str, Any]) -> Iterator[str]:
    here = machine()
    yield f"Scale {settings['scale']}, quality {settings['quality']}; {here['cores']} cores of {here['processor']}."
    yield from _table_8(results)
    yield from _table_9(results)
    yield from _table_10(results)
    yield from _ratios(results)
    yield from _traffic(results)


def _table_8(results: dict[Row, dict[str, Any]]) -> Iterator[str]:
    """Seconds of a whole solve, linking included, by ordering."""
    for scene in dict.fromkeys(row.scene for row in results):
        found = {(row.emitters, row.ordering): result for row, result in results.items() if row.scene == scene and row.kept}
        orderings = [o for o in ORDERINGS if any(key[1] == o for key in found)]
        if not orderings:
            continue
        yield f"\n## Table 8: time by ordering, {SCENES[scene]}\n"
        yield "| emitters | " + " | ".join(SHORT[o] for o in orderings) + " |"
        yield "|---" * (len(orderings) + 1) + "|"
        for emitters in ("cells", "clusters"):
            for what, pick in (("in all", _seconds), ("shooting alone", lambda r: r["report"]["solve_seconds"]["shoot"])):
                cells = [_time(pick(found[emitters, o])) if (emitters, o) in found else "" for o in orderings]
                yield f"| {emitters}, {what} | " + " | ".join(cells) + " |"
            if scene == "test_scene":
                paper = dict(zip(ORDERINGS, PAPER_ORDERINGS[emitters], strict=True))
                yield f"| {emitters}, paper | " + " | ".join(paper[o] for o in orderings) + " |"


def _table_9(results: dict[Row, dict[str, Any]]) -> Iterator[str]:
    yield "\n## Table 9: clusters and their visibility\n"
    yield "| scene | polygons | rooms | clusters | clustering | visibility | largest PVS of a cell | of a cluster |"
    yield "|---|---|---|---|---|---|---|---|"
    for scene, rows in _by_scene(results):
        report = next(iter(rows.values()))["report"]
        seconds = report["seconds"]
        largest = {row.emitters: _count(result["report"]["pvs_polygons_max"]) for row, result in rows.items()}
        yield cells(
            SCENES[scene], _count(report["polygons"]), _count(report["rooms"]), _count(report["clusters"]), _time(seconds["cluster"]),
            _time(seconds["graph"]), largest.get("cells", ""), largest.get("clusters", ""),
        )  # fmt: skip
        p = PAPER[scene]
        yield cells("paper", *map(_count, p[:3]), p[3], p[4], _count(p[10]), _count(p[11]))


def _table_10(results: dict[Row, dict[str, Any]]) -> Iterator[str]:
    yield "\n## Table 10: memory and time, Greedy C\n"
    yield "Largest set: elements, light and links that the largest shot needs. Peak: resident memory above that of the interpreter.\n"
    yield "| scene | whole | peak without budget | cells: largest set | peak | time | clusters: largest set | peak | time |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for scene, rows in _by_scene(results):
        whole = next((r for row, r in rows.items() if not row.kept and not row.memory), None)
        figures = [_size(whole["replay"]["all_bytes"]), _size(_above_base(whole))] if whole else ["", ""]
        budget = ""
        for emitters in ("cells", "clusters"):
            tight = next((r for row, r in rows.items() if row.memory and row.emitters == emitters), None)
            free = next((r for row, r in rows.items() if row.kept and row.emitters == emitters and row.ordering == "greedy_c"), tight)
            figures.append(_size(free["replay"]["set_bytes"]) if free else "")
            figures += [_size(_above_base(tight)), _time(_seconds(tight))] if tight else ["", ""]
            budget = f" (budget {_size(tight['row']['memory'])})" if tight else budget
        yield cells(SCENES[scene] + budget, *figures)
        p = PAPER[scene]
        yield cells("paper", p[5], "", p[6], "", p[7], p[8], "", p[9])


def _ratios(results: dict[Row, dict[str, Any]]) -> Iterator[str]:
    """How many times as much cells take as clusters."""
    yield "\n## Clusters against cells, Greedy C\n"
    yield "What cells take, as a multiple of what clusters take; peaks under the same budget.\n"
    yield "| scene | time in all | shooting alone | links read | largest set | peak |"
    yield "|---|---|---|---|---|---|"
    for scene, rows in _by_scene(results):
        free = {row.emitters: result for row, result in rows.items() if row.kept and row.ordering == "greedy_c"}
        tight = {row.emitters: result for row, result in rows.items() if row.memory}
        yield cells(
            SCENES[scene], _ratio(free, _seconds), _ratio(free, lambda r: r["report"]["solve_seconds"]["shoot"]),
            _ratio(free, lambda r: r["replay"]["links_read"]), _ratio(free, lambda r: r["replay"]["set_bytes"]), _ratio(tight, _above_base),
        )  # fmt: skip
        yield cells("paper", *PAPER_RATIOS[scene])


def _ratio(found: dict[str, dict[str, Any]], pick: Callable[[dict[str, Any]], float]) -> str:
    return f"{pick(found['cells']) / max(pick(found['clusters']), 1e-300):.2f}" if len(found) == 2 else ""


def _traffic(results: dict[Row, dict[str, Any]]) -> Iterator[str]:
    yield "\n## Read and written by ordering and memory\n"
    yield (
        "Elements and light of emitters, when a part of all fits in memory and the least recently used leaves first; least: what has to "
        "be read for this order whatever leaves (Belady). Links are read once for every shot, from front to back, in all cases.\n"
    )
    yield "| scene | emitters | ordering | shots | links read | memory | read | least | written |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for row, result in results.items():
        if not row.kept:
            continue
        replay = result["replay"]
        for k, traffic in enumerate(replay["traffic"]):
            head = [SCENES[row.scene], row.emitters, SHORT[row.ordering], _count(replay["shots"]), _size(replay["links_read"])]
            sizes = [_size(traffic[name]) for name in ("limit", "read", "least", "written")]
            yield cells(*(head if k == 0 else [""] * 5), *sizes)


def _by_scene(results: dict[Row, dict[str, Any]]) -> Iterator[tuple[str, dict[Row, dict[str, Any]]]]:
    for scene in dict.fromkeys(row.scene for row in results):
        yield scene, {row: result for row, result in results.items() if row.scene == scene}


def cells(*texts: str) -> str:
    return "| " + " | ".join(texts) + " |"


def _seconds(result: dict[str, Any]) -> float:
    return sum(result["report"]["seconds"].values())


def _time(seconds: float) -> str:
    """Seconds as the paper writes long times, and short ones to two digits."""
    if seconds < 100:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} mn" if minutes < 100 else f"{minutes // 60}h{minutes % 60:02d}"


def _size(count: float) -> str:
    return f"{count / 1e9:.2f} GB" if count >= 1e9 else f"{count / 1e6:.1f} MB"


def _count(number: int) -> str:
    return f"{number:,}"


def write_whole(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    part = path.with_name(path.name + ".part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)


if __name__ == "__main__":
    sys.exit(tables_main(sys.argv[1:]))
