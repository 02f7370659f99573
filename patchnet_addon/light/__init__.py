# SPDX-License-Identifier: GPL-3.0-or-later
"""Baked light: surfels that stand for light cells, their choice by cameras, their filter, and the look-up."""
