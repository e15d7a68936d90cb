"""The one knob of a user, resolved."""

import dataclasses

import numpy as np
import pytest
from enfilade.core.options import Options
from enfilade.core.quality import tolerances
from enfilade.core.regions import merge
from scenery import box, scene_of

QUALITIES = ("draft", "good", "fine")


def test_better_qualities_allow_less():
    regions = merge(scene_of(box()))
    found = np.array([dataclasses.astuple(tolerances(Options(quality=q), regions)) for q in QUALITIES])
    found[:, -1] *= -1  # more rays
    assert (np.diff(found, axis=0) < 0).all()
    assert tolerances(Options(), regions) == tolerances(Options(quality="good"), regions)


@pytest.mark.parametrize("quality", QUALITIES)
def test_sizes_scale_with_the_scene_and_errors_do_not(quality):
    small, large = (tolerances(Options(quality=quality), merge(scene_of(box(high=(s, 2 * s, s))))) for s in (1.0, 10.0))
    assert large.min_size == pytest.approx(10 * small.min_size)
    assert dataclasses.replace(large, min_size=0, link_size=0) == dataclasses.replace(small, min_size=0, link_size=0)


def test_the_room_in_the_middle_sets_the_size():
    # A hall and a closet do not change what is fine enough for the rooms between.
    rooms = [box(high=(s, s, s)) for s in (0.2, 1.0, 30.0)]
    all_three = merge(scene_of([face for room in rooms for face in room], room=np.repeat([0, 1, 2], 6)))
    alone = merge(scene_of(rooms[1]))
    assert tolerances(Options(), all_three).min_size == pytest.approx(tolerances(Options(), alone).min_size)


def test_a_size_that_the_user_asks_for_is_taken():
    assert tolerances(Options(min_element_size=0.07), merge(scene_of(box()))).min_size == 0.07


def test_elements_that_speak_for_themselves_are_linked_as_finely_as_they_are_lit():
    regions = merge(scene_of(box()))
    alone, gathered = (tolerances(Options(reflected=r), regions) for r in ("elements", "gathered"))
    assert alone.link_size == alone.min_size == gathered.min_size
    assert gathered.link_size == 2 * gathered.min_size
