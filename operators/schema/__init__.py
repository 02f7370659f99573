# SPDX-License-Identifier: GPL-3.0-or-later
"""Declarations of settings, from which properties, arguments, checks and keys are derived."""
