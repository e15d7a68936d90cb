"""PNG files of eight bits, for pictures inside other files; written here so that no colour management comes between."""

from __future__ import annotations

import struct
import zlib

import numpy as np


def png(pixels: np.ndarray) -> bytes:
    """A PNG file of (H, W, 3) uint8 sRGB pixels, row 0 at the top (ISO/IEC 15948)."""
    height, width = pixels.shape[:2]
    # Filter 2: every row as its difference to the one above, which smooth light makes small.
    rows = np.zeros((height, 1 + 3 * width), np.uint8)
    flat = np.ascontiguousarray(pixels, np.uint8).reshape(height, 3 * width)
    rows[:, 0], rows[:, 1:] = 2, flat
    rows[1:, 1:] -= flat[:-1]
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", header), (b"sRGB", b"\0"), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in parts
    )
