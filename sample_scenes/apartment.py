# SPDX-License-Identifier: GPL-3.0-or-later
"""A furnished apartment of six rooms at night; the study has no lamp of its own.

Two rows of rooms along a hall, the doors in line:

    bedroom     | bathroom |   study          y
    ------------- hall -----------------      |
    living room      |     kitchen            +-- x

Run it: ``python -m enfilade.sample_scenes.apartment --out apartment.blend``
"""

from __future__ import annotations

import numpy as np

from . import furniture as make
from .model import Material, Model, Panel, Piece
from .shapes import BOTTOM, Door, Room, Window, box, build, panel

HEIGHT = 2.6
LIVING, KITCHEN, HALL, BEDROOM, BATH, STUDY = range(6)

PLASTER = Material("Plaster", (0.76, 0.73, 0.68))
CEILING = Material("Ceiling white", (0.82, 0.82, 0.8))
TERRACOTTA = Material("Terracotta paint", (0.62, 0.17, 0.08))
DUSTY_BLUE = Material("Dusty blue paint", (0.09, 0.19, 0.5))
FOREST = Material("Forest green paint", (0.1, 0.3, 0.14))
OCHRE = Material("Ochre paint", (0.72, 0.45, 0.1))
OAK = Material("Oak floor", (0.46, 0.29, 0.16))
WALNUT = Material("Walnut", (0.26, 0.14, 0.08))
PALE_WOOD = Material("Pale wood", (0.6, 0.44, 0.28))
STONE = Material("Stone tiles", (0.5, 0.49, 0.47))
TURQUOISE = Material("Turquoise tiles", (0.12, 0.5, 0.5))
PORCELAIN = Material("Porcelain", (0.85, 0.85, 0.84))
WHITE = Material("White lacquer", (0.78, 0.78, 0.76))
LINEN = Material("Linen", (0.74, 0.7, 0.62))
GREY_CLOTH = Material("Grey cloth", (0.27, 0.29, 0.33))
BLUE_CLOTH = Material("Blue cloth", (0.08, 0.16, 0.42))
RED_CLOTH = Material("Red cloth", (0.62, 0.06, 0.06))
MUSTARD = Material("Mustard cloth", (0.75, 0.46, 0.05))
LEAF = Material("Leaf", (0.1, 0.32, 0.06))
CLAY = Material("Clay", (0.5, 0.25, 0.15))
STEEL = Material("Dark steel", (0.12, 0.12, 0.13))
PANE = Material("Night window", (0.03, 0.04, 0.06))
BOOKS = [
    Material("Book red", (0.55, 0.08, 0.07)),
    Material("Book blue", (0.09, 0.18, 0.45)),
    Material("Book green", (0.1, 0.32, 0.15)),
    Material("Book cream", (0.7, 0.64, 0.5)),
    Material("Book black", (0.06, 0.06, 0.07)),
    Material("Book orange", (0.75, 0.3, 0.05)),
]
WARM = Material("Lamp warm", (0.6, 0.6, 0.6), (96.0, 74.0, 48.0))
BEDSIDE = Material("Lamp bedside", (0.6, 0.6, 0.6), (150.0, 92.0, 44.0))
NEUTRAL = Material("Lamp neutral", (0.6, 0.6, 0.6), (80.0, 72.0, 60.0))
COOL = Material("Lamp cool", (0.6, 0.6, 0.6), (72.0, 80.0, 84.0))
DIM = Material("Lamp hall", (0.6, 0.6, 0.6), (150.0, 124.0, 90.0))


