"""Texts of photometric files of made-up luminaires."""

import numpy as np


def ies(
    vertical,
    horizontal,
    candela,
    *,
    edition="IESNA:LM-63-2002",
    kind=1,
    unit=2,
    multiplier=1,
    factors=(1, 1, 40),
    tilt="NONE",
    size=(0, 0, 0),
):
    """An LM-63 file; ``candela[h][v]``. Edition "" is that of 1986."""

    def row(values):
        return " ".join(f"{v:.17g}" for v in np.ravel(values))

    head = [edition] if edition else []
    head += ["[LUMINAIRE] made up"] if edition else ["a label of 1986"]
    counts = f"1 1000 {multiplier} {len(vertical)} {len(horizontal)} {kind} {unit} {row(size)}"
    table = [row(line) for line in candela]
    return "\r\n".join([*head, f"TILT={tilt}", counts, row(factors), row(vertical), row(horizontal), *table, ""])


def ldt(symmetry, planes, gamma, table, *, flux=1000.0, lamps=1, conversion=1.0, sets=1):
    """An EULUMDAT file; ``planes`` are all C-planes, ``table`` holds those in the file: ``table[c][g]`` in cd per 1000 lm."""
    step = planes[1] - planes[0] if len(planes) > 1 else 0
    lines = ["maker", "1", symmetry, len(planes), step, len(gamma), gamma[1] - gamma[0], "report", "made up", "no. 1", "file", "today"]
    lines += [1300, 250, 80, 1200, 200, 0, 0, 0, 0, 100, 80, conversion, 0, sets]
    for _ in range(sets):
        lines += [lamps, "lamp", flux, "warm", "1B", 36]
    lines += [0.5] * 10 + list(planes) + list(gamma) + list(np.ravel(table))
    return "\r\n".join(str(line) for line in lines) + "\r\n"
