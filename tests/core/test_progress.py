"""The time that a run will still take."""

import pytest
from enfilade.core.progress import TimeLeft, words


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def estimates(steps):
    """Estimates at (seconds, share done)."""
    clock = Clock()
    left = TimeLeft(clock)
    out = []
    for clock.now, fraction in steps:
        out.append(left.after(fraction))
    return out


def test_an_even_pace_is_continued():
    found = estimates([(t, t / 100) for t in range(1, 101)])
    assert found[:2] == [None, None]
    assert found[2:] == pytest.approx([100 - t for t in range(3, 101)])


def test_the_pace_is_that_of_late():
    # The first half takes 10 s, then everything goes at a tenth of the pace.
    found = estimates([(t, t / 20) for t in range(1, 11)] + [(10 + t, 0.5 + t / 200) for t in range(1, 101)])
    assert found[30] == pytest.approx(100 - 21, rel=1e-6)
    assert found[-1] == 0


def test_nothing_is_said_of_a_run_that_stands_still():
    assert estimates([(10, 0.5), (20, 0.5), (100, 0.5), (200, 0.5)])[2:] == [None, None]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "1 s left"), (41.2, "41 s left"), (89.4, "89 s left"), (90, "2 min left"), (3600, "60 min left"), (11_400, "3 h 10 min left")],
)
def test_words(seconds, text):
    assert words(seconds) == text
