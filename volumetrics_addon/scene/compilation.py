# SPDX-License-Identifier: GPL-3.0-or-later
"""Compiled kernels that are never older than the sources they were compiled from.

numba keeps what it compiled until the file of the function changes. Functions and constants that it took from other files
go stale unnoticed: whoever changed the layout of ``path_scene`` would render with the old one.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent
SOURCES = tuple(_PACKAGE / name for name in (
    "scene/model.py", "scene/noise.py", "scene/noise_kernel.py", "reference/path_scene.py", "reference/path_kernel.py",
    "reference/quadrature_kernel.py", "reference/light_kernel.py"))


def forget_stale_kernels(module: str) -> bool:
    """Delete numba's files beside the source file ``module`` when the sources have changed since; returns whether they had.

    A folder that cannot be written to is left alone: numba then keeps its files elsewhere, by the time of the install.
    """
    folder = Path(module).resolve().parent / "__pycache__"
    digest = hashlib.sha256(b"\0".join(source.read_bytes() for source in SOURCES)).hexdigest()
    stamp = folder / "kernels.sha256"
    try:
        if stamp.exists() and stamp.read_text() == digest:
            return False
        folder.mkdir(exist_ok=True)
        for stale in [*folder.glob("*.nbi"), *folder.glob("*.nbc")]:
            stale.unlink(missing_ok=True)
        stamp.write_text(digest)
    except OSError:
        return False
    return True