def model(seed: int = 1) -> Model:
    """The apartment; ``seed`` orders the books and the leaves.

    What stands at a wall ends just below a line of its 0.2 m grid: a corner hidden behind it would darken the wall above.
    """
    rng = np.random.default_rng(seed)
    rooms = [
        Room("Living room", (0.0, 0.0), (6.4, 4.6), HEIGHT, PLASTER, OAK, CEILING, {"west": TERRACOTTA}),
        Room("Kitchen", (6.55, 0.0), (11.8, 4.6), HEIGHT, PLASTER, STONE, CEILING, {"east": OCHRE}),
        Room("Hall", (0.0, 4.75), (11.8, 6.25), HEIGHT, PLASTER, PALE_WOOD, CEILING),
        Room("Bedroom", (0.0, 6.4), (4.9, 10.2), HEIGHT, PLASTER, OAK, CEILING, {"west": DUSTY_BLUE}),
        Room("Bathroom", (5.05, 6.4), (7.55, 10.2), HEIGHT, WHITE, STONE, CEILING, {"north": TURQUOISE, "east": TURQUOISE}),
        Room("Study", (7.7, 6.4), (11.8, 10.2), HEIGHT, PLASTER, OAK, CEILING, {"east": FOREST}),
    ]
    doors = [
        Door("Living room to kitchen", (LIVING, KITCHEN), "east", (1.3, 3.1), (0.0, 2.2), PALE_WOOD),
        Door("Living room to hall", (LIVING, HALL), "north", (2.2, 3.3), (0.0, 2.1), PALE_WOOD),
        Door("Kitchen to hall", (KITCHEN, HALL), "north", (9.2, 10.4), (0.0, 2.1), PALE_WOOD),
        Door("Hall to bedroom", (HALL, BEDROOM), "north", (2.3, 3.2), (0.0, 2.1), PALE_WOOD),
        Door("Hall to bathroom", (HALL, BATH), "north", (5.6, 6.4), (0.0, 2.1), PALE_WOOD),
        Door("Hall to study", (HALL, STUDY), "north", (8.9, 10.7), (0.0, 2.2), PALE_WOOD),
    ]
    windows = [
        Window(LIVING, "west", (1.4, 3.4), (0.8, 2.2), 0.12, PANE, WHITE),
        Window(BEDROOM, "north", (1.2, 3.6), (0.9, 2.2), 0.12, PANE, WHITE),
        Window(BATH, "north", (5.9, 6.7), (1.4, 2.2), 0.12, PANE, WHITE),
        Window(STUDY, "north", (8.7, 10.7), (0.9, 2.2), 0.12, PANE, WHITE),
    ]
    flat = build("Apartment", rooms, doors, windows)
    for room, fill in ((LIVING, _living), (KITCHEN, _kitchen), (HALL, _hall), (BEDROOM, _bedroom), (BATH, _bathroom), (STUDY, _study)):
        for name, panels in fill(rng).items():
            flat.pieces.append(Piece(f"{rooms[room].name} {name}", room, tuple(panels)))
    return flat


def _rug(x0: float, y0: float, x1: float, y1: float, material: Material) -> list[Panel]:
    return box((x0, y0, 0), (x1, y1, 0.015), material, BOTTOM)


def _living(rng: np.random.Generator) -> dict[str, list[Panel]]:
    return {
        "rug": _rug(0.9, 0.9, 4.0, 3.2, RED_CLOTH),
        "sofa": make.at(make.sofa(2.3, GREY_CLOTH, GREY_CLOTH), 2.4, 0.62, 180),
        "armchair": make.at(make.sofa(1.05, MUSTARD, MUSTARD), 0.9, 3.5, 35),
        "coffee table": make.at(make.table(1.1, 0.6, 0.38, WALNUT, STEEL), 2.4, 1.9),
        "sideboard": make.at(make.cupboard(1.6, 0.42, 0.79, WALNUT, PALE_WOOD), 5.2, 4.36),
        "bookshelf": make.at(make.bookshelf(1.3, 1.99, PALE_WOOD, BOOKS, rng), 1.3, 4.43),
        "plant": make.at(make.plant(CLAY, LEAF, rng), 5.95, 0.45),
        "floor lamp": make.at(make.floor_lamp(WARM, STEEL), 0.42, 0.5),
        "pendant": make.at(make.pendant(0.7, 0.7, 0.16, 1.95, WARM), 3.3, 2.2),
    }


def _kitchen(rng: np.random.Generator) -> dict[str, list[Panel]]:
    x = 11.49
    chairs: list[Panel] = []
    for dx, dy, angle in ((-0.4, -0.72, 180), (0.4, -0.72, 180), (-0.4, 0.72, 0), (0.4, 0.72, 0)):
        chairs += make.at(make.chair(BLUE_CLOTH, STEEL), 8.3 + dx, 2.2 + dy, angle + float(rng.uniform(-12, 12)))
    return {
        "counter": make.at(make.cupboard(4.0, 0.6, 0.9, WHITE, WALNUT), x, 2.15, 90),
        "fridge": make.at(make.cupboard(0.6, 0.6, 1.99, STEEL), 6.87, 4.27),
        "island": make.at(make.cupboard(1.5, 0.7, 0.9, FOREST, PALE_WOOD), 9.75, 0.62),
        "dining table": make.at(make.table(1.5, 0.9, 0.74, PALE_WOOD, WALNUT, 0.08), 8.3, 2.2),
        "chairs": chairs,
        "bowl": box((8.15, 2.05, 0.74), (8.45, 2.35, 0.84), MUSTARD, BOTTOM),
        "pendant": make.at(make.pendant(1.2, 0.3, 0.12, 1.75, NEUTRAL), 8.3, 2.2),
        "counter lamp": make.at(make.pendant(0.1, 2.4, 0.06, 1.5, NEUTRAL), 11.72, 2.15),
    }


