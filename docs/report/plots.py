"""Time against error as pictures, both axes logarithmic."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from .curves import Point
from .plan import WAYS

_STYLES = {
    "Enfilade": ("#c8501e", "o"),
    f"Cycles, {WAYS['points']}": ("#3b6ea5", "s"),
    f"Cycles, {WAYS['vertices']}": ("#7a9e3f", "D"),
    f"Cycles, {WAYS['texels']}": ("#b09ac8", "^"),
    f"Cycles, {WAYS['denoised']}": ("#7a4fa8", "v"),
}


def draw(scene: str, lines: dict[str, list[Point]], path: Path) -> None:
    """Save the curves of one scene, over all points and, where there are any, in rooms with no lamp."""
    panels = [("rmse", "all points")]
    if next(iter(lines.values()))[0].score["dark_rmse"] is not None:
        panels.append(("dark_rmse", "rooms with no lamp"))
    figure = Figure(figsize=(4.6 * len(panels) + 0.4, 4.2), layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axis, (error, title) in zip(axes, panels, strict=True):
        for name, points in lines.items():
            colour, mark = _STYLES[name]
            points = sorted(points, key=lambda p: p.seconds)
            style = {"linewidth": 2.2, "zorder": 3} if name == "Enfilade" else {"linewidth": 1.2}
            x, y = [p.seconds for p in points], [100 * p.score[error] for p in points]
            axis.loglog(x, y, marker=mark, markersize=5, color=colour, label=name, **style)
        axis.axhline(100 * next(iter(lines.values()))[0].score[error.replace("rmse", "noise")], color="0.6", linestyle=":", linewidth=1)
        axis.set(xlabel="seconds", ylabel="relative RMSE, %", title=f"{scene}, {title}")
        axis.grid(True, which="major", color="0.85", linewidth=0.6)
        for side in (axis.xaxis, axis.yaxis):
            side.set_major_locator(LogLocator(subs=(1, 2, 5)))
            side.set_major_formatter(FormatStrFormatter("%g"))
            side.set_minor_formatter(NullFormatter())
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(panels), fontsize=8, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, metadata={"Software": None})
