# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors that a user can act on: operators report them, the command line prints them and exits with 2."""

from __future__ import annotations

import os


class PatchNetError(Exception):
    """Base of all errors that name what was wrong and what to do about it."""


class SceneError(PatchNetError):
    """The scene, its file, its cameras or its selection cannot be used as they are."""


class StoppedError(SceneError):
    """The user stopped what Blender was doing for us."""


class EmptySelectionError(SceneError):
    """Empty selection: nothing that has a surface is selected or visible."""


class GeometryError(SceneError):
    """The surface itself is unusable: no area, or coordinates that are not finite."""


class MemoryEstimateError(PatchNetError):
    """The requested depth would not fit in memory; the message states the estimate."""


class SettingError(PatchNetError):
    """A setting has a value outside its range or that contradicts another one."""


class OutputError(PatchNetError):
    """Output cannot be written, or would replace something that is to stay."""


class FileAccessError(PatchNetError):
    """A file cannot be read or written, for a reason that the system names."""

    @classmethod
    def of(cls, cause: OSError) -> FileAccessError | None:
        """Sentence for an error of the system that names its file, else None."""
        names = [os.fsdecode(name) for name in (cause.filename, cause.filename2) if isinstance(name, str | bytes)]
        if not names or cause.strerror is None:
            return None
        return cls(f"{' and '.join(names)}: {cause.strerror}; see that it can be reached, and that its disk has room")


class FilesGoneError(PatchNetError):
    """Libraries that come with PatchNet are not there.

    Blenders share a folder of them, and one of them has emptied it; or the zip was one without libraries.
    """

    @classmethod
    def of(cls, cause: ImportError | OSError) -> FilesGoneError | None:
        """Sentence for a library that cannot be imported any more, else None."""
        text = f"{getattr(cause, 'name', '')} {cause}"
        if "numba" not in text and "llvmlite" not in text:
            return None
        return cls(
            "PatchNet's libraries are gone, as when another Blender removed them: restart Blender, or install the zip "
            f"for your platform ({cause})"
        )


class FileFormatError(PatchNetError):
    """A file is missing, foreign, damaged or of a newer version; the message names file and cause."""


class OctreeFileError(FileFormatError):
    """An octree file cannot be read."""


class CodesFileError(FileFormatError):
    """A codes file cannot be read, or belongs to another octree or other weights."""


class WeightsFileError(FileFormatError):
    """A weights file cannot be read."""