def _hall(rng: np.random.Generator) -> dict[str, list[Panel]]:
    return {
        "runner": _rug(1.2, 5.15, 10.6, 5.85, BLUE_CLOTH),
        "bench": make.at(make.table(1.2, 0.36, 0.45, PALE_WOOD, STEEL), 7.6, 5.0),
        "cabinet": make.at(make.cupboard(1.0, 0.34, 0.99, OCHRE, WALNUT), 4.4, 6.07),
        "plant": make.at(make.plant(CLAY, LEAF, rng), 11.45, 5.9),
        "pendant west": make.at(make.pendant(0.3, 0.3, 0.3, 2.1, DIM), 2.75, 5.5),
        "pendant east": make.at(make.pendant(0.3, 0.3, 0.3, 2.05, DIM), 9.8, 5.5),
    }


def _bedroom(rng: np.random.Generator) -> dict[str, list[Panel]]:
    lamp = [*box((-0.09, -0.09, 0.5), (0.09, 0.09, 0.72), BEDSIDE)]
    return {
        "rug": _rug(0.5, 6.9, 3.6, 8.9, LINEN),
        "bed": make.at(make.bed(1.6, WALNUT, WHITE, MUSTARD, LINEN), 1.14, 8.3, 90),
        "night table north": make.at(make.cupboard(0.42, 0.4, 0.48, WALNUT), 0.24, 9.5, 90),
        "night table south": make.at(make.cupboard(0.42, 0.4, 0.48, WALNUT), 0.24, 7.1, 90),
        "lamp north": make.at(lamp, 0.24, 9.5),
        "lamp south": make.at(lamp, 0.24, 7.1),
        "wardrobe": make.at(make.cupboard(2.0, 0.6, 2.19, WHITE), 4.58, 8.9, 90),
        "pendant": make.at(make.pendant(0.5, 0.5, 0.14, 2.15, BEDSIDE), 3.0, 8.4),
        "chest": make.at(make.cupboard(1.0, 0.42, 0.79, DUSTY_BLUE, PALE_WOOD), 4.1, 6.63),
    }


def _bathroom(rng: np.random.Generator) -> dict[str, list[Panel]]:
    tub = box((5.09, 8.6, 0), (6.85, 8.68, 0.56), PORCELAIN, BOTTOM)
    tub += box((5.09, 9.42, 0), (6.85, 9.5, 0.56), PORCELAIN, BOTTOM)
    tub += box((5.09, 8.68, 0), (5.17, 9.42, 0.56), PORCELAIN, (*BOTTOM, "south", "north"))
    tub += box((6.77, 8.68, 0), (6.85, 9.42, 0.56), PORCELAIN, (*BOTTOM, "south", "north"))
    tub += [panel((5.17, 8.68, 0.14), (1.6, 0, 0), (0, 0.74, 0), PORCELAIN)]
    return {
        "tub": make.at(tub, 0.1, 0.62),
        "basin": make.at(make.cupboard(0.9, 0.46, 0.82, PALE_WOOD, PORCELAIN), 7.28, 7.9, 90),
        "toilet": [
            *box((5.09, 7.35, 0), (5.65, 7.73, 0.42), PORCELAIN, BOTTOM),
            *box((5.09, 7.3, 0.42), (5.27, 7.78, 0.85), PORCELAIN, BOTTOM),
        ],
        "mat": _rug(5.5, 8.3, 6.6, 8.95, RED_CLOTH),
        "pendant": make.at(make.pendant(0.45, 0.45, 0.1, 2.2, COOL), 6.3, 8.0),
    }


def _study(rng: np.random.Generator) -> dict[str, list[Panel]]:
    return {
        "rug": _rug(8.4, 7.3, 10.9, 9.1, OCHRE),
        "desk": make.at(make.table(1.7, 0.75, 0.74, PALE_WOOD, STEEL), 9.7, 9.65),
        "chair": make.at(make.chair(RED_CLOTH, STEEL), 9.8, 8.9, 160),
        "bookshelf west": make.at(make.bookshelf(2.2, 2.19, WALNUT, BOOKS, rng), 7.86, 8.6, 90),
        "armchair": make.at(make.sofa(0.95, RED_CLOTH, RED_CLOTH), 11.15, 8.0, -75),
        "screen": box((9.35, 9.75, 0.78), (9.95, 9.79, 1.15), STEEL),
    }


def main() -> None:
    """Write the apartment as a .blend or an .npz file."""
    from .write import View, command

    # High in the south: the camera looks over the south walls and through the ceilings.
    view = View(eye=(7.7, -7.2, 20.5), target=(5.6, 4.9, 0.6), lens=50.0, size=(1280, 960), exposure=-0.2)
    command(model, view, cell=0.2, description=__doc__)


if __name__ == "__main__":
    main()
