"""A glTF 2.0 file with the material on a sphere, as one file of text (.gltf) or of bytes (.glb)."""

import base64
import json
import struct
from typing import Any

import numpy as np

from gonio.exports.about import About

ROWS, COLUMNS = 32, 64
FLOAT, SHORT, VERTICES, INDICES = 5126, 5123, 34962, 34963


def gltf_file(description: dict[str, Any], about: About, suffix: str) -> bytes:
    """The content of the file, by its ending."""
    views, accessors, data = _buffers()
    used = sorted(description["extensions"])
    content: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": about.facts["written by"]},
        **({"extensionsUsed": used} if used else {}),
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "sphere"}],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3}, "indices": 4, "material": 0,
        }]}],
        "materials": [
            {"name": about.name, **{k: v for k, v in description.items() if v}, "extras": {"gonio": about.facts}}
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }  # fmt: skip
    if suffix == ".gltf":
        content["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{base64.b64encode(data).decode()}"
        return (json.dumps(content, indent=1) + "\n").encode()
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def _buffers() -> tuple[list[dict[str, Any]], list[dict[str, Any]], bytes]:
    """Views, accessors and bytes of a sphere about the vertical y axis, whose tangents lie along its parallels."""
    v, u = (np.linspace(0, 1, n + 1) for n in (ROWS, COLUMNS))
    theta, phi = np.meshgrid(np.pi * v, 2 * np.pi * u, indexing="ij")
    normal = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], axis=-1)
    tangent = np.stack([np.cos(phi), 0 * phi, -np.sin(phi), np.ones_like(phi)], axis=-1)
    uv = np.stack([phi / (2 * np.pi), theta / np.pi], axis=-1)
    corner = np.arange(ROWS)[:, None] * (COLUMNS + 1) + np.arange(COLUMNS)[None, :]
    below = corner + COLUMNS + 1
    triangles = np.stack([corner, below, corner + 1, corner + 1, below, below + 1], axis=-1)
    arrays = [a.reshape(-1, a.shape[-1]).astype("<f4") for a in (normal, normal, tangent, uv)]
    arrays.append(triangles.reshape(-1, 1).astype("<u2"))
    views, accessors, data = [], [], b""
    for k, a in enumerate(arrays):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": a.nbytes})
        views[-1]["target"] = INDICES if a.dtype == np.dtype("<u2") else VERTICES
        kind = "SCALAR" if a.shape[1] == 1 else f"VEC{a.shape[1]}"
        accessors.append({"bufferView": k, "count": len(a), "type": kind})
        accessors[-1]["componentType"] = SHORT if kind == "SCALAR" else FLOAT
        if k == 0:
            accessors[-1] |= {"min": a.min(axis=0).tolist(), "max": a.max(axis=0).tolist()}
        data += a.tobytes() + bytes(-a.nbytes % 4)
    return views, accessors, data
