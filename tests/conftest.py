# SPDX-License-Identifier: GPL-3.0-or-later
"""What says the same in every Blender takes turns: it runs with one of them, and with the other in the sweeps.

These are long tests that are marked so, and all tests of folders whose code has nothing of Blender in it.
"""

import hashlib
import sys
from pathlib import Path

import pytest

NO_BLENDER = {"compare", "physics", "reference", "scene", "stability"}
TURN = int(sys.version_info < (3, 12))  # of two Pythons, each of which has a Blender


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items):
    for item in items:
        folder = item.path.relative_to(Path(__file__).parent).parts[0]
        if (folder in NO_BLENDER or item.get_closest_marker("either")) and \
                hashlib.sha256(item.nodeid.encode()).digest()[-1] % 2 == TURN:
            item.add_marker(pytest.mark.sweep)
