"""What a link keeps of its exchanges."""

import numpy as np
import pytest
from enfilade.core.emitters import Emitters
from enfilade.core.links import LinkSet
from enfilade.core.routes import RoutesInMemory, RoutesOnDisk


@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (4, 4), (9, 9)])
def test_a_link_keeps_its_exchanges_to_half_a_step(shape):
    rng = np.random.default_rng(3)
    exchange = (rng.random((500, *shape)) ** 6 * 10.0 ** rng.uniform(-9, 4, (500, 1, 1))).astype(np.float32)
    exchange[rng.random(exchange.shape) < 0.2] = 0
    exchange[7] = 0
    kept = LinkSet.of(*np.zeros((2, 500), np.int32), exchange).exchange
    largest = exchange.max((1, 2), keepdims=True).astype(float)
    # Three roundings to float32 (of the scale, of the quotient, of the product) add up to 3 * 65,535 * 2**-24 steps.
    assert (np.abs(kept - exchange.astype(float)) <= 0.512 / 65_535 * largest).all()
    assert (kept[exchange == 0] == 0).all()  # what is hidden stays hidden
    np.testing.assert_allclose(kept.max((1, 2)), largest[:, 0, 0], rtol=1e-6)


def test_routes_in_memory_and_on_disk_send_the_same_light():
    rng, elements = np.random.default_rng(5), 60
    order = rng.permutation(elements).astype(np.int32)
    place, start = np.argsort(order).astype(np.int32), np.array([0, 13, 13, 40, elements])
    emitters = Emitters(order, place, place, start)
    sets = []
    for shape in ((4, 4), (4, 4), (1, 4), (1, 1), (4, 4)):
        ends = rng.integers(0, elements, (2, 300)).astype(np.int32)
        sets.append(LinkSet.of(*ends, rng.random((300, *shape)).astype(np.float32)))
    memory, disk = RoutesInMemory(sets, emitters), RoutesOnDisk(sets, emitters, np.zeros)
    sent = 0
    for emitter in range(len(emitters)):
        for one, other in zip(memory.beams(emitter), disk.beams(emitter), strict=True):
            for a, b in zip(one, other, strict=True):
                np.testing.assert_array_equal(a, b)
            sent += len(one.source)
    assert sent == 300 * 5 * 2
