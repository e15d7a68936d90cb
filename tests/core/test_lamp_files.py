"""Lamps in scene files, and the checks of what is in them."""

from dataclasses import replace

import numpy as np
import pytest
from enfilade.core.lamps import Lamps
from enfilade.core.scene import SceneError
from enfilade.core.scene_checks import check
from enfilade.core.scene_files import load_scene, save_scene
from lamp_samples import area_lamp, even_sky, point_lamp, some_of_each, sun
from scenery import box, scene_of

ROOM = scene_of(box())


def assert_same(a, b):
    assert type(a) is type(b)
    if isinstance(a, np.ndarray):
        np.testing.assert_array_equal(a, b)
    elif isinstance(a, tuple) and a and not isinstance(a[0], str):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            assert_same(x, y)
    elif hasattr(a, "__dataclass_fields__"):
        for name in vars(a):
            assert_same(getattr(a, name), getattr(b, name))
    else:
        assert a == b


def test_lamps_of_all_kinds_load_back_equal(tmp_path):
    scene = replace(ROOM, lamps=some_of_each())
    save_scene(scene, tmp_path / "t.npz")
    assert_same(load_scene(tmp_path / "t.npz").lamps, scene.lamps)


def test_a_scene_without_lamps_has_no_word_of_them(tmp_path):
    save_scene(ROOM, tmp_path / "t.npz")
    with np.load(tmp_path / "t.npz") as file:
        assert not [key for key in file.files if key.startswith(("lamp", "area", "point", "sun", "sky"))]
    assert_same(load_scene(tmp_path / "t.npz").lamps, Lamps())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"lamps_version": np.array(2)}, "version 2"),
        ({"area_spread": np.zeros(2)}, "area_spread"),
        ({"point_distribution": np.array([3], np.int32)}, "distribution"),
        ({"point_ball": np.array([1])}, "truth"),
        ({"sun_toward": np.zeros((1, 2))}, "sun_toward"),
        ({"sky_radiance": np.zeros((2, 2))}, "sky_radiance"),
    ],
)
def test_damaged_lamps_are_named(tmp_path, change, said):
    save_scene(replace(ROOM, lamps=some_of_each()), tmp_path / "t.npz")
    with np.load(tmp_path / "t.npz") as file:
        arrays = dict(file)
    np.savez(tmp_path / "t.npz", **(arrays | change))
    with pytest.raises(SceneError, match=said):
        load_scene(tmp_path / "t.npz")


SQUARE = np.array([(0, 0, 1), (0, 1, 1), (1, 1, 1.0)])


@pytest.mark.parametrize(
    ("lamps", "said"),
    [
        (Lamps(area_lamp(SQUARE * np.nan)), "'panel'.*place"),
        (Lamps(area_lamp(SQUARE[[0, 1, 1]])), "'panel' has no area"),
        (Lamps(area_lamp(SQUARE, np.inf)), "'panel'.*power"),
        (Lamps(area_lamp(SQUARE, room=4)), "'panel'.*room"),
        (Lamps(area_lamp(SQUARE, spread=0.0)), "'panel'.*spread"),
        (Lamps(points=point_lamp((0, np.inf, 0))), "'bulb'.*place"),
        (Lamps(points=point_lamp((0, 0, 0), radius=-1)), "'bulb'.*radius"),
        (Lamps(suns=replace(sun((1, 0, 0)), toward=np.zeros((1, 3)))), "'sun'.*direction"),
        (Lamps(sky=even_sky(np.nan)), "'sky'"),
    ],
)
def test_impossible_lamps_are_refused_by_name(lamps, said):
    with pytest.raises(SceneError, match=said):
        check(replace(ROOM, lamps=lamps))


def test_negative_light_is_none_and_said():
    scene, findings = check(replace(ROOM, lamps=Lamps(points=point_lamp((0, 0, 0), (-1, 2, 0)), sky=even_sky(-1.0))))
    assert scene.lamps.points.intensity.tolist() == [[0, 2, 0]]
    assert (scene.lamps.sky.radiance == 0).all()
    assert ["bulb" in findings[0].message, "sky" in findings[1].message] == [True, True]
    assert "no_light" not in {f.kind for f in findings}


def test_a_lamp_is_light_enough():
    kinds = lambda lamps: {f.kind for f in check(replace(ROOM, lamps=lamps))[1]}  # noqa: E731
    assert "no_light" in kinds(Lamps())
    assert "no_light" in kinds(Lamps(sky=even_sky(0.0)))
    assert "no_light" not in kinds(Lamps(suns=sun((0, 0, 1))))
