"""Elements as triangles: they cover each surface once, carry its light, and their error says where the light is wrong."""

from pathlib import Path

import numpy as np
import pytest
from enfilade.core.element_mesh import element_mesh
from enfilade.core.options import Options
from enfilade.core.pipeline import run, solve
from enfilade.core.scene_checks import check
from enfilade.core.scene_files import load_scene

BENCH = Path(__file__).resolve().parents[1] / "data" / "bench"


@pytest.fixture(scope="module")
def scene():
    return check(load_scene(BENCH / "two_rooms.npz"))[0]


@pytest.fixture(scope="module")
def solution(scene):
    return solve(scene, Options(quality="draft", reflected="elements"))


def areas(mesh):
    return 0.5 * np.linalg.norm(np.cross(mesh.corner[:, 1] - mesh.corner[:, 0], mesh.corner[:, 2] - mesh.corner[:, 0]), axis=1)


def test_elements_cover_every_room_once(solution):
    mesh = element_mesh(solution)
    regions = solution.regions
    assert len(mesh.error) == mesh.leaves == solution.forest.leaf.sum()
    for room in (0, 1):
        assert areas(mesh)[mesh.room[mesh.element] == room].sum() == pytest.approx(regions.area[regions.room == room].sum(), rel=1e-6)
    leaf = np.flatnonzero(solution.forest.leaf)
    assert np.bincount(mesh.element, areas(mesh), len(leaf)) == pytest.approx(solution.forest.area[leaf], rel=1e-4, abs=1e-9)


def test_their_mean_light_is_that_of_the_solution(solution):
    mesh, light = element_mesh(solution), solution.light
    leaf = np.flatnonzero(solution.forest.leaf)
    power = (solution.forest.mean(leaf, (light.direct + light.reflected)[leaf]) * solution.forest.area[leaf, None]).sum(0)
    assert (areas(mesh)[:, None] * mesh.irradiance.mean(1)).sum(0) == pytest.approx(power, rel=2e-3)
    region = light.region[leaf][mesh.element]
    expected = solution.regions.emission[region][:, None] + solution.regions.reflectance[region][:, None] * mesh.irradiance
    assert mesh.exitance == pytest.approx(expected, rel=1e-5)


def test_a_limit_gives_coarser_elements_of_the_same_surface(solution):
    whole, coarse = element_mesh(solution), element_mesh(solution, 400)
    assert len(coarse.error) <= 400 < len(whole.error)
    assert coarse.leaves == whole.leaves
    assert areas(coarse).sum() == pytest.approx(areas(whole).sum(), rel=1e-6)


def test_the_estimated_error_falls_with_the_quality_and_is_of_its_size(scene, solution):
    """The elements against a solution of three times the accuracy, point by point."""
    fine = solve(scene, Options(quality="good", reflected="elements"))
    errors = {}
    for name, one in (("draft", solution), ("good", fine)):
        mesh = element_mesh(one)
        weight = np.bincount(mesh.element, areas(mesh), len(mesh.error))
        known = np.isfinite(mesh.error)
        errors[name] = np.sqrt(np.average(mesh.error[known] ** 2, weights=weight[known]))
    assert errors["good"] < 0.8 * errors["draft"]
    forest = solution.forest
    leaf = np.flatnonzero(forest.leaf)
    uv = forest.box[leaf, :2] + 0.5 * forest.box[leaf, 2:]
    other, local = fine.forest.locate(forest.region[leaf], uv)
    from enfilade.core import basis

    def at(one, element, where):
        values = basis.evaluate(one.forest.order, where).astype(np.float32)
        return np.einsum("nm,nmc->n", values, (one.light.direct + one.light.reflected)[element]) / 3

    mesh = element_mesh(solution)
    both = np.isfinite(mesh.error) & fine.forest.leaf[other]
    true = np.abs(at(solution, leaf, np.full((len(leaf), 2), 0.5)) - at(fine, other, local))[both]
    room = solution.regions.room[forest.region[leaf]][both]
    for r in (0, 1):
        here = mesh.error[both][room == r]
        worst = here >= np.quantile(here, 0.8)
        assert true[room == r][worst].mean() > 2 * true[room == r][~worst].mean()


def test_the_light_so_far_grows_to_the_solution(scene, solution):
    seen = []
    steps = run(scene, Options(quality="draft", reflected="elements"))
    for step in steps:
        if step.so_far is not None:
            mesh = element_mesh(step.so_far())
            seen.append((areas(mesh)[:, None] * mesh.irradiance.mean(1)).sum())
    final = element_mesh(solution)
    assert len(seen) > 3
    assert 0 < seen[0] < 0.9 * seen[-1]
    assert (np.diff(seen) > -1e-3 * seen[-1]).all()
    assert seen[-1] == pytest.approx((areas(final)[:, None] * final.irradiance.mean(1)).sum(), rel=1e-2)
