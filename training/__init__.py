# SPDX-License-Identifier: GPL-3.0-or-later
"""Training and measuring, without Blender."""
