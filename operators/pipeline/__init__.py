# SPDX-License-Identifier: GPL-3.0-or-later
"""Pipeline of the whole job as steps, run alike by the panel, `blender -b` and the command line."""
