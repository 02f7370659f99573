# SPDX-License-Identifier: GPL-3.0-or-later
"""Output folder of results that appears complete or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from ...patchnet_addon.runtime.errors import OutputError, PatchNetError
from ...patchnet_addon.runtime.file_kinds import FileKind
from ...patchnet_addon.runtime.outputs import check_outputs
from ...patchnet_addon.runtime.owned_folder import owned_folder, remove_left_over
from ...patchnet_addon.runtime.replace import temporary_path
from .reports import REPORT_NAME, remove_omitted, reported


@contextmanager
def output_folder(out: Path, files: Mapping[str, FileKind], inputs: Collection[Path] = ()) -> Iterator[Path]:
    """Temporary folder whose files move to `out` when the block ends without an error.

    files: kind of each file that may be written, by its path in the folder. inputs: files that are read.
    Files of the same name are replaced, pictures that an earlier report names and the new one omits go, others stay. On
    an error nothing in `out` is touched. What dead processes left of such folders is removed.
    Raises OutputError, before any work, if `out` cannot be written, or what is there is not to be replaced.
    """
    wanted = {out / name: kind for name, kind in files.items()}
    check_outputs(wanted, inputs, folder=out)
    parent = _parent(out)
    remove_left_over(parent, out.name)
    before = reported(out)
    with ExitStack() as stack:
        with _spoken_of_as(out):
            temporary = stack.enter_context(owned_folder(parent / temporary_path(out).name))
        with _spoken_of_as(out, temporary):
            yield temporary
        check_outputs(wanted, inputs, folder=out)  # long jobs leave time to put something there
        with _spoken_of_as(out):
            _move(temporary, out)
    remove_omitted(out, before, inputs)


@contextmanager
def _spoken_of_as(out: Path, temporary: Path | None = None) -> Iterator[None]:
    """Translate the system's errors to ours, which name files in `temporary`, soon gone, as they would be in `out`.

    With `temporary`, errors about other files are left alone.
    """
    try:
        yield
    except PatchNetError as error:
        if temporary is None or str(temporary) not in str(error):
            raise
        raise type(error)(str(error).replace(str(temporary), str(out))) from error
    except OSError as error:
        where = str(error.filename2 or error.filename or out)
        if temporary is not None:
            if str(temporary) not in where:
                raise
            where = where.replace(str(temporary), str(out))
        raise OutputError(
            f"{where} cannot be written ({error.strerror}): choose another folder or make room"
        ) from error


def _parent(out: Path) -> Path:
    """Nearest folder that is there above `out`; `out` itself where files can only be made in it, as in a mount."""
    parent = out.absolute().parent
    while not parent.exists():
        parent = parent.parent
    return parent if os.access(parent, os.W_OK) or not out.exists() else out


def _move(source: Path, out: Path) -> None:
    """Move all files, the report last, because it speaks of the others; what has to be copied is so before the rest."""
    names = {path.relative_to(source).as_posix() for path in source.rglob("*") if path.is_file()}
    renames = {folder: _can_be_renamed(source, folder) for folder in {(out / name).parent for name in names}}
    with ExitStack() as stack:
        sources: dict[Path, Path] = {}
        for name in sorted(names, key=lambda name: (name == REPORT_NAME, name)):
            temporary = sources[out / name] = source / name
            if not renames[(out / name).parent]:
                temporary = sources[out / name] = temporary_path(out / name)
                stack.callback(temporary.unlink, missing_ok=True)
                shutil.copyfile(source / name, temporary)
        for target, temporary in sources.items():
            os.replace(temporary, target)


def _can_be_renamed(source: Path, folder: Path) -> bool:
    """Return whether files in `source` can go into `folder`, which is made, or it is on another disk or mount."""
    folder.mkdir(parents=True, exist_ok=True)
    probe, there = temporary_path(source / "probe"), temporary_path(folder / "probe")
    probe.touch()
    try:
        os.replace(probe, there)
    except OSError as cause:
        probe.unlink()
        if cause.errno != errno.EXDEV:
            raise
        return False
    there.unlink()
    return True
