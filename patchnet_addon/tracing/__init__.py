# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras, ray traversal and super-sampling, with a plain reference beside every fast kernel."""
