# SPDX-License-Identifier: GPL-3.0-or-later
"""Output of a job: its files, folders of cameras, and an output folder that is written as a whole or not at all."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import unicodedata
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import bpy

from ...patchnet_addon.network.weights import default_weights_path
from ...patchnet_addon.runtime.errors import OutputError, PatchNetError
from ...patchnet_addon.runtime.file_kinds import CODES, EXR, OCTREE, PNG, REPORT, FileKind
from ...patchnet_addon.runtime.outputs import check_outputs
from ...patchnet_addon.runtime.owned_folder import owned_folder
from ..scene.cameras import AUTO, camera_names, scene_cameras
from ..scene_access.images import OF_REFERENCE, PICTURES, PRIORITY_NAME
from ..settings.cycles_settings import CyclesSettings
from ..settings.job_settings import JobSettings
from .cycles_pictures import cycles_file_names
from .reports import REPORT_NAME, files_in, remove_omitted, reported

OCTREE_NAME, CODES_NAME, OVERVIEW_NAME = "octree.safetensors", "codes.safetensors", "overview.png"
_MAX_BYTES = 120
# Reserved names of Windows, and names that look like a hashed one.
_OTHERS = re.compile(r"con|prn|aux|nul|com\d|lpt\d|.*-[0-9a-f]{16}", re.IGNORECASE)


def view_folders(scene: bpy.types.Scene, cameras: Sequence[str]) -> dict[str, str]:
    """Folder of each chosen camera, by its name; raises SceneError for an unknown camera."""
    chosen = camera_names(scene, cameras)
    folders = camera_folders(chosen if list(cameras) == [AUTO] else [*scene_cameras(scene), *chosen])
    return {name: folders[name] for name in chosen}


def camera_folders(names: Iterable[str]) -> dict[str, str]:
    """Folder name for each camera's name, all of them different for every file system.

    Letters and digits of the camera's name, other characters as "_". If several cameras share it, in any case of
    letters, or if it looks like a hashed name, a hash of the camera's name follows. So names do not depend on the order
    of cameras, nor, given all cameras of a scene, on the chosen ones.
    """
    plain = {name: bpy.path.clean_name(name) or "camera" for name in names}
    owners = Counter(_folded(folder) for folder in plain.values())
    unchanged = Counter(_folded(name) for name, folder in plain.items() if name == folder)
    found = {}
    for name, folder in plain.items():
        key, content = _folded(folder), folder.encode(errors="surrogatepass")
        alone = owners[key] == 1 or (name == folder and unchanged[key] == 1)
        if not alone or _OTHERS.fullmatch(folder) or len(content) > _MAX_BYTES:
            digest = hashlib.blake2b(name.encode(errors="surrogatepass"), digest_size=8).hexdigest()
            folder = f"{content[:_MAX_BYTES].decode(errors='ignore')}-{digest}"
        found[name] = folder
    return found


def _folded(folder: str) -> str:
    """Folded name, equal for names that some file system treats as equal: by case or Unicode composition."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", folder).casefold())


def job_files(folders: Iterable[str], cycles: CyclesSettings | None, *, reference: bool = False) -> dict[str, FileKind]:
    """Kind of each file of a job by its path in the output folder; `folders` are those of the cameras.

    reference: with pictures of reference and errors.
    """
    files = {OCTREE_NAME: OCTREE, CODES_NAME: CODES, OVERVIEW_NAME: PNG, REPORT_NAME: REPORT}
    pictures = [name for name in PICTURES if reference or name not in OF_REFERENCE]
    names = [f"{name}.png" for name in pictures] + (cycles_file_names(cycles.compare) if cycles is not None else [])
    for folder in folders:
        files |= {f"{folder}/{name}": PNG for name in names} | {f"{folder}/{PRIORITY_NAME}": EXR}
    return files


def job_inputs(settings: JobSettings) -> list[Path]:
    """Input files of a job: those of the open scene, and weights."""
    return [*scene_inputs(), settings.network.weights or default_weights_path()]


def scene_inputs() -> Iterator[Path]:
    """Files of the scene: the open file, and its images, libraries and caches."""
    if bpy.data.filepath:
        yield Path(bpy.data.filepath)
    yield from map(Path, bpy.utils.blend_paths(absolute=True))


def check_job(settings: JobSettings, scene: Path | None, *, frames: bool) -> None:
    """Raise OutputError for output files that cannot be written, before a scene is opened.

    scene: the file to open. frames: results are frames in folders of their own.
    """
    assert settings.out is not None
    files = {REPORT_NAME: REPORT} if frames else job_files((), settings.view.cycles)
    inputs = [*job_inputs(settings), *([] if scene is None else [scene])]
    check_outputs({settings.out / name: kind for name, kind in files.items()}, inputs, folder=settings.out)


@contextmanager
def output_folder(out: Path, files: Mapping[str, FileKind], inputs: Collection[Path] = ()) -> Iterator[Path]:
    """Temporary folder whose files move to `out` when the block ends without an error.

    files: kind of each file that may be written, by its path in the folder. inputs: files that are read.
    Files of the same name are replaced, pictures of an earlier report that the new one omits are removed, others stay.
    On an error nothing in `out` is touched. Leftovers of killed processes are removed. Raises OutputError, before any
    work, if `out` cannot be written, or holds a file of another kind.
    """
    wanted = {out / name: kind for name, kind in files.items()}
    check_outputs(wanted, inputs, folder=out)
    parent = out.absolute().parent
    while not parent.exists():
        parent = parent.parent
    if out.exists() and not os.access(parent, os.W_OK):  # such as a mount
        parent = out
    before = reported(out)
    with ExitStack() as stack:
        with _spoken_of_as(out):
            temporary = stack.enter_context(owned_folder(parent / out.name))
        with _spoken_of_as(out, temporary):
            yield temporary
        check_outputs(wanted, inputs, folder=out)  # other files may have appeared during a long job
        with _spoken_of_as(out):
            _move(temporary, out)
    remove_omitted(out, before, inputs)


@contextmanager
def _spoken_of_as(out: Path, temporary: Path | None = None) -> Iterator[None]:
    """Convert errors of the system to ours, which name files in `out` instead of `temporary`.

    With `temporary`, errors about other files pass unchanged.
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


def _move(source: Path, out: Path) -> None:
    """Move all files, the report last; all are copied to the output's disk before the first one replaces a file."""
    with ExitStack() as stack:
        moved: dict[Path, Path] = {}
        for name in sorted(files_in(source), key=lambda name: name == REPORT_NAME):
            target = out / name
            target.parent.mkdir(parents=True, exist_ok=True)
            moved[target] = stack.enter_context(owned_folder(target)) / target.name
            shutil.move(source / name, moved[target])
        for target, temporary in moved.items():
            os.replace(temporary, target)
