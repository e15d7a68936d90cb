"""Every hard case holds to its tolerance, for every basis."""

import warnings

import pytest
from hard_cases import CASES


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize(
    "case", [pytest.param(c, id=c.name, marks=[pytest.mark.xfail(strict=True, reason=c.fault)] if c.fault else []) for c in CASES]
)
def test_hard_case(case, order):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # zero-area portals have no frame
        assert case.figure(order) <= case.limit


def test_cases_have_names_of_their_own():
    assert len({case.name for case in CASES}) == len(CASES)
