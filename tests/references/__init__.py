# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain reference implementations for tests of fast ones."""
