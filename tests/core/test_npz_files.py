"""Reading of ``.npz`` files of unknown origin: sizes are checked before memory is taken."""

import gc
import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest
from enfilade.core.npz_files import DamagedFile, read_arrays, write_arrays


def header(shape, dtype="<f8"):
    text = f"{{'descr': {dtype!r}, 'fortran_order': False, 'shape': {shape!r}}}".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def archive(path, parts, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as out:
        for name, content in parts.items():
            out.writestr(name, content)
    return path


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_what_numpy_writes(tmp_path, save):
    arrays = {
        "a": np.arange(12.0).reshape(3, 4),
        "b": np.asfortranarray(np.arange(6, dtype=np.int16).reshape(2, 3)),
        "c": np.array(["x", "längere"]),
        "d": np.array(7),
        "e": np.zeros((0, 3), np.float32),
        "f": np.array([True, False]),
        "g": np.arange(3, dtype=">i4"),
    }
    with (tmp_path / "a.npz").open("wb") as stream:
        save(stream, **arrays)
    found = read_arrays(tmp_path / "a.npz")
    assert list(found) == list(arrays)
    for name, array in arrays.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (header((1 << 40,)), "cut short"),
        (header((1 << 62, 1 << 62)), "cut short"),
        (header((10**18,), "<U0"), "cut short"),
        (header((-1,)) + bytes(8), "shape"),
        (header((2,)) + bytes(15), "another length"),
        (header((2,)) + bytes(17), "another length"),
        (header((2,), "|O") + bytes(16), "where numbers or texts are due"),
        (header((2,), "<M8[s]") + bytes(16), "where numbers or texts are due"),
        (header(("2",)) + bytes(16), None),
        (b"\x93NUMPY\x03\x00" + bytes(20), "unknown form"),
        (b"no array at all", None),
        (b"", None),
        (b"\x93NUMPY\x01\x00\xff\xff" + b"(" * 70000, None),
    ],
)
def test_damaged_arrays_are_refused_in_little_memory(tmp_path, content, says):
    path = archive(tmp_path / "a.npz", {"a.npy": content})
    tracemalloc.start()
    with pytest.raises(DamagedFile, match=says) as error:
        read_arrays(path)
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()
    assert "\n" not in str(error.value)
    assert 0 < len(str(error.value)) < 300


def test_an_archive_that_unpacks_to_very_much(tmp_path):
    # A thousand million zeros in a megabyte.
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as out, out.open("a.npy", "w", force_zip64=True) as stream:
        stream.write(header((1_000_000_000,), "|u1"))
        for _ in range(1000):
            stream.write(bytes(1_000_000))
    path = tmp_path / "bomb.npz"
    path.write_bytes(buffer.getvalue())
    tracemalloc.start()
    with pytest.raises(DamagedFile, match="far larger than the file"):
        read_arrays(path)
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()


def test_an_archive_that_lies_about_its_size(tmp_path):
    path = archive(tmp_path / "a.npz", {"a.npy": header((200_000,), "|u1") + bytes(200_000)})
    content = bytearray(path.read_bytes())
    for at in (content.index(b"PK\x03\x04") + 22, content.index(b"PK\x01\x02") + 24):
        content[at : at + 4] = struct.pack("<I", 1000)
    path.write_bytes(content)
    with pytest.raises(DamagedFile):
        read_arrays(path)


def test_other_ways_of_packing_and_very_many_parts(tmp_path):
    with pytest.raises(DamagedFile, match="packed"):
        read_arrays(archive(tmp_path / "a.npz", {"a.npy": header((1,)) + bytes(8)}, zipfile.ZIP_BZIP2))
    with pytest.raises(DamagedFile, match="2000 parts"):
        read_arrays(archive(tmp_path / "b.npz", {f"{k}.npy": b"" for k in range(2000)}))


def test_no_archive(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"PK\x03\x04" + bytes(100))
    for path in (tmp_path / "a.npz", tmp_path / "missing.npz", tmp_path):
        with pytest.raises(DamagedFile):
            read_arrays(path)


@pytest.mark.parametrize("compressed", [True, False])
def test_numpy_reads_what_is_written(tmp_path, compressed):
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array(["x"]), "c": np.float64(3)}
    with (tmp_path / "a.npz").open("wb") as stream:
        write_arrays(stream, arrays, compressed)
    with np.load(tmp_path / "a.npz") as found:
        assert found.files == list(arrays)
        for name, array in arrays.items():
            np.testing.assert_array_equal(found[name], array)


def test_no_room_is_an_error_and_nothing_else(tmp_path, capfd):
    full = tmp_path / "full.npz"
    with pytest.raises(OSError, match="no room"), full.open("wb") as stream:
        write_arrays(_Full(stream), {"a": np.arange(100_000)})
    gc.collect()
    assert capfd.readouterr().err == ""


class _Full:
    """A stream that takes a thousand bytes."""

    def __init__(self, stream):
        self._stream = stream

    def write(self, content):
        if self._stream.tell() + len(content) > 1000:
            raise OSError("no room")
        return self._stream.write(content)

    def __getattr__(self, name):
        return getattr(self._stream, name)
