# SPDX-License-Identifier: GPL-3.0-or-later
"""Compilation of all kernels before the first job of a window, in a Blender of its own."""

from .ahead import compiled_ahead, small_jobs_path

__all__ = ["compiled_ahead", "small_jobs_path"]
