"""The operator of the light report writes its table, and the panel shows it."""

import csv
import io
import time

import pytest
from fake_window import Event, FakeWindow


@pytest.fixture
def lit(shop):
    shop.box((0, 0, 0), (4, 3, 2.5))
    light = shop.bpy.data.lights.new("Bulb", "POINT")
    light.energy = 100
    thing = shop.bpy.data.objects.new("Bulb", light)
    thing.location = (2, 1.5, 2)
    shop.bpy.context.scene.collection.objects.link(thing)
    shop.bpy.context.scene.enfilade.solve.quality = "draft"
    return shop


def test_a_table_as_text_and_as_file(lit, tmp_path):
    path = tmp_path / "light.csv"
    assert lit.bpy.ops.enfilade.light_report(filepath=str(path), height=1.0) == {"FINISHED"}
    text = lit.bpy.data.texts["Enfilade Illuminance.csv"].as_string()
    assert path.read_text() == text
    rows = list(csv.reader(io.StringIO(text)))
    assert [row[1] for row in rows[1:]] == ["floor", "walls", "ceilings", "work plane"]
    plane = rows[4]
    # Straight below the lamp, 1 m under it: P / (4 pi) / d2 by 179 lm/W, and the light of the walls on top.
    assert float(plane[5]) > 179 * 100 / 12.566
    from enfilade.addon.light_report import rows_of

    assert rows_of(text)[3] == (plane[0], "work plane", plane[3], plane[4], plane[6])


def test_a_closed_room_has_no_daylight(lit):
    assert lit.bpy.ops.enfilade.light_report(what="daylight") == {"FINISHED"}
    rows = list(csv.reader(io.StringIO(lit.bpy.data.texts["Enfilade Daylight Factor.csv"].as_string())))
    assert rows[0][3] == "average (%)"
    assert {float(row[5]) for row in rows[1:]} == {0.0}


def test_a_file_that_cannot_be_written_is_one_sentence(lit):
    with pytest.raises(RuntimeError, match="cannot be written"):
        lit.bpy.ops.enfilade.light_report(filepath="/nowhere/at/all.csv")
    # The table is not lost with it.
    assert "Enfilade Illuminance.csv" in lit.bpy.data.texts


class FakeOperator:
    """The methods of the operator on a plain object: Blender makes instances itself, in a window only."""

    def __init__(self, what="illuminance"):
        from enfilade.addon.light_report import ENFILADE_OT_light_report

        self.said, self.what, self.height, self.border, self.filepath = [], what, 0.8, 0.5, ""
        for name in ("begin", "modal", "cancel", "_task", "_show_progress", "_refuse", "_write"):
            setattr(self, name, getattr(ENFILADE_OT_light_report, name).__get__(self))

    def report(self, kind, text):
        self.said.append((next(iter(kind)), text))


@pytest.mark.parametrize("what", ["illuminance", "daylight"])
def test_beside_a_window_it_is_the_same_table(lit, what):
    from enfilade.addon.light_report import TEXTS

    assert lit.bpy.ops.enfilade.light_report(what=what) == {"FINISHED"}
    straight = lit.bpy.data.texts[TEXTS[what]].as_string()
    lit.bpy.data.texts[TEXTS[what]].clear()
    window, operator = FakeWindow(lit.bpy), FakeOperator(what)
    assert operator.begin(window) == {"RUNNING_MODAL"}
    outcome, deadline = {"PASS_THROUGH"}, time.monotonic() + 60
    while outcome == {"PASS_THROUGH"} and time.monotonic() < deadline:
        time.sleep(0.02)
        outcome = operator.modal(window, Event("TIMER"))
    assert outcome == {"FINISHED"}, operator.said
    assert window.status is None
    assert window.handlers == []
    assert lit.bpy.data.texts[TEXTS[what]].as_string() == straight


def test_escape_leaves_the_table_as_it_was(lit):
    window, operator = FakeWindow(lit.bpy), FakeOperator()
    operator.begin(window)
    assert operator.modal(window, Event("ESC", "PRESS")) == {"CANCELLED"}
    operator._worker.join(60)
    assert operator._worker.done
    assert window.status is None
    assert "Enfilade Illuminance.csv" not in lit.bpy.data.texts


def test_what_is_refused_is_one_sentence(lit):
    lit.bpy.context.scene.enfilade.solve.quality = "good"
    for thing in list(lit.bpy.data.objects):
        lit.bpy.data.objects.remove(thing)
    operator = FakeOperator()
    assert operator.begin(FakeWindow(lit.bpy)) == {"CANCELLED"}
    assert operator.said[0][0] == "ERROR"
