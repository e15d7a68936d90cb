"""Reader of IES LM-63 photometric files: 1986, 1991, 1995, 2002 and 2019.

After the label lines and ``TILT=`` a file is a stream of numbers, which lines may break anywhere. Where the editions
differ, the first line tells which one it is: that of 1986 has no such line.

The angles of Type C turn counter-clockwise, seen from above, about the plumb line, with vertical angle 0 straight down.
Those of Type A turn clockwise about the same line, with vertical angle 0 horizontal and -90 straight down. The vertical
angles of Type B turn about a horizontal axis, from straight down at 0 to horizontal at 90; its horizontal angles tilt out
of the plane of that turn, clockwise again (LM-63-2002, definitions).
"""

from __future__ import annotations

import numpy as np

from .luminaires import Luminaire
from .luminous_intensity import POLE_DOWN, Distribution, closed, mirrored
from .photometric_values import NEW_FILE, check_candela, number, rising
from .scene import SceneError

FOOT = 0.3048

TYPE_C, TYPE_B, TYPE_A = 1, 2, 3

AXES_A = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
AXES_B = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
AXES_A.setflags(write=False)
AXES_B.setflags(write=False)


def parse_ies(name: str, lines: list[str]) -> Luminaire:
    """The luminaire of the lines of an LM-63 file; ``name`` is the file in messages.

    Candela are those of the file times its multiplier and ballast factor; in the editions of 1986 and 1991 also times the
    ballast-lamp photometric factor, a place that is without meaning in 1995 and 2002 and tells of the origin of the data
    in 2019. Angles that a file leaves out are dark, except where the standard or, for the quadrant of Type B, common
    practice has them mirrored. A luminaire that was measured in one half-plane is rotationally symmetric.

    Raises SceneError with one sentence that names the file, the line and the remedy.
    """
    tilt_line = next((i for i, line in enumerate(lines) if line.replace(" ", "").upper().startswith("TILT=")), None)
    if tilt_line is None:
        raise SceneError(f"{name}: no line begins with TILT=, so this is no IES LM-63 file or its end is missing, {NEW_FILE}")
    numbers = _Numbers(name, lines, tilt_line + 1)
    tilt_angle, tilt_factor = _tilt(name, lines, tilt_line, numbers)

    numbers.take(2, "number of lamps and lumens of a lamp")
    (multiplier,) = numbers.take(1, "candela multiplier")
    vertical_count, horizontal_count = numbers.count("vertical angles", 2), numbers.count("horizontal angles", 1)
    kind = numbers.choice("photometric type", {TYPE_C: "C", TYPE_B: "B", TYPE_A: "A"})
    unit = numbers.choice("unit of length", {1: "feet", 2: "metres"})
    width, length, height = np.abs(numbers.take(3, "width, length and height")) * (FOOT if unit == 1 else 1.0)
    ballast, ballast_lamp, watts = numbers.take(3, "ballast factor, next factor and input watts")
    # As Python's numbers, whose overflow is not worth a warning.
    factor = float(multiplier) * float(ballast) * (float(ballast_lamp) if _before_1995(lines) else 1.0)
    if not 0 < factor < np.inf:
        raise SceneError(f"{numbers.where}: the product of multiplier and ballast factors is {factor:g}, set them to 1 or above 0")

    low, high = (0.0, 360.0) if kind == TYPE_C else (-90.0, 90.0)
    vertical = numbers.take(vertical_count, "vertical angles")
    vertical = rising(numbers.where, "vertical angles", vertical, low, min(high, 180.0))
    where_vertical = numbers.where
    horizontal = numbers.take(horizontal_count, "horizontal angles")
    horizontal = rising(numbers.where, "horizontal angles", horizontal, low, high)
    where_horizontal = numbers.where
    with np.errstate(over="ignore"):
        candela = factor * numbers.take(horizontal_count * vertical_count, "candela values").reshape(horizontal_count, vertical_count)
    check_candela(numbers.where, candela)
    numbers.end()
    as_distribution = {TYPE_C: _type_c, TYPE_B: _type_b, TYPE_A: _type_a}[kind]
    distribution = as_distribution(where_vertical, where_horizontal, vertical, horizontal, candela)
    return Luminaire(_label(lines[:tilt_line]), distribution, np.array([length, width, height]), float(watts), tilt_angle, tilt_factor)


