# SPDX-License-Identifier: GPL-3.0-or-later
"""Voxels of one level as files of other programs: one format a file, and the list of them in `formats`."""
