# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluation of strategies: scenes, camera tracks and figures."""
