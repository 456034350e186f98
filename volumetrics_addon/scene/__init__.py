# SPDX-License-Identifier: GPL-3.0-or-later
"""The Scene: plain frozen data in SI units, without Blender."""
