# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of all settings, declared once for the scene and for operators.

Each group of settings is a class to mix into operators and into the property group of the scene.
"""

from .job import absolute_path as absolute_path
