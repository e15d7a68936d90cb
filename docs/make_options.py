# SPDX-License-Identifier: GPL-3.0-or-later
"""Write docs/options.md from the options dataclasses: ``python -m enfilade.docs.make_options``."""

from __future__ import annotations

from pathlib import Path

from ..core.arguments import format_size
from ..core.options import BakeOptions, OptionInfo, Options, describe

PAGE = Path(__file__).resolve().with_name("options.md")
HEAD = """\
# Options

Written by `docs/make_options.py` from `core/options.py`. The same names serve the command line (`--min-element-size`),
plain Python (`Options(min_element_size=...)`) and the panel in Blender.
"""
SECTIONS = (
    (Options, "How a scene is solved", "`enfilade solve`, `enfilade bake`, `core.options.Options`"),
    (BakeOptions, "Where the light goes", "`enfilade bake`, `core.options.BakeOptions`"),
)


def page() -> str:
    """The whole page as Markdown."""
    parts = [HEAD]
    for cls, title, doors in SECTIONS:
        rows = "\n".join(_row(info) for info in describe(cls))
        parts.append(f"## {title}\n\n{doors}\n\n| option | default | takes | what it does |\n|---|---|---|---|\n{rows}\n")
    return "\n".join(parts)


def _row(info: OptionInfo) -> str:
    return f"| `{info.flag}` | {_default(info)} | {_takes(info)} | {info.help} |"


def _default(info: OptionInfo) -> str:
    if info.kind == "size":
        return format_size(info.default)
    return {True: "yes", False: "no", "": ""}.get(info.default, str(info.default)) if info.kind in ("bool", "path") else str(info.default)


def _takes(info: OptionInfo) -> str:
    if info.kind == "choice":
        return ", ".join(f"`{choice}`" for choice in info.choices)
    if info.kind == "bool":
        return f"`{info.flag}` or `--no-{info.flag[2:]}`"
    if info.kind == "path":
        return "a folder"
    if info.kind == "name":
        return "a name"
    if info.kind == "size":
        return "a size such as `500M` or `2G`"
    whole = "a whole number" if info.kind == "int" else "a number"
    limits = f"from {info.minimum:,.10g}" + (f" to {info.maximum:,.10g}" if info.maximum is not None else "")
    return f"{whole} {limits} {info.unit}".rstrip()


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
