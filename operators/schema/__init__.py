# SPDX-License-Identifier: GPL-3.0-or-later
"""Form of a setting's declaration, from which properties, panels, arguments, checks and keys are derived."""
