"""A few of the inputs and scenes that ``tests/house/fuzz.py`` makes by the thousand."""

import fuzz
import pytest

INPUTS = 50


@pytest.mark.parametrize("kind", fuzz.KINDS)
def test_damaged_input_is_read_or_refused_in_one_sentence(kind, tmp_path):
    outcomes = {fuzz.read(kind, seed, tmp_path) for seed in range(100_000, 100_000 + INPUTS)}
    assert "refused" in outcomes


@pytest.mark.parametrize("seed", range(8))
def test_random_scenes_give_finite_light_and_account_for_their_energy(seed):
    balance, seconds = fuzz.solve_one(seed, "draft")
    assert abs(balance - 1) <= fuzz.BALANCE["draft"]
    assert seconds <= fuzz.SECONDS