class _Numbers:
    """The numbers of a file from a line on, in order, whatever lines they stand on."""

    def __init__(self, name: str, lines: list[str], first: int) -> None:
        self._name, self._lines, self._next = name, lines, first
        self._words: list[str] = []
        self._left = sum(len(line) + 1 for line in lines[first:])

    @property
    def where(self) -> str:
        """The file and the line of the number that was read last."""
        return f"{self._name}, line {self._next}"

    def take(self, count: int, what: str) -> np.ndarray:
        """(count,) float64, the next numbers. Raises SceneError when the file has fewer or something else in their place."""
        self._check_room(count, what)
        out = np.empty(count)
        done = 0
        while done < count:
            if not self._words and not self._advance():
                raise SceneError(f"{self._name}, line {len(self._lines)}: the file ends within the {what}, {NEW_FILE}")
            words, self._words = self._words[: count - done], self._words[count - done :]
            for word in words:
                try:
                    out[done] = number(word)
                except ValueError:
                    raise SceneError(f"{self.where}: {word[:20]!r} is no number but stands among the {what}, {NEW_FILE}") from None
                done += 1
        return out

    def count(self, what: str, least: int) -> int:
        """The next number as a count of at least so many."""
        (value,) = self.take(1, f"number of {what}")
        if value != int(value) or value < least:
            raise SceneError(f"{self.where}: the number of {what} is {value:g}, it must be whole and at least {least}, {NEW_FILE}")
        self._check_room(value, what)
        return int(value)

    def choice(self, what: str, names: dict[int, str]) -> int:
        """The next number, which must be a key of ``names``."""
        (value,) = self.take(1, what)
        if value not in names:
            known = ", ".join(f"{key} ({names[key]})" for key in names)
            raise SceneError(f"{self.where}: the {what} is {value:g} where only {known} exist, set it right")
        return int(value)

    def end(self) -> None:
        """Raise SceneError when another number follows; the word END and other remarks may."""
        if not self._words and not self._advance():
            return
        try:
            number(self._words[0])
        except ValueError:
            return
        raise SceneError(f"{self.where}: more numbers follow than the numbers of angles announce, set these right or {NEW_FILE}")

    def _check_room(self, count: float, what: str) -> None:
        # Before anything is set aside for them: a number and what parts it from the next take two characters.
        if count > (self._left + sum(len(word) + 1 for word in self._words) + 1) / 2:
            raise SceneError(f"{self.where}: {count:.15g} {what} are announced, more than the file can hold, {NEW_FILE}")

    def _advance(self) -> bool:
        while not self._words and self._next < len(self._lines):
            line = self._lines[self._next]
            self._words = line.replace(",", " ").replace("\x1a", " ").split()
            self._left -= len(line) + 1
            self._next += 1
        return bool(self._words)


def _tilt(name: str, lines: list[str], at: int, numbers: _Numbers) -> tuple[np.ndarray, np.ndarray]:
    kind = lines[at].split("=", 1)[1].strip()
    if kind.upper() == "NONE":
        return np.zeros(0), np.zeros(0)
    if kind.upper() != "INCLUDE":
        raise SceneError(
            f"{name}, line {at + 1}: TILT={kind[:40]} refers to another file, write TILT=NONE or TILT=INCLUDE and its lines here"
        )
    numbers.choice("lamp-to-luminaire geometry", {1: "vertical", 2: "stays horizontal", 3: "tilts along"})
    count = numbers.count("tilt angles", 1)
    angle = numbers.take(count, "tilt angles")
    angle = rising(numbers.where, "tilt angles", angle, 0.0, 180.0)
    factor = numbers.take(count, "tilt factors")
    if not np.all((factor >= 0) & (factor <= 1000)):
        raise SceneError(f"{numbers.where}: a tilt factor is negative or above 1000, set it right or write TILT=NONE")
    return angle, factor


