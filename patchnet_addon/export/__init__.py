# SPDX-License-Identifier: GPL-3.0-or-later
"""Export of one level's voxels as files of other programs: one format a file, and their list in `formats`."""
