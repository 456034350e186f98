# SPDX-License-Identifier: GPL-3.0-or-later
"""Long tests that say the same in every Blender take turns: each runs in one of them, and in the other with the sweeps."""

import hashlib

import pytest


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items):
    for item in items:
        if item.get_closest_marker("either") and hashlib.sha256(item.nodeid.encode()).digest()[-1] % 2 == turn():
            item.add_marker(pytest.mark.sweep)


def turn():
    import bpy  # whose tests alone are marked so

    return int(bpy.app.version >= (5, 0, 0))
