# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference integrators over the Scene; each result states its error."""
