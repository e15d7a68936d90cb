# SPDX-License-Identifier: GPL-3.0-or-later
"""Two rooms and a door between them; only the western one has a lamp, away from the line of the door.

Run it: ``python -m enfilade.sample_scenes.two_rooms --out two_rooms.blend``
"""

from __future__ import annotations

from . import furniture as make
from .model import Material, Model, Piece
from .shapes import Door, Room, build

PLASTER = Material("Plaster", (0.75, 0.73, 0.7))
WOOD = Material("Wood", (0.42, 0.27, 0.15))
BLUE = Material("Blue paint", (0.12, 0.2, 0.5))
RED = Material("Red paint", (0.6, 0.1, 0.07))
LAMP = Material("Lamp", (0.6, 0.6, 0.6), (70.0, 60.0, 45.0))


def model(seed: int = 1) -> Model:
    """The two rooms; they have nothing random, ``seed`` changes nothing."""
    rooms = [
        Room("Lit room", (0.0, 0.0), (4.0, 4.0), 2.6, PLASTER, WOOD, PLASTER, {"west": RED}),
        Room("Dark room", (4.15, 0.0), (8.15, 4.0), 2.6, PLASTER, WOOD, PLASTER, {"east": BLUE}),
    ]
    made = build("Two rooms", rooms, [Door("Door", (0, 1), "east", (2.6, 3.5), (0.0, 2.1), PLASTER)], [])
    furnishing = {
        "Lamp": (0, make.at(make.pendant(0.5, 0.5, 0.12, 2.2, LAMP), 1.6, 1.4)),
        "Lit room table": (0, make.at(make.table(1.2, 0.8, 0.74, WOOD, WOOD), 1.6, 1.4)),
        "Dark room cupboard": (1, make.at(make.cupboard(1.4, 0.5, 1.1, RED), 6.0, 0.27)),
        "Dark room sofa": (1, make.at(make.sofa(1.8, BLUE, PLASTER), 7.6, 2.2, -90)),
    }
    for name, (room, panels) in furnishing.items():
        made.pieces.append(Piece(name, room, tuple(panels)))
    return made


def main() -> None:
    """Write the two rooms as a .blend or an .npz file."""
    from .write import View, command

    command(model, View(eye=(4.1, -5.5, 9.5), target=(4.1, 1.9, 0.4), lens=40.0, size=(1280, 800)), cell=0.15, description=__doc__)


if __name__ == "__main__":
    main()
