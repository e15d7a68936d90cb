"""The store: what is kept comes back, whatever happens in between; and what is damaged is said in one sentence."""

import contextlib
import errno
import json
import mmap
import os
from dataclasses import dataclass

import numpy as np
import pytest
from enfilade.core.options import OptionError
from enfilade.core.store import Residency, Space, Store, StoreError, digest, give_back, least_reads
from enfilade.core.store import folder as store_folder
from enfilade.core.store import space as store_space


@dataclass(frozen=True)
class Result:
    numbers: np.ndarray


class Killed(BaseException):
    """The end of a process, as far as one process can show it: nothing that follows is done."""


def arrays_of(seed):
    rng = np.random.default_rng(seed)
    record = np.zeros(7, [("a", "<i4"), ("b", "<f4", (2, 3))])
    record["b"] = rng.random((7, 2, 3))
    return {"floats": rng.random((5, 3)), "record": record, "none": np.zeros((0, 4), np.int32), "parts": [np.arange(3), np.arange(4)]}


def same(found, expected):
    expected = expected | {"parts": np.concatenate(expected["parts"])}
    assert set(found) == set(expected)
    for name, array in expected.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


def opened(path, key="k"):
    return Store(path, key, Space())


def files(path):
    return sorted(p.relative_to(path).as_posix() for p in path.rglob("*") if p.is_file())


def test_what_is_kept_comes_back(tmp_path):
    store = opened(tmp_path / "deep" / "store")
    assert store.recall("links") is None
    store.keep("regions", Result(np.arange(4)), {"seconds": 1.5})
    store.keep_arrays("links", arrays_of(0), {"state": 2**100}, "random")
    store.close()
    again = opened(tmp_path / "deep" / "store")
    saved = again.recall("regions")
    assert saved.facts == {"seconds": 1.5}
    np.testing.assert_array_equal(saved.result(Result).numbers, np.arange(4))
    same(again.recall("links", "random").arrays(), arrays_of(0))
    assert again.recall("links", "random").facts == {"state": 2**100}
    assert again.recall("links", "greedy_c") is None
    assert not again.recall("links", "random").arrays()["floats"].flags.writeable


def test_arrays_are_plain_npy_files(tmp_path):
    opened(tmp_path).keep_arrays("links", arrays_of(1))
    for name in ("floats", "record", "none", "parts"):
        assert np.load(tmp_path / "links" / f"{name}.npy", allow_pickle=False).shape[0] in (5, 7, 0)


def test_the_newest_state_replaces_the_one_before_and_leaves_nothing(tmp_path):
    store = opened(tmp_path)
    for seed in range(4):
        store.keep_arrays("shooting", arrays_of(seed))
        same(store.recall("shooting").arrays(), arrays_of(seed))
        assert len([p for p in files(tmp_path) if p.endswith(".npy")]) == 4
    store.drop("shooting")
    assert files(tmp_path) == ["lock", "manifest.json"]
    assert store.recall("shooting") is None


def test_another_run_begins_anew_in_the_same_folder(tmp_path):
    store = opened(tmp_path, "one")
    store.keep_arrays("links", arrays_of(0))
    store.close()
    other = opened(tmp_path, "two")
    assert other.recall("links") is None
    other.keep_arrays("links", arrays_of(1))
    same(other.recall("links").arrays(), arrays_of(1))


def test_what_is_not_of_the_store_stays(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "links.part").mkdir()
    (tmp_path / "links.part" / "half.npy").write_bytes(b"half")
    opened(tmp_path).close()
    assert files(tmp_path) == ["lock", "notes.txt"]


def test_one_run_at_a_time(tmp_path):
    first = opened(tmp_path)
    with pytest.raises(StoreError, match="another run"):
        opened(tmp_path)
    first.close()
    opened(tmp_path).close()


