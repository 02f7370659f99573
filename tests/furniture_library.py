# SPDX-License-Identifier: GPL-3.0-or-later
"""A small furniture library (.sh3f) of cubes."""

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

CATALOGUE = "PluginFurnitureCatalog.properties"
CUBE = """mtllib cube.mtl
v 0 0 0\nv 3 0 0\nv 3 5 0\nv 0 5 0\nv 0 0 7\nv 3 0 7\nv 3 5 7\nv 0 5 7
usemtl red
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 1 5 8 4\nf 2 3 7 6
"""
MATERIAL = "newmtl red\nKd 0.8 0.1 0.1\nmap_Kd /etc/not-ours.png\n"
# Name, tags, category, width, depth and height in cm.
FURNITURE = (
    ("Table", "", "Living room", 150, 80, 75),
    ("Chair", "Seat", "Living room", 45, 50, 90),
    ("Sofa", "Couch", "Living room", 190, 80, 85),
    ("Bookcase", "Shelves", "Living room", 90, 30, 180),
    ("Lamp", "", "Lights", 40, 40, 150),
    ("Cup", "", "Kitchen", 8, 9, 10),
    ("Bowl", "", "Kitchen", 20, 18, 9),
    ("Plant", "Decoration", "Living room", 50, 50, 100),
    ("Oak", "Tree, Outdoor", "Exterior", 300, 280, 450),
    ("Sitting girl", "Human, People", "Characters", 50, 80, 130),
    ("Girl", "Human, People", "Characters", 45, 35, 150),
)


def write_library(
    path: Path,
    pieces: Sequence[tuple[str, str, str, float, float, float]] = FURNITURE,
    *,
    identity: str = "Test#cubes",
    extra: str = "",
    files: Mapping[str, str] | None = None,
    without: Sequence[str] = (),
) -> Path:
    """Write a library of cubes of 3 x 7 x 5 units (width, depth, height) that are to be scaled.

    extra: more lines of the catalogue. files: more members. without: members that are left out.
    """
    lines = [f"id={identity}", "name=Cubes", "license=CC \\u00a9 test"]
    members = {"cubes/cube.mtl": MATERIAL, **(files or {})}
    for number, (name, tags, category, width, depth, height) in enumerate(pieces, 1):
        model = f"cubes/cube{number}.obj"
        members[model] = CUBE
        values = {"name": name, "tags": tags, "category": category, "model": f"/{model}", "creator": "A | tester"}
        values |= {"width": str(width), "depth": str(depth), "height": str(height)}
        lines += [f"{key}#{number}={value}" for key, value in values.items()]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in {CATALOGUE: "\n".join([*lines, extra]), **members}.items():
            if name not in without:
                archive.writestr(name, text)
    return path
