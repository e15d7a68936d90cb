"""The tables of the paper: every row once, interrupted or not, and the figures where they belong."""

import csv
import io
import json

import pytest
from enfilade.docs import tables
from enfilade.docs.processes import RunError, run_module
from enfilade.docs.tables import tables_main

ARGUMENTS = ["--scenes", "test_scene", "labyrinth", "--scale", "1/27", "--quality", "draft", "--orderings", "random", "greedy_c"]


class Solver:
    """In place of solves: figures that tell from which row they are."""

    def __init__(self, stop=None, error=KeyboardInterrupt):
        self.rows, self.stop, self.error = [], stop, error

    def __call__(self, module, scene, scale, seed, options, err=None):
        if len(self.rows) == self.stop:
            raise self.error
        options = json.loads(options)
        self.rows.append((scene, options["emitters"], options["ordering"], options["memory"], options.get("store", "")))
        number = len(self.rows)
        report = {
            "polygons": 2171, "rooms": 24, "clusters": 226, "elements": 19_000, "links": 123_000, "iterations": 6,
            "pvs_polygons_max": {"clusters": 1726, "cells": 2109}[options["emitters"]],
            "seconds": {"merge": 0.0, "cluster": 12.0, "graph": 39.0, "solve": 3600.0 * number},
            "solve_seconds": {"light": 1.0, "link": 2.0, "shoot": 60.0 * number},
        }  # fmt: skip
        traffic = [{"limit": 1e6, "read": 5e6, "written": 4e6, "least": 3e6}]
        replay = {"shots": 1346, "set_bytes": 7e7, "all_bytes": 3e9, "links_bytes": 1e9, "links_read": 8e9, "traffic": traffic}
        return {"report": report, "base_bytes": 40_000_000, "peak_bytes": 40_000_000 + 1_000_000 * number, "replay": replay}


def run(monkeypatch, folder, solver, *more):
    monkeypatch.setattr(tables, "run_module", solver)
    out, err = io.StringIO(), io.StringIO()
    return tables_main(["--out", str(folder), *ARGUMENTS, *more], out, err), out.getvalue(), err.getvalue()


def table(folder, title):
    """The cells of the first table under a title."""
    lines = (folder / "tables.md").read_text().split(f"## {title}")[1].split("\n## ")[0].splitlines()
    return [[c.strip() for c in line.strip("|").split("|")] for line in lines if line.startswith("|") and not line.startswith("|---")]


def test_every_figure_stands_beside_that_of_the_paper(monkeypatch, tmp_path):
    solver = Solver()
    code, out, _ = run(monkeypatch, tmp_path, solver)
    assert code == 0
    assert out.count("written: ") == 2
    rows = table(tmp_path, "Table 8: time by ordering, Test scene")
    assert rows[0] == ["emitters", "RND", "GC"]
    assert rows[3] == ["cells, paper", "112h54", "79h16"]
    assert rows[4] == ["clusters, in all", "3h01", "4h01"]  # rows 3 and 4
    assert rows[6] == ["clusters, paper", "7h36", "4h39"]
    rows = table(tmp_path, "Table 9")
    assert rows[1] == ["Test scene", "2,171", "24", "226", "12 s", "39 s", "2,109", "1,726"]
    assert rows[4] == ["paper", "146,266", "182", "16,610", "69 s", "60 s", "25,000", "3,973"]
    rows = table(tmp_path, "Table 10")
    assert rows[1][:4] == ["Test scene (budget 73.4 MB)", "3.00 GB", "1.0 MB", "70.0 MB"]
    assert rows[2][6] == "70 Mb"
    # Rows 3 to 6 have no budget, cells after clusters in pairs of orderings; rows 9 and 10 have one.
    rows = table(tmp_path, "Clusters against cells")
    assert rows[1] == ["Test scene", "1.50", "1.50", "1.00", "1.00", "1.11"]
    assert rows[2] == ["paper", "17", "", "", "", "4.3"]
    traffic = list(csv.DictReader((tmp_path / "tables.csv").open()))
    assert {(t["read_bytes"], t["least_read_bytes"], t["links_read_bytes"]) for t in traffic} == {
        ("5000000.0", "3000000.0", "8000000000.0")
    }


def test_links_are_shared_by_orderings_and_by_nobody_else(monkeypatch, tmp_path):
    solver = Solver()
    run(monkeypatch, tmp_path, solver)
    assert len(solver.rows) == len(set(solver.rows)) == 2 + 4 + 2 + 4
    stores = {}
    for scene, emitters, ordering, memory, store in solver.rows:
        stores.setdefault(store, set()).add((scene, emitters, ordering, memory))
    shared = {store: rows for store, rows in stores.items() if len(rows) > 1 and store}
    assert len(shared) == 2
    assert all(len({row[:2] for row in rows}) == 1 and {row[3] for row in rows} == {0} for rows in shared.values())


def test_an_interrupted_command_goes_on_where_it_was(monkeypatch, tmp_path):
    first = Solver(stop=5)
    code, _, err = run(monkeypatch, tmp_path, first)
    assert code == 130
    assert "goes on from there" in err
    assert table(tmp_path, "Table 9")[1][0] == "Test scene"
    second = Solver()
    assert run(monkeypatch, tmp_path, second)[0] == 0
    assert len(set(first.rows + second.rows)) == len(first.rows) + len(second.rows) == 12


def test_what_is_wrong_is_one_sentence(monkeypatch, tmp_path):
    code, _, err = run(monkeypatch, tmp_path, Solver(stop=1, error=RunError("it ended with 2: no room")))
    assert (code, err.splitlines()[-1]) == (2, "enfilade: it ended with 2: no room")
    code, _, err = run(monkeypatch, tmp_path, Solver(), "--quality", "good")
    assert code == 2
    assert "other settings" in err
    assert run(monkeypatch, tmp_path, Solver(), "--scale", "much")[0] == 2


@pytest.mark.parametrize("emitters", ["clusters", "cells"])
def test_a_row_counts_what_its_shots_need(programs, emitters):
    # A room lights itself: a shot of more than there is must not build up.
    options = {"quality": "draft", "threads": 1, "emitters": emitters, "max_iterations": 40}
    found = run_module("enfilade.docs.tables_row", "test_scene", 1 / 72, 1, json.dumps(options))
    replay, report = found["replay"], found["report"]
    assert report["iterations"] < 40
    assert report["energy"]["absorbed"] + report["energy"]["escaped"] == pytest.approx(report["energy"]["emitted"], rel=0.02)
    assert found["peak_bytes"] > found["base_bytes"] > 0
    assert replay["shots"] >= report["iterations"] > 1
    assert 0 < replay["set_bytes"] < replay["all_bytes"]
    assert replay["links_read"] > replay["links_bytes"] > 0
    for traffic in replay["traffic"]:
        assert traffic["read"] >= traffic["least"] > 0
        assert traffic["read"] >= traffic["written"]
    reads = [traffic["least"] for traffic in replay["traffic"]]
    assert reads == sorted(reads, reverse=True)
    # Whatever the memory, everything is read once.
    assert reads[-1] >= replay["all_bytes"] - replay["links_bytes"] - 1e6


@pytest.mark.parametrize(("seconds", "text"), [(0.0123, "0.012 s"), (59.6, "60 s"), (120, "2 mn"), (7221, "2h00"), (285_360, "79h16")])
def test_times_are_written_as_in_the_paper(seconds, text):
    assert tables._time(seconds) == text
