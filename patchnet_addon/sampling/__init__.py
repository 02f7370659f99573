# SPDX-License-Identifier: GPL-3.0-or-later
"""Refinement strategies, their registry, budgets and refining."""