@pytest.mark.parametrize("step", range(9))
def test_ended_between_any_two_operations_it_holds_the_old_or_the_new(step, tmp_path, monkeypatch):
    store = opened(tmp_path)
    store.keep_arrays("shooting", arrays_of(0), {"seed": 0})
    left = [step]

    def counted(name):
        original = getattr(os, name)

        def operation(*args, **more):
            left[0] -= 1
            if left[0] < 0:
                raise Killed
            return original(*args, **more)

        return operation

    with monkeypatch.context() as patch:
        for name in ("replace", "fsync", "mkdir"):
            patch.setattr(store_folder.os, name, counted(name))
        with contextlib.suppress(Killed):
            store.keep_arrays("shooting", arrays_of(1), {"seed": 1})
    store.close()
    saved = opened(tmp_path).recall("shooting")
    same(saved.arrays(), arrays_of(saved.facts["seed"]))
    assert saved.facts["seed"] == (1 if left[0] >= 0 else 0)


def full(*args, **more):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("operation", ["fsync", "replace"])
def test_a_full_disk_is_one_sentence_and_loses_nothing(operation, tmp_path, monkeypatch):
    store = opened(tmp_path)
    store.keep_arrays("shooting", arrays_of(0))
    store.keep("regions", Result(np.arange(4)))
    with monkeypatch.context() as patch:
        patch.setattr(store_folder.os, operation, full)
        with pytest.raises(StoreError, match=r"^[^\n]*No space left on device\); make room[^\n]*$"):
            store.keep_arrays("shooting", arrays_of(1))
    same(store.recall("shooting").arrays(), arrays_of(0))
    store.close()
    again = opened(tmp_path)
    same(again.recall("shooting").arrays(), arrays_of(0))
    assert again.recall("regions") is not None


def test_a_full_disk_has_no_room_for_scratch_files(tmp_path, monkeypatch):
    monkeypatch.setattr(store_space.os, "posix_fallocate", full, raising=False)
    with pytest.raises(StoreError, match="No space left"):
        Space(10, 0, tmp_path).zeros(1 << 20)
    assert files(tmp_path) == []


@pytest.mark.parametrize("name", ["links/floats.npy", "regions.npz"])
@pytest.mark.parametrize("how", ["turned", "cut"])
def test_damage_is_one_sentence_with_a_remedy_that_helps(name, how, tmp_path):
    store = opened(tmp_path)
    store.keep_arrays("links", arrays_of(0))
    store.keep("regions", Result(np.arange(4)))
    store.close()
    path = tmp_path / name
    data = bytearray(path.read_bytes())
    data[-9] ^= 4
    path.write_bytes(data if how == "turned" else data[:-10])
    stage = name.split("/")[0].removesuffix(".npz")
    store = opened(tmp_path)
    with pytest.raises(StoreError, match=r"^[^\n]*is damaged[^\n]*delete it and run again$") as error:
        store.recall(stage)
    assert str(path) in str(error.value)
    path.unlink()
    assert store.recall(stage) is None


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": 3}', json.dumps({"format": "enfilade store", "version": 2, "stages": [1]})])
def test_an_unreadable_manifest_is_one_sentence(text, tmp_path):
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(StoreError, match=r"manifest.json: [^\n]*$"):
        opened(tmp_path)
    with pytest.raises(StoreError, match="manifest"):  # it let go of the folder
        opened(tmp_path)


def test_a_store_of_another_version_is_left_alone(tmp_path):
    store = opened(tmp_path)
    store.keep("regions", Result(np.arange(4)))
    store.close()
    path = tmp_path / "manifest.json"
    path.write_text(path.read_text().replace('"version": 2', '"version": 3'))
    before = files(tmp_path)
    with pytest.raises(StoreError, match="another version"):
        opened(tmp_path)
    assert files(tmp_path) == before


def test_a_store_cannot_be_where_a_file_is(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError):
        opened(tmp_path / "file")


# ------------------------------------------------------------------------------------------------- space


