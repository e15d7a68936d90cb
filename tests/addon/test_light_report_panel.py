"""The operator of the light report writes its table, and the panel shows it."""

import csv
import io

import pytest


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
