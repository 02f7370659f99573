# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole job as steps: what the panel, `blender -b` and the command line run alike."""