def test_arrays_that_fit_are_in_memory_and_others_in_files_without_a_name(tmp_path):
    space = Space(200_000_000, store_space.resident_bytes(), tmp_path)
    assert space.paged((1000, 1000), np.float64)[1] is None
    array, mapped = Space(1000, 0, tmp_path).paged((100, 1000), "<i8")
    assert isinstance(mapped, mmap.mmap)
    assert not array.any()
    array[:] = np.arange(1000)
    give_back(mapped)
    np.testing.assert_array_equal(array[99], np.arange(1000))
    if os.name == "posix":
        assert files(tmp_path) == []


def test_without_a_folder_what_does_not_fit_is_one_sentence():
    with pytest.raises(OptionError, match="name a folder for the rest with the option store"):
        Space(1000).zeros(1 << 20)


@pytest.mark.skipif(not hasattr(mmap, "MADV_DONTNEED"), reason="this system decides by itself which pages stay")
def test_pages_are_given_back(tmp_path):
    before = store_space.resident_bytes()
    space = Space(40_000_000, before, tmp_path)
    arrays = [space.zeros(10_000_000, np.uint8) for _ in range(12)]
    for k, array in enumerate(arrays):
        array[:] = k + 1
        space.breathe()
        assert store_space.resident_bytes() - before < 40_000_000
    assert [int(array[::4096].min()) for array in arrays] == list(range(1, 13))


# ------------------------------------------------------------------------------------- what is in memory


def replay(needs, size, limit):
    residency = Residency(size, limit)
    for needed in needs:
        residency.next_shot()
        residency.need(np.array(needed))
    return residency


def least_of_all(needs, size, limit):
    """The least that is read by trying every choice of what stays, of emitters of one byte each."""
    states = {frozenset(): 0}
    for needed in map(frozenset, needs):
        following = {}
        for here, read in states.items():
            cost = read + len(needed - here)
            for spare in range(2 ** len(rest := sorted(here - needed))):
                stay = needed | {e for k, e in enumerate(rest) if spare >> k & 1}
                if len(stay) <= max(limit, len(needed)):
                    following[stay] = min(cost, following.get(stay, 10**9))
        states = following
    return min(states.values())


@pytest.mark.parametrize("seed", range(6))
def test_the_least_is_what_the_best_of_all_choices_reads(seed):
    rng = np.random.default_rng(seed)
    needs = [rng.choice(7, rng.integers(1, 4), replace=False) for _ in range(12)]
    size = np.ones(7)
    for limit in (3, 4, 5, 7):
        least = least_reads(needs, size, limit)
        assert least == least_of_all([n.tolist() for n in needs], size, limit)
        assert replay(needs, size, limit).read >= least
    everyone = len(np.unique(np.concatenate(needs)))
    assert least_reads(needs, size, 7) == replay(needs, size, 7).read == everyone


def test_the_least_recently_used_goes_first():
    left = []
    residency = Residency([10, 10, 10, 10], 30, lambda gone: left.append(gone.tolist()))
    for needed in ([0, 1], [2], [0], [3], [1]):
        residency.next_shot()
        residency.need(np.array(needed))
    assert left == [[1], [2]]
    assert residency.read == 50
    assert residency.written == 20


def test_all_that_one_shot_needs_stays_for_it():
    residency = Residency([10, 10, 10], 5)
    residency.next_shot()
    residency.need(np.array([0, 1]))
    residency.need(np.array([2]))
    assert residency.written == 0
    residency.next_shot()
    residency.need(np.array([0]))
    assert residency.written == 20
    residency.next_shot()
    residency.need(np.array([1]))
    assert residency.read == 40


# ------------------------------------------------------------------------------------------- fingerprints


def test_what_differs_has_another_digest():
    things = [(), (1,), (1.0,), ("1",), (True,), (None,), ((),), ("a", "b"), ("ab",), (b"ab",), (np.arange(2),), (np.arange(2.0),)]
    things += [(np.zeros((2, 3)),), (np.zeros((3, 2)),), ({"a": 1},), (Result(np.arange(2)),)]
    assert len({digest(*t) for t in things}) == len(things)
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    assert digest(np.arange(6).reshape(2, 3).T) == digest(np.ascontiguousarray(np.arange(6).reshape(2, 3).T))
    with pytest.raises(TypeError):
        digest(object())
