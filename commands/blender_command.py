# SPDX-License-Identifier: GPL-3.0-or-later
"""`blender --command patchnet SUB-COMMAND`: the sub-commands of users, inside Blender.

Blender exits with the returned code: 0 for success, 1 for an unexpected error, 2 for bad input.
"""

from __future__ import annotations

import atexit
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ID = "patchnet"
PROGRAM = f"blender --command {ID}"

_handles: list[Any] = []


def register() -> None:
    """Register the command in Blender."""
    import bpy

    _handles.append(bpy.utils.register_cli_command(ID, execute))
    atexit.register(unregister)  # Blender as a Python module crashes at exit while a command is registered


def unregister() -> None:
    """Unregister the command."""
    import bpy

    atexit.unregister(unregister)
    while _handles:
        bpy.utils.unregister_cli_command(_handles.pop())


def execute(words: Sequence[str]) -> int:
    """Run a sub-command with the arguments after `--command patchnet`."""
    import traceback

    import bpy

    from ..operators.properties.preferences import apply_preferences, preferences
    from ..patchnet_addon.runtime.errors import PatchNetError
    from ..patchnet_addon.runtime.streams import drop_output
    from . import EXIT_ERROR, EXIT_UNEXPECTED, main
    from .shared.lines import say_error

    try:
        apply_preferences(bpy.context)
        level = preferences(bpy.context).log_level
        code = main([_blender_path(word) for word in words], program=PROGRAM, level=level)
        print(end="", flush=True)
        return code
    except PatchNetError as error:
        say_error(f"error: {error}", EXIT_ERROR)
        return EXIT_ERROR
    except SystemExit as stop:  # by argparse: help, or unknown arguments
        return stop.code if isinstance(stop.code, int) else EXIT_UNEXPECTED
    except BrokenPipeError as error:  # `| head`
        drop_output(error)
        return EXIT_UNEXPECTED
    except Exception:  # noqa: BLE001  no caller would report what it was
        traceback.print_exc()
        return EXIT_UNEXPECTED


def _blender_path(word: str) -> str:
    """Expand Blender's `//` in an argument (--out=//out) to the open file's folder; raises SettingError without one."""
    from ..operators.properties import absolute_path

    option, equals, text = word.partition("=") if word.startswith("--") else ("", "", word)
    path: Path | None = absolute_path(text) if text.startswith("//") else None
    return word if path is None else f"{option}{equals}{path}"
