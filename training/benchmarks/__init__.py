# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurements against other programs, in the same process and on the same input."""
