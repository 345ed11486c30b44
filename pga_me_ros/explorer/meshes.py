"""Meshes of a robot's model, read from OBJ and STL files as triangles for the page."""

from __future__ import annotations

import base64
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.errors import TaskError

MOST_TRIANGLES = 8000
"""Triangles of a mesh that the page gets; finer ones are made coarser, so that a page stays a few megabytes."""

FINEST = 256
"""Grid lines along the longest edge of a mesh that is too fine, at first."""

STL_HEADER, STL_TRIANGLE = 84, 50
"""Bytes of a binary STL file before its triangles, and of each of them."""

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Mesh:
    """A part of a mesh in one color.

    Attributes:
        vertices: (V, 3) float64, in the units of the file.
        triangles: (T, 3) int64 rows of `vertices`.
        color: Red, green, blue from 0 to 1; None where the file has none.
    """

    vertices: Float64Array
    triangles: Int64Array
    color: Color | None = None


def read_mesh(path: Path) -> list[Mesh]:
    """Return a mesh, in parts if its file has several colors.

    Raises:
        TaskError: The file cannot be read, or is neither OBJ nor STL.
    """
    readers = {".obj": _read_obj, ".stl": _read_stl}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise TaskError(f"'{path.name}' is neither OBJ nor STL")
    try:
        parts = [part for part in reader(path) if len(part.triangles)]
    except (OSError, ValueError, IndexError, struct.error) as error:
        raise TaskError(f"'{path.name}' cannot be read ({error})") from None
    if not parts or not all(np.isfinite(part.vertices).all() for part in parts):
        raise TaskError(f"'{path.name}' has no triangles, or numbers that are not finite")
    return [coarser(part, MOST_TRIANGLES // len(parts)) for part in parts]


def coarser(mesh: Mesh, most: int) -> Mesh:
    """Return a mesh with at most so many triangles: vertices that are close together become one."""
    lines = FINEST
    out = _merged(mesh, mesh.vertices)
    low = mesh.vertices.min(axis=0)
    longest = float(np.ptp(mesh.vertices, axis=0).max()) or 1.0
    while len(out.triangles) > most:
        places = np.rint((mesh.vertices - low) / longest * lines)
        out = _merged(mesh, low + places / lines * longest)
        lines = int(0.8 * lines)
    return out


def describe_mesh(mesh: Mesh) -> dict[str, Any]:
    """Return a mesh fit for JSON: base64 of float32 coordinates and of uint32 rows, both little endian."""
    return {
        "vertices": _text(mesh.vertices.astype("<f4")),
        "triangles": _text(mesh.triangles.astype("<u4")),
    }


def _merged(mesh: Mesh, vertices: Float64Array) -> Mesh:
    """Return a mesh with other vertices, equal ones merged, and without triangles that have become lines or points."""
    unique, rows = np.unique(vertices, axis=0, return_inverse=True)
    triangles = rows.reshape(-1)[mesh.triangles].astype(np.int64)
    a, b, c = triangles.T
    whole = (a != b) & (b != c) & (a != c)
    return Mesh(unique, triangles[whole], mesh.color)


def _read_obj(path: Path) -> Iterator[Mesh]:
    """Yield the parts of an OBJ file, one for each of its materials."""
    vertices: list[list[float]] = []
    triangles: dict[str, list[list[int]]] = {}
    colors: dict[str, Color] = {}
    material = ""
    for line in path.read_text(errors="replace").splitlines():
        kind, _, rest = line.strip().partition(" ")
        if kind == "v":
            vertices.append([float(word) for word in rest.split()[:3]])
        elif kind == "f":
            corners = [_row(word, len(vertices)) for word in rest.split()]
            fan = [[corners[0], *corners[k : k + 2]] for k in range(1, len(corners) - 1)]
            triangles.setdefault(material, []).extend(fan)
        elif kind == "usemtl":
            material = rest.strip()
        elif kind == "mtllib":
            colors.update(_colors(path.with_name(rest.strip())))
    points = np.array(vertices, np.float64).reshape(-1, 3)
    for name, rows in triangles.items():
        if np.min(rows) < 0 or np.max(rows) >= len(points):
            raise ValueError("a face names a vertex that is not there")
        yield Mesh(points, np.array(rows, np.int64), colors.get(name))


def _row(word: str, count: int) -> int:
    """Return the row of a face's vertex, such as ``3/1/2``; negative numbers count from the newest vertex."""
    number = int(word.partition("/")[0])
    return number - 1 if number > 0 else count + number


def _colors(path: Path) -> dict[str, Color]:
    """Return the diffuse color of each material of an MTL file; none if it cannot be read."""
    colors: dict[str, Color] = {}
    name = ""
    try:
        lines = path.read_text(errors="replace").splitlines()
    except OSError:
        return colors
    for line in lines:
        words = line.split()
        if len(words) > 1 and words[0] == "newmtl":
            name = " ".join(words[1:])
        elif len(words) == 4 and words[0] == "Kd":
            red, green, blue = (float(word) for word in words[1:])
            colors[name] = (red, green, blue)
    return colors


def _read_stl(path: Path) -> Iterator[Mesh]:
    """Yield the one part of an STL file, binary or text."""
    content = path.read_bytes()
    count = struct.unpack_from("<I", content, STL_HEADER - 4)[0] if len(content) >= 84 else -1
    if len(content) == STL_HEADER + STL_TRIANGLE * count:
        rows = np.frombuffer(content, np.uint8, offset=STL_HEADER).reshape(-1, STL_TRIANGLE)
        corners = rows[:, 12:48].copy().view("<f4").astype(np.float64).reshape(-1, 3)
    else:
        words = [line.split() for line in content.decode("ascii", "replace").splitlines()]
        found = [[float(x) for x in w[1:4]] for w in words if w[:1] == ["vertex"]]
        corners = np.array(found, np.float64).reshape(-1, 3)
    yield Mesh(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3))


def _text(values: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
