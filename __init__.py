# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet: see where a coarse view of a Blender scene is wrong, and refine there first.

This folder is the Python package `patchnet` and, unchanged, the Blender extension. Nothing is imported here, so that
the package costs nothing until it is used and works where there is no Blender.
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
