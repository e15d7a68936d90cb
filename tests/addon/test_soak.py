"""A few bakes of the soak in ``tests/house/soak.py``."""

import soak


def test_bakes_on_end_leave_nothing_behind(shop):
    sizes, faults = soak.soak(shop, 6)
    assert faults == []
    # A leak of one solution or one set of textures a bake would be tens of megabytes.
    assert sizes[-1] < sizes[3] + 30e6