def _before_1995(lines: list[str]) -> bool:
    first = lines[0].strip().upper().replace(" ", "")
    return first.startswith("IESNA91") or not first.startswith(("IESNA:LM-63-", "IES:LM-63-"))


def _label(lines: list[str]) -> str:
    """The name of the luminaire: keyword LUMINAIRE, else LUMCAT, else the first label line of the edition of 1986."""
    keywords = {}
    for line in lines:
        key, closed, value = line.strip().partition("]")
        if closed and key.startswith("["):
            keywords.setdefault(key[1:].strip().upper(), value.strip())
    label = keywords.get("LUMINAIRE") or keywords.get("LUMCAT")
    if label is None and not keywords:
        label = next((line.strip() for line in lines if line.strip() and not line.strip().upper().startswith("IES")), "")
    return label or ""


def _type_c(where_vertical: str, where_horizontal: str, vertical: np.ndarray, horizontal: np.ndarray, candela: np.ndarray) -> Distribution:
    if vertical[0] not in (0, 90):
        raise SceneError(f"{where_vertical}: the vertical angles begin at {vertical[0]:g} where Type C has 0 or 90 degrees, {NEW_FILE}")
    first, last = horizontal[0], horizontal[-1]
    if len(horizontal) == 1:
        horizontal, candela = np.array([0.0, 360.0]), np.concatenate((candela, candela))
    elif (first, last) == (0, 90):
        horizontal, candela = mirrored(*mirrored(horizontal, candela))
    elif (first, last) in ((0, 180), (90, 270)):
        horizontal, candela = mirrored(horizontal, candela)
    elif first == 0 and last > 180:
        # Some makers leave out the half-plane at 360, since it is that at 0.
        horizontal, candela = closed(horizontal, candela)
    else:
        raise SceneError(
            f"{where_horizontal}: the horizontal angles run from {first:g} to {last:g} degrees where Type C has 0 alone, 0 to 90, "
            f"0 to 180, 90 to 270 or 0 to 360, {NEW_FILE}"
        )
    return Distribution(horizontal, vertical, candela, POLE_DOWN)


def _type_a(where_vertical: str, where_horizontal: str, vertical: np.ndarray, horizontal: np.ndarray, candela: np.ndarray) -> Distribution:
    _check_quarter_turns(where_vertical, "vertical angles of Type A", vertical)
    _check_quarter_turns(where_horizontal, "horizontal angles of Type A", horizontal)
    if horizontal[0] == 0:
        horizontal, candela = mirrored(-horizontal[::-1], candela[::-1])
    # The pole is below: the vertical angle is a latitude, the horizontal one the azimuth.
    return Distribution(horizontal, vertical + 90.0, candela, AXES_A)


def _type_b(where_vertical: str, where_horizontal: str, vertical: np.ndarray, horizontal: np.ndarray, candela: np.ndarray) -> Distribution:
    _check_quarter_turns(where_vertical, "vertical angles of Type B", vertical)
    _check_quarter_turns(where_horizontal, "horizontal angles of Type B", horizontal)
    if horizontal[0] == 0:
        horizontal, candela = mirrored(-horizontal[::-1], candela[::-1])
    candela = candela.T
    if vertical[0] == 0:
        # The standard is silent, but floodlights that are symmetric both ways are published as one quadrant.
        vertical, candela = mirrored(-vertical[::-1], candela[::-1])
    return Distribution(vertical, horizontal + 90.0, candela, AXES_B)


def _check_quarter_turns(where: str, what: str, angle: np.ndarray) -> None:
    if angle[0] not in (-90, 0) or angle[-1] != 90:
        run = f"run from {angle[0]:g} to {angle[-1]:g} degrees"
        raise SceneError(f"{where}: the {what} {run} where -90 to 90 or 0 to 90 are possible, {NEW_FILE}")
