# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a job that the engine process computes: functions and types that know settings, but not Blender."""
