"""False colours, elements and the estimated error: what would be drawn is what the last bake found."""

import math

import numpy as np
import pytest


@pytest.fixture
def baked(shop):
    from enfilade.addon import overlay

    made = shop.two_rooms()
    shop.bpy.context.scene.enfilade.solve.quality = "draft"
    shop.bpy.ops.enfilade.bake()
    yield made
    overlay.hide()


def content():
    from enfilade.addon import overlay

    return overlay.content()


def light(shop):
    from enfilade.addon import last_light

    return last_light.of(shop.bpy.context.scene)


def places(color, table):
    """Where on a table of colours each colour lies: (n,) 0..1, and how far beside it."""
    fine = np.linspace(0, 1, 2000)
    shades = np.stack([np.interp(fine, np.linspace(0, 1, len(table)), table[:, k]) for k in range(3)], 1)
    gap = np.linalg.norm(color[:, None] - shades[None], axis=2)
    return fine[gap.argmin(1)], gap.min(1)


@pytest.mark.parametrize("logarithmic", [False, True])
def test_false_colours_are_the_illuminance_on_the_scale_of_the_legend(shop, baked, logarithmic):
    from enfilade.addon.light_layers import SPECTRUM

    settings = shop.bpy.context.window_manager.enfilade_overlay
    settings.lux_top, settings.lux_logarithmic = 3000.0, logarithmic
    try:
        assert shop.bpy.ops.enfilade.false_color() == {"FINISHED"}
        (layer,) = content().layers
        assert content().scale.ticks[-1] == (1.0, "3,000 lux")
        mesh = light(shop).mesh
        lux = 179 * mesh.irradiance @ np.float64([0.2126, 0.7152, 0.0722])
        # The middles of triangles of small steps are drawn as they are: each must be found with its colour.
        drawn = {tuple(k): c for k, c in zip(np.round(layer.position.reshape(-1, 3, 3).mean(1), 4), layer.color[::3, :3], strict=True)}
        scaled = np.clip(1 + np.log10(np.maximum(lux, 1e-9) / 3000) / 3 if logarithmic else lux / 3000, 0, 1)
        even = np.flatnonzero(np.ptp(scaled, axis=1) < 0.05)
        found = [drawn[tuple(k)] for k in np.round(mesh.corner[even].astype(np.float32).mean(1), 4) if tuple(k) in drawn]
        kept = [j for j, k in zip(even, np.round(mesh.corner[even].astype(np.float32).mean(1), 4), strict=True) if tuple(k) in drawn]
        assert len(found) > 0.5 * len(even) > 20
        where, beside = places(np.array(found), SPECTRUM)
        assert beside.max() < 0.01
        assert where == pytest.approx(scaled[kept, 0], abs=2e-3)
        # What is drawn covers all that there is.
        corner = layer.position.reshape(-1, 3, 3)
        area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum() / 2
        assert area == pytest.approx(2 * (12 + 10 + 7.5) - 7.5 + 5.5 + 2 * (9 + 7.5 + 7.5) - 7.5 + 5.5 + 1, rel=1e-4)
    finally:
        settings.lux_top, settings.lux_logarithmic = 0.0, False


def test_the_scale_follows_its_settings_at_once(shop, baked):
    settings = shop.bpy.context.window_manager.enfilade_overlay
    shop.bpy.ops.enfilade.false_color()
    before = content()
    top = float(before.scale.ticks[-1][1].split()[0].replace(",", ""))
    lux = 179 * light(shop).mesh.irradiance @ np.float64([0.2126, 0.7152, 0.0722])
    assert 0.3 * lux.max() < top < 2 * lux.max()
    assert float(f"{top:.0e}") == top  # a round number
    settings.lux_top = 100.0
    try:
        assert content() is not before
        assert [text for _, text in content().scale.ticks] == ["0", "20", "40", "60", "80", "100 lux"]
        settings.lux_logarithmic = True
        assert [text for _, text in content().scale.ticks] == ["0.1", "0.3", "1", "3", "10", "30", "100 lux"]
        shop.bpy.ops.enfilade.show_clusters()
        shown = content()
        settings.lux_top = 200.0
        assert content() is shown
    finally:
        settings.lux_top, settings.lux_logarithmic = 0.0, False


def test_elements_have_rims_on_their_surfaces(shop, baked):
    assert shop.bpy.ops.enfilade.show_elements() == {"FINISHED"}
    faces, rims = content().layers
    mesh = light(shop).mesh
    assert content().title == f"{len(mesh.error):,} elements"
    assert len(faces.position) == 3 * len(mesh.corner)
    display = np.clip(mesh.exitance / math.pi, 0, 1).reshape(-1, 3)
    encoded = np.where(display <= 0.0031308, 12.92 * display, 1.055 * display ** (1 / 2.4) - 0.055)
    assert faces.color[:, :3] == pytest.approx(encoded, abs=1e-4)
    # Rims face as their surfaces do: both are hidden together.
    floor = np.abs(rims.position[:, 2] - 0.002).reshape(-1, 3).max(1) < 1e-5
    corner = rims.position.reshape(-1, 3, 3)[floor]
    assert len(corner) > 8
    assert (np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])[:, 2] > 0).all()


def test_errors_are_coloured_by_their_size(shop, baked):
    from enfilade.addon.light_layers import DOUBT, UNKNOWN

    assert shop.bpy.ops.enfilade.show_error() == {"FINISHED"}
    faces, _ = content().layers
    mesh = light(shop).mesh
    color, error = faces.color[::3, :3], mesh.error[mesh.element]
    known = np.isfinite(error)
    assert (color[~known] == np.float32(UNKNOWN)).all()
    where, beside = places(color[known], DOUBT)
    assert beside.max() < 0.01
    assert where == pytest.approx(np.clip(error[known] / 0.1, 0, 1), abs=2e-3)
    size = np.linalg.norm(np.cross(mesh.corner[:, 1] - mesh.corner[:, 0], mesh.corner[:, 2] - mesh.corner[:, 0]), axis=1)
    half = (
        100
        * error[known][np.argsort(error[known])][np.searchsorted(np.cumsum(size[known][np.argsort(error[known])]) / size[known].sum(), 0.5)]
    )
    assert f"half of the surface within {half:.2g} %" in content().title


def test_lengths_are_in_the_units_of_the_scene(shop, baked):
    shop.bpy.context.scene.unit_settings.scale_length = 0.01
    for thing in shop.bpy.context.scene.objects:
        thing.scale = (100, 100, 100)
    shop.bpy.ops.enfilade.bake()
    shop.bpy.ops.enfilade.false_color()
    assert content().layers[0].position.max(0) == pytest.approx([720, 300, 250], rel=1e-5)


def test_without_a_bake_it_says_what_to_do(shop, baked, tmp_path):
    bpy = shop.bpy
    bpy.ops.enfilade.clear()
    for name in ("false_color", "show_elements", "show_error"):
        with pytest.raises(RuntimeError, match="Bake first"):
            getattr(bpy.ops.enfilade, name)()
    bpy.ops.enfilade.bake()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    assert light(shop) is not None
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert light(shop) is None
