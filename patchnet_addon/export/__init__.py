# SPDX-License-Identifier: GPL-3.0-or-later
"""Export of one level's voxels to files for other programs: one module per format, registered in `formats`."""
