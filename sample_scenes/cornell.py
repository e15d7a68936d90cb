# SPDX-License-Identifier: GPL-3.0-or-later
"""A closed Cornell box, 2 m wide: red and green side walls, a ceiling lamp, two white blocks.

Run it: ``python -m enfilade.sample_scenes.cornell --out cornell.blend``
"""

from __future__ import annotations

from .model import Material, Model, Piece
from .shapes import BOTTOM, Room, box, build, panel, turned

WHITE = Material("White", (0.74, 0.74, 0.72))
RED = Material("Red", (0.6, 0.06, 0.05))
GREEN = Material("Green", (0.12, 0.45, 0.1))
LAMP = Material("Lamp", (0.7, 0.7, 0.7), (60.0, 46.0, 28.0))


def model(seed: int = 1) -> Model:
    """The box; it has nothing random, ``seed`` changes nothing."""
    room = Room("Box", (0.0, 0.0), (2.0, 2.0), 2.0, WHITE, WHITE, WHITE, {"west": RED, "east": GREEN})
    made = build("Cornell box", [room], [], [])
    # The lamp hangs a finger's breadth below the ceiling, so that no two faces lie on each other.
    made.pieces.append(Piece("Lamp", 0, (panel((0.7, 0.75, 1.99), (0, 0.5, 0), (0.6, 0, 0), LAMP),)))
    tall = turned(box((0.4, 1.0, 0.0), (1.0, 1.6, 1.2), WHITE, BOTTOM), 17, (0.7, 1.3))
    low = turned(box((1.0, 0.3, 0.0), (1.6, 0.9, 0.6), WHITE, BOTTOM), -17, (1.3, 0.6))
    made.pieces.append(Piece("Tall block", 0, tuple(tall)))
    made.pieces.append(Piece("Low block", 0, tuple(low)))
    return made


def main() -> None:
    """Write the box as a .blend or an .npz file."""
    from .write import View, command

    command(model, View(eye=(1.0, -3.4, 1.0), target=(1.0, 1.0, 1.0), lens=45.0, size=(1000, 1000)), cell=0.1, description=__doc__)


if __name__ == "__main__":
    main()
