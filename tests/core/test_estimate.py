"""The guess before a bake."""

from pathlib import Path

import pytest
from enfilade.core.estimate import SPREAD, estimate, in_words
from enfilade.core.options import Options
from enfilade.core.scene_files import load_scene
from scenery import box, scene_of

DATA = Path(__file__).resolve().parents[1] / "data"


def test_it_holds_for_a_house():
    """Solved on one core: 1.75 s at draft and 3.2 s at good, of which 0.4 s are the start of Python; 81 MB."""
    scene = load_scene(DATA / "scenes" / "fzk-haus.json")
    for quality, took in (("draft", 1.35), ("good", 2.8)):
        low, high = estimate(scene, Options(quality=quality), 0, 1).seconds
        assert low < took < high
    assert 40 < estimate(scene, Options(), 0, 1).megabytes < 160


def test_it_grows_with_rooms_quality_and_values():
    one = scene_of(box())
    four = scene_of([p + [3 * k, 0, 0] for k in range(4) for p in box()], room=[k for k in range(4) for _ in range(6)])
    few, more = (estimate(s, Options(), 0, 1) for s in (one, four))
    assert more.seconds[0] == pytest.approx(4 * few.seconds[0])
    assert estimate(one, Options(quality="fine"), 0, 1).seconds[0] > few.seconds[0]
    assert estimate(one, Options(), 10**6, 1).seconds[0] > 100 * few.seconds[0] / SPREAD
    assert estimate(one, Options(), 10**6, 1).megabytes > few.megabytes
    assert estimate(one, Options(min_element_size=1.0), 0, 1).seconds[0] < 0.01 * few.seconds[0]
    assert estimate(one, Options(), 0, 4).seconds[1] == few.seconds[1]


def test_it_says_what_it_rests_on():
    assert estimate(scene_of(box()), Options(), 24, 2).basis.startswith("For 6 polygons in 1 room and 24 values, ")


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.2, "1 s"), (7.8, "8 s"), (43, "40 s"), (150, "2 min"), (1500, "25 min"), (7300, "2 h"), (80_000, "22 h")]
)
def test_times_in_words(seconds, words):
    assert in_words(seconds) == words
