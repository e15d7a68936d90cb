"""Every choice a user can make, once: name, type, default, range, unit and a sentence of help.

The Python API takes these dataclasses; the command line, the Blender properties and the table in the
documentation are made from their fields (see :func:`describe`), so that a new option is written here only.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

VOLUMES = ("windows", "boxes")
ORDERINGS = ("random", "max_energy", "greedy_s", "greedy_c", "backtrack_s", "backtrack_c", "traveling_salesman")
DISTANCES = (
    "barycenter",
    "closest_vertex",
    "orthogonal",
    "volume_increase",
    "area_increase",
    "reflectance",
    "emission",
    "orientation",
)
SEEDINGS = ("spread", "random")


class OptionError(ValueError):
    """An option has a value that it cannot have; the message names the option and what it takes."""


@dataclass(frozen=True)
class OptionInfo:
    """What a door (command line, panel, documentation) needs to know of one option.

    ``kind`` is ``"choice"``, ``"int"``, ``"float"``, ``"bool"``, ``"size"`` (bytes) or ``"path"``.
    """

    name: str
    kind: str
    default: Any
    help: str
    unit: str = ""
    choices: tuple[str, ...] = ()
    minimum: float | None = None
    maximum: float | None = None
    flag: str = ""


def _option(default: Any, kind: str, help: str, **details: Any) -> Any:
    return field(default=default, metadata={"kind": kind, "help": help, **details})


def _choice(default: str, choices: tuple[str, ...], help: str, **details: Any) -> Any:
    return _option(default, "choice", help, choices=choices, **details)


@dataclass(frozen=True)
class Options:
    """How a scene is solved. Raises :class:`OptionError` when a value is out of its range."""

    quality: str = _choice("good", ("draft", "good", "fine"), "Target error of the light: draft 10 %, good 3 %, fine 1 %")
    order: int = _option(2, "int", "Order of the multi-wavelet basis: 1 constant, 2 linear, 3 quadratic", minimum=1, maximum=3)
    average: int = _option(50, "int", "Average number of polygons in a cluster", minimum=1, maximum=100_000)
    distance: str = _choice("barycenter", DISTANCES, "Distance between a polygon and a cluster")
    reflectance_weight: float = _option(
        0.0, "float", "Added to the distance for a difference of 1 in reflectance", unit="m", minimum=0.0, maximum=1e6
    )
    emission_weight: float = _option(
        0.0, "float", "Added to the distance for a difference of 1 W/m2 in emitted exitance", unit="m", minimum=0.0, maximum=1e6
    )
    orientation_weight: float = _option(
        0.0, "float", "Added to the distance for a difference of 1 (60 degrees) in unit normals", unit="m", minimum=0.0, maximum=1e6
    )
    seeding: str = _choice("spread", SEEDINGS, "Where clusters begin: polygons far from one another (k-means++), or any as in the paper")
    huge_room: int = _option(
        4000,
        "int",
        "Rooms with more polygons than this are divided into clusters by a hierarchy, in O(N log N)",
        minimum=0,
        maximum=2**31 - 1,
    )
    split_merge: int = _option(
        2,
        "int",
        "Most rounds that split and merge clusters to make their boxes smaller; 0: none, as in the paper",
        minimum=0,
        maximum=1000,
    )
    hierarchy_children: int = _option(16, "int", "Most children of a node of this hierarchy", minimum=2, maximum=100_000)
    large_polygon: float = _option(
        1.0, "float", "A polygon whose smaller edge is longer than this is a cluster of its own", unit="m", minimum=0.0, maximum=1e6
    )
    emitters: str = _choice("clusters", ("clusters", "cells"), "Unit of shooting and of visibility: a cluster, or a cell (a whole room)")
    volumes: str = _choice(
        "windows", VOLUMES, "What bounds the space seen through portals: their outlines, or as in the paper the boxes around them"
    )
    ordering: str = _choice(
        "max_energy",
        ORDERINGS,
        "How the next emitter is chosen: any, the one with the most light, or so that little is read from disk; "
        "s counts that in polygons, c in emitters, backtrack looks five shots ahead, traveling_salesman plans a tour",
    )
    min_element_size: float = _option(
        0.0,
        "float",
        "Surface elements are never split below this edge length; 0 lets the quality choose",
        unit="m",
        minimum=0.0,
        maximum=1e6,
    )
    reflected: str = _choice(
        "auto",
        ("auto", "gathered", "elements"),
        "Reflected light: gathered by rays at each point, or interpolated from the elements (faster, smoother); auto does so for textures",
    )
    max_iterations: int = _option(1000, "int", "Most iterations of shooting, each visiting every emitter once", minimum=1, maximum=100_000)
    memory: int = _option(
        0,
        "size",
        "Memory for the whole solve beyond that of the program itself; what does not fit goes to the store; 0: no limit",
        unit="bytes",
        minimum=0,
    )
    store: str = _option("", "path", "Folder that receives every finished stage; a run that was ended goes on from there")
    threads: int = _option(0, "int", "Worker processes; 0 uses every core", minimum=0, maximum=1024)
    seed: int = _option(0, "int", "Seed of every random choice", minimum=0, maximum=2**31 - 1)

    def __post_init__(self) -> None:
        validate(self)


@dataclass(frozen=True)
class BakeOptions:
    """Where the light goes in Blender, and in which unit. Raises :class:`OptionError` when a value is out of its range."""

    target: str = _choice("vertex", ("vertex", "texture"), "Write vertex colours or lightmap textures")
    domain: str = _choice("corner", ("corner", "point"), "Vertex colours per face corner (sharp at hard edges) or per vertex")
    quantity: str = _choice(
        "radiosity",
        ("radiosity", "lighting", "lux"),
        "What is stored: radiosity B/pi (the look of the lit surface), lighting only E/pi, or illuminance in lux",
    )
    name: str = _option("Enfilade", "name", "Name of the colour attribute, the lightmap UV map and the images")
    texel_density: float = _option(32.0, "float", "Texels per metre of surface", unit="1/m", minimum=0.1, maximum=4096.0)
    max_resolution: int = _option(2048, "int", "Largest width and height of one texture", unit="px", minimum=16, maximum=16384)
    margin: int = _option(4, "int", "Texels of margin around every chart", unit="px", minimum=1, maximum=64)
    atlas: str = _choice("object", ("object", "room"), "One texture per object, or one shared by all objects of a room")
    image_format: str = _choice("exr", ("exr", "png"), "File format of textures: EXR keeps the full range, PNG is 16 bit display colour")
    image_folder: str = _option("", "path", "Folder for texture files; empty: packed into the .blend file")
    groups: str = _choice(
        "none",
        ("none", "collections", "lamps"),
        "Keep the light of groups of lamps apart, so that each can be dimmed and coloured after the bake: by collection, or lamp by lamp",
    )
    material: bool = _option(False, "bool", "Add a node set-up to the materials that shows the bake")
    subdivide: float = _option(
        0.0,
        "float",
        "Largest edge of a face in a subdivided copy of each mesh that carries the bake; 0: meshes stay as they are",
        unit="m",
        minimum=0.0,
        maximum=1e3,
    )

    def __post_init__(self) -> None:
        validate(self)


def describe(cls: type) -> tuple[OptionInfo, ...]:
    """All options of ``Options`` or ``BakeOptions`` in their order, with everything that a door shows."""
    return tuple(
        OptionInfo(name=f.name, default=f.default, flag="--" + f.name.replace("_", "-"), **f.metadata) for f in dataclasses.fields(cls)
    )


def validate(options: Options | BakeOptions) -> None:
    """Check every field against its range; raise :class:`OptionError` that names the option and its range."""
    for info in describe(type(options)):
        value = getattr(options, info.name)
        if info.kind == "choice":
            if value not in info.choices:
                raise OptionError(f"option {info.name}: {value!r} is not one of {', '.join(info.choices)}")
        elif info.kind == "bool":
            if not isinstance(value, bool):
                raise OptionError(f"option {info.name}: {value!r} is neither True nor False")
        elif info.kind in ("path", "name"):
            if not isinstance(value, str) or (info.kind == "name" and not value):
                raise OptionError(f"option {info.name}: {value!r} is not a text")
        else:
            whole = info.kind in ("int", "size")
            if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)) or value != value:
                raise OptionError(f"option {info.name}: {value!r} is not a {'whole ' if whole else ''}number")
            low, high = info.minimum, info.maximum
            if (low is not None and value < low) or (high is not None and value > high):
                limits = f"at least {low}" if high is None else f"between {low} and {high}"
                raise OptionError(f"option {info.name}: {value} must be {limits} {info.unit}".rstrip())
