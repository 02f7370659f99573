# SPDX-License-Identifier: GPL-3.0-or-later
"""Material files (.mtl) of strangers: only textures that lie beside them are kept."""

from __future__ import annotations

from pathlib import Path

_ENCODING = "latin-1"  # which reads any bytes and writes the same
_TEXTURES = ("map_", "bump", "disp", "decal", "refl", "norm")


def keep_own_textures(folder: Path) -> None:
    """Take lines with textures that are not in `folder` out of its .mtl files.

    Some name files on the disks of their creators, which an importer would look for on this one.
    """
    for path in folder.iterdir():
        if path.suffix.lower() != ".mtl":
            continue
        lines = path.read_text(_ENCODING).splitlines()
        kept = [line for line in lines if not _is_texture(line) or _is_there(folder, line)]
        path.write_text("\n".join([*kept, ""]), _ENCODING)


def _is_texture(line: str) -> bool:
    return line.strip().lower().startswith(_TEXTURES)


def _is_there(folder: Path, line: str) -> bool:
    """Tell whether the end of a line, after its options, is the name of a file in the folder."""
    words = line.split()[1:]
    names = (" ".join(words[start:]) for start in range(len(words)))
    return any(Path(name).name == name and (folder / name).is_file() for name in names)
