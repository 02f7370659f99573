# SPDX-License-Identifier: GPL-3.0-or-later
"""Furniture libraries (.sh3f) and plans of rooms and gardens with their models."""
