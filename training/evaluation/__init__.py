# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluation of refinement strategies over budgets: curves, intervals, checks and picture metrics (methods 5)."""
