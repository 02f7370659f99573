# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet: find where a coarse view of a Blender scene is wrong, and refine there first.

This folder is the Python package `patchnet` and, unchanged, the Blender extension. It imports nothing at the top, so
that the package costs nothing until it is used, and works without Blender.
"""


def register() -> None:
    """Enable the extension: Blender calls this."""
    from .commands import blender_command
    from .operators import registration

    registration.register()
    blender_command.register()


def unregister() -> None:
    """Disable the extension: Blender calls this."""
    from .commands import blender_command
    from .operators import registration

    blender_command.unregister()
    registration.unregister()
