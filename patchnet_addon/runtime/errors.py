# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors that users can act on: operators report them, the command line prints them and exits with code 2."""

from __future__ import annotations

import os


class PatchNetError(Exception):
    """Base of all errors whose message states the cause and what to do."""


class SceneError(PatchNetError):
    """Unusable scene, scene file, camera or selection."""


class StoppedError(SceneError):
    """Stopped by the user while Blender was computing."""


class EmptySelectionError(SceneError):
    """No selected or visible object has a surface."""


class GeometryError(SceneError):
    """Unusable surface: no area, or coordinates that are not finite."""


class EngineGoneError(PatchNetError):
    """The engine process has ended before its answer."""


class MemoryEstimateError(PatchNetError):
    """The requested depth would not fit in memory; the message states the estimate."""


class SettingError(PatchNetError):
    """A setting has a value outside its range or that contradicts another one."""


class OutputError(PatchNetError):
    """Output that cannot be written, or would replace a file of another kind."""


class FileAccessError(PatchNetError):
    """File that cannot be read or written, with the system's reason."""

    @classmethod
    def of(cls, cause: OSError) -> FileAccessError | None:
        """Error for an OSError that names its file, else None."""
        names = [os.fsdecode(name) for name in (cause.filename, cause.filename2) if isinstance(name, str | bytes)]
        if not names or cause.strerror is None:
            return None
        return cls(f"{' and '.join(names)}: {cause.strerror}; see that it can be reached, and that its disk has room")


class FilesGoneError(PatchNetError):
    """Missing libraries of the extension.

    Several Blenders share a folder of libraries; one of them has removed them, or the zip has none.
    """

    @classmethod
    def of(cls, cause: ImportError | OSError) -> FilesGoneError | None:
        """Error for a library that can no longer be imported, else None."""
        text = f"{getattr(cause, 'name', '')} {cause}"
        if "numba" not in text and "llvmlite" not in text:
            return None
        return cls(
            "PatchNet's libraries are gone, as when another Blender removed them: restart Blender, or install the zip "
            f"for your platform ({cause})"
        )


class FileFormatError(PatchNetError):
    """File that is missing, damaged, of another program or of a newer version."""


class OctreeFileError(FileFormatError):
    """An octree file cannot be read."""


class CodesFileError(FileFormatError):
    """A codes file cannot be read, or belongs to another octree or other weights."""


class WeightsFileError(FileFormatError):
    """A weights file cannot be read."""
