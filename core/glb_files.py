"""Lit meshes as binary glTF 2.0 files that any viewer shows as they are: KHR_materials_unlit with vertex colours or a texture.

An unlit material shows baseColorFactor * baseColorTexture * COLOR_0, in linear light, and nothing else: what a bake wants. Blender's
own exporter reaches that only by certain nodes, and some of its versions lose the colours or let them wrap around, so the file is
written here.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_LINEAR, _CLAMP, _REPEAT = 9729, 33071, 10497


@dataclass(frozen=True)
class GlbMaterial:
    """An unlit material. factor : (3,) 0..1, linear;  image : index of its texture, or -1;  repeat : the texture goes on beyond 0..1"""

    name: str
    factor: tuple[float, float, float] = (1.0, 1.0, 1.0)
    image: int = -1
    repeat: bool = False
    double_sided: bool = False


@dataclass(frozen=True)
class GlbPart:
    """The faces of one material of a mesh, at most C corners and T triangles.

    corner : (T, 3, 3) float, metres, z up, counter-clockwise seen from the front
    color : (T, 3, 3) float linear RGB 0..1 at the corners, or None;  uv : (T, 3, 2) float, v up, or None;  material : index
    """

    corner: np.ndarray
    color: np.ndarray | None
    uv: np.ndarray | None
    material: int


@dataclass(frozen=True)
class GlbMesh:
    """An object of a file: its name, and a part for each of its materials."""

    name: str
    parts: tuple[GlbPart, ...]


@dataclass
class _Buffer:
    """The binary part of a file with what describes it."""

    data: list[bytes] = field(default_factory=list)
    size: int = 0
    views: list[dict] = field(default_factory=list)
    accessors: list[dict] = field(default_factory=list)

    def view(self, data: bytes, target: int = 0) -> int:
        padding = b"\0" * (-len(data) % 4)
        self.views.append({"buffer": 0, "byteOffset": self.size, "byteLength": len(data)} | ({"target": target} if target else {}))
        self.data.append(data + padding)
        self.size += len(data) + len(padding)
        return len(self.views) - 1

    def attribute(self, values: np.ndarray, limits: bool = False) -> int:
        """An accessor of (N, k) float32 values; ``limits`` adds the least and the largest, which positions must have."""
        values = np.ascontiguousarray(values, "<f4")
        made = {"bufferView": self.view(values.tobytes(), _VERTICES), "componentType": _FLOAT, "count": len(values)}
        made["type"] = f"VEC{values.shape[1]}"
        if limits:
            made |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        self.accessors.append(made)
        return len(self.accessors) - 1

    def indices(self, values: np.ndarray) -> int:
        view = self.view(np.ascontiguousarray(values, "<u4").tobytes(), _INDICES)
        self.accessors.append({"bufferView": view, "componentType": _UINT, "count": len(values), "type": "SCALAR"})
        return len(self.accessors) - 1


def write_glb(
    path: str | Path,
    meshes: Sequence[GlbMesh],
    materials: Sequence[GlbMaterial],
    images: Sequence[tuple[str, bytes]],
    extras: dict[str, Any],
) -> None:
    """Write a file; a failure leaves what was there before. Raises OSError when it cannot be written.

    images : PNG or JPEG files with a name for each;  extras : notes of the scene that JSON can hold
    """
    buffer = _Buffer()
    nodes, made = [], []
    for mesh in meshes:
        nodes.append({"name": mesh.name, "mesh": len(made)})
        made.append({"name": mesh.name, "primitives": [_primitive(part, buffer) for part in mesh.parts]})
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "Enfilade"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes))), "extras": extras}],
        "nodes": nodes,
        "meshes": made,
        "extensionsUsed": ["KHR_materials_unlit"],
    }
    if images:
        document["images"] = [
            {"name": name, "mimeType": "image/png" if data[:4] == b"\x89PNG" else "image/jpeg", "bufferView": buffer.view(data)}
            for name, data in images
        ]
        # No mipmaps: in the small ones charts that lie side by side in a texture would run into each other.
        document["samplers"] = [{"magFilter": _LINEAR, "minFilter": _LINEAR, "wrapS": wrap, "wrapT": wrap} for wrap in (_CLAMP, _REPEAT)]
    textures: dict[tuple[int, bool], int] = {}
    document["materials"] = [_material(material, textures) for material in materials]
    if textures:
        document["textures"] = [{"source": image, "sampler": int(repeat)} for image, repeat in textures]
    document |= {"accessors": buffer.accessors, "bufferViews": buffer.views, "buffers": [{"byteLength": buffer.size}]}
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    path = Path(path)
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with part.open("wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + buffer.size))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            file.write(struct.pack("<I4s", buffer.size, b"BIN\0"))
            file.writelines(buffer.data)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _primitive(part: GlbPart, buffer: _Buffer) -> dict[str, Any]:
    """One part; corners of the same place, colour and texture coordinates become one vertex."""
    corner = part.corner.reshape(-1, 3)
    # glTF has y up and -z ahead.
    columns = [np.stack([corner[:, 0], corner[:, 2], -corner[:, 1]], axis=1)]
    if part.color is not None:
        columns.append(part.color.reshape(-1, 3))
    if part.uv is not None:
        uv = part.uv.reshape(-1, 2)
        columns.append(np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1))
    table = np.ascontiguousarray(np.concatenate(columns, axis=1).astype(np.float32) + np.float32(0))  # no negative zeros
    rows = table.view(np.dtype((np.void, table.dtype.itemsize * table.shape[1]))).reshape(-1)
    _, first, index = np.unique(rows, return_index=True, return_inverse=True)
    # In the order of the faces, which viewers read fastest.
    rank = np.argsort(first, kind="stable")
    place = np.empty_like(rank)
    place[rank] = np.arange(len(rank))
    vertex, index = table[first[rank]], place[index.reshape(-1)]
    attributes = {"POSITION": buffer.attribute(vertex[:, :3], limits=True)}
    column = 3
    if part.color is not None:
        attributes["COLOR_0"] = buffer.attribute(vertex[:, column : column + 3])
        column += 3
    if part.uv is not None:
        attributes["TEXCOORD_0"] = buffer.attribute(vertex[:, column:])
    return {"attributes": attributes, "indices": buffer.indices(index), "material": part.material}


def _material(material: GlbMaterial, textures: dict[tuple[int, bool], int]) -> dict[str, Any]:
    surface: dict[str, Any] = {"baseColorFactor": [*(min(max(float(f), 0.0), 1.0) for f in material.factor), 1.0]}
    if material.image >= 0:
        index = textures.setdefault((material.image, material.repeat), len(textures))
        surface["baseColorTexture"] = {"index": index}
    # What a viewer without the extension would make of it: rough and without shine.
    surface |= {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    made = {"name": material.name, "pbrMetallicRoughness": surface, "extensions": {"KHR_materials_unlit": {}}}
    return made | ({"doubleSided": True} if material.double_sided else {})
