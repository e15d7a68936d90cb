"""Where the power of every shooter goes, whether exchanges are the same both ways, and what was set to zero."""

from __future__ import annotations

import numpy as np

from ...core.links import directions, received
from ...core.occlusion import first_hits, kronecker
from ...core.options import Options
from ..bench import Bench
from .tables import Table, met
from .witness import WAYS, Solved, light_of, solve_and_keep

RAYS = 1 << 16
"""Rays that tell how much of the light of one shooter is lost: a thousandth of its power and better."""


def measure(quick: bool) -> Table:
    """Energy of the clusters of closed, open and connected rooms at good."""
    rows, worst, mean, uneven, dark, clamped = [], 0.0, 0.0, 0.0, 0, 0
    for name in ("cornell",) if quick else ("cornell", "furnace", "two_rooms"):
        bench = Bench(name)
        solved = solve_and_keep(bench.scene, Options(quality="draft" if quick else "good", threads=1))
        shot, arrived, lost = balance(solved)
        error = np.abs(shot - arrived - lost) / shot
        difference = asymmetry(solved)
        light = {way: _light(bench, solved, way) for way in WAYS}
        negative = sum(int((e < 0).sum()) for e, _ in light.values())
        count = ", ".join(f"{n} {way}" for way, (_, n) in light.items())
        share = f"{float(lost.sum() / shot.sum()):.2%}"
        total = float(abs(shot.sum() - arrived.sum() - lost.sum()) / shot.sum())
        rows.append([name, str(len(shot)), share, f"{total:.1e}", f"{error.max():.1e}", f"{difference:.0e}", str(negative), count])
        worst, mean = max(worst, float(error.max())), max(mean, total)
        uneven, dark = max(uneven, difference), dark + negative
        clamped += sum(n for _, n in light.values())
    return Table(
        "Energy",
        "Every cluster shoots the light that it has in the end, once. What arrives is summed over its links with the closing "
        f"gains; what is lost is told by {RAYS:,} rays for each cluster, which know nothing of links. Power between regions both ways, "
        "in float64, before the gains. Values at the points of the scene below zero, after the bake "
        "and set to zero before it, with the reflected light gathered and with that of the elements.",
        [
            "scene",
            "shooters",
            "lost",
            "shot - received - lost over shot, all",
            "worst shooter",
            "not reciprocal",
            "negative",
            "set to zero",
        ],
        rows,
        [
            [
                "shot = received + lost, for every shooter, over what it shot",
                "1e-3",
                f"{worst:.1e} (all together {mean:.1e})",
                met(worst <= 1e-3),
            ],
            [
                "reciprocity of exchanges in float64, relative",
                "1e-12",
                f"{uneven:.0e}",
                met(uneven < 1e-12),
            ],
            ["negative values after the bake", "0", f"{dark} ({clamped} set to zero)", met(dark == 0)],
        ],
    )


def balance(solved: Solved) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """W, first channel, of every cluster that shoots anything: shot, received by others over links, lost by rays."""
    forest, building = solved.forest, solved.building
    everything, leaf = np.arange(len(forest)), np.flatnonzero(forest.leaf)
    light = solved.solution.light
    reflectance = building.regions.reflectance[forest.region, 0]
    exitance = ((light.direct + light.reflected)[..., :1] * reflectance[:, None, None]).astype(np.float32)
    gained = forest.from_nodes(everything, forest.at_nodes(everything, exitance) * solved.gains.sent[..., None])
    power = (forest.at_nodes(everything, exitance)[..., 0] * forest.node_weights).astype(float)
    unit = building.clusters.cluster_of[forest.region]
    shot = np.bincount(unit[leaf], power[leaf].sum(1), minlength=len(building.clusters))
    shooters = np.flatnonzero(shot > 1e-6 * shot.sum())
    arrived, lost = np.zeros(len(shooters)), np.zeros(len(shooters))
    for k, shooter in enumerate(shooters):
        sent = forest.pull(np.where(((unit == shooter) & forest.leaf)[:, None, None], gained, np.float32(0)))
        nodes = forest.at_nodes(everything, received(forest, solved.links, sent))[leaf, :, 0].astype(float)
        arrived[k] = (nodes * solved.gains.received[leaf] * forest.node_weights_of(leaf)).sum()
        own = leaf[unit[leaf] == shooter]
        lost[k] = shot[shooter] * _lost_share(solved, own, power[own])
    return shot[shooters], arrived, lost


def _lost_share(solved: Solved, elements: np.ndarray, power: np.ndarray) -> float:
    """Part of the power (n, q*q) of the nodes of elements (n,) that meets no front of a surface."""
    forest, building = solved.forest, solved.building
    running = np.cumsum(np.maximum(power, 0).reshape(-1))
    k = np.arange(RAYS)
    chosen = np.minimum(np.searchsorted(running, (k + 0.5) / RAYS * running[-1]), len(running) - 1)
    element, node = elements[chosen // forest.node_count], chosen % forest.node_count
    first, second = kronecker(k * 7919 % RAYS)
    radius, angle = np.sqrt(first), 2 * np.pi * second
    local = radius * np.cos(angle), radius * np.sin(angle), np.sqrt(np.maximum(1 - first, 0))
    r, region = building.regions, forest.region[element]
    direction = sum(x[:, None] * axis[region] for x, axis in zip(local, (r.u, r.v, r.normal), strict=True)).astype(np.float32)
    hits = first_hits(building.blockers, forest.node_of(element, node), direction)
    return float(((hits.blocker < 0) | hits.behind).mean())


def asymmetry(solved: Solved) -> float:
    """Largest difference of the power between two regions one way and the other, for exitance 1 of all, over the largest power."""
    forest = solved.forest
    count = len(forest.regions)
    power = np.zeros(count * count)
    for group in solved.links:
        for source, receiver, exchange in directions(group):
            weight = [_weights(forest, e, n) for e, n in ((receiver, exchange.shape[1]), (source, exchange.shape[2]))]
            watts = np.einsum("ni,nij,nj->n", weight[0], exchange.astype(float), weight[1])
            power += np.bincount(forest.region[receiver] * count + forest.region[source], watts, minlength=count * count)
    power = power.reshape(count, count)
    return float(np.abs(power - power.T).max() / max(power.max(), 1e-300))


def _weights(forest, elements: np.ndarray, nodes: int) -> np.ndarray:
    """(n, nodes) float64 m2 that each node of a link stands for."""
    weights = forest.node_weights_of(elements).astype(float)
    return weights if nodes > 1 else weights.sum(1, keepdims=True)


def _light(bench: Bench, solved: Solved, way: str) -> tuple[np.ndarray, int]:
    """Irradiance at the points of the scene, and how many of its values were set to zero."""
    report = solved.solution.report
    before = report["clamped_values"]
    light = light_of(solved.solution, bench.scene.points, way)
    return light, report["clamped_values"] - before
