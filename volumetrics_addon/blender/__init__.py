# SPDX-License-Identifier: GPL-3.0-or-later
"""The only room, with ui, that knows Blender."""
