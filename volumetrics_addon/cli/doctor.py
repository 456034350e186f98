# SPDX-License-Identifier: GPL-3.0-or-later
"""What the machine has, what is missing, and the command that installs it."""

from __future__ import annotations

import ctypes
import importlib
import os
import platform
import sys
from dataclasses import asdict, dataclass

# Shared libraries that bpy loads and a slim Debian lacks, and EGL for EEVEE without a screen -> Debian package.
LIBRARIES = {
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libEGL_mesa.so.0": "libegl-mesa0",
}
DRIVERS = "libgl1-mesa-dri"  # Mesa's software renderer, loaded by EGL


@dataclass(frozen=True)
class Check:
    """One line of the report; ``remedy`` is empty where nothing is wrong, ``required`` where rendering needs it."""

    name: str
    ok: bool
    detail: str
    remedy: str = ""
    required: bool = True


def missing_libraries() -> list[str]:
    missing = []
    for library in LIBRARIES:
        try:
            ctypes.CDLL(library)
        except OSError:
            missing.append(library)
    return missing


def install_command(libraries: list[str]) -> str:
    packages = sorted({LIBRARIES[library] for library in libraries} | {DRIVERS})
    return "apt-get install -y " + " ".join(packages)


def checks() -> list[Check]:
    result = [_python()]
    if sys.platform.startswith("linux"):
        missing = missing_libraries()
        result.append(Check("system libraries", not missing, f"missing {', '.join(missing)}" if missing else "all found",
                            install_command(missing) if missing else ""))
    bpy_check = _bpy()
    result.append(bpy_check)
    if bpy_check.ok:
        result += [_cycles(), _egl()]
    result.append(_compiler())
    return result


def _python() -> Check:
    version = platform.python_version()
    ok = sys.version_info >= (3, 11)
    return Check("Python", ok, f"{version}, {os.cpu_count()} cores", "" if ok else "use Python 3.11 or newer")


def _bpy() -> Check:
    try:
        bpy = importlib.import_module("bpy")
    except ImportError as error:
        return Check("Blender (bpy)", False, str(error), import_remedy(error))
    from ..blender import compat

    try:
        compat.current()
    except RuntimeError as error:
        return Check("Blender (bpy)", False, str(error), "pip install --upgrade bpy")
    return Check("Blender (bpy)", True, bpy.app.version_string)


def import_remedy(error: ImportError) -> str:
    """What to do when a module does not import: install it, or the shared libraries that it loads."""
    if isinstance(error, ModuleNotFoundError):
        if error.name == "bpy":
            return "python3 -m pip install bpy (4.5 for Python 3.11, 5.2 for Python 3.13), or run inside Blender"
        return f"python3 -m pip install {error.name}"
    libraries = [library for library in LIBRARIES if library in str(error)]
    if sys.platform.startswith("linux"):
        libraries += missing_libraries()
    return install_command(libraries) if libraries else "install the shared library that the message names"


def _cycles() -> Check:
    import bpy

    addon = bpy.context.preferences.addons.get("cycles")
    if addon is None:
        return Check("Cycles", False, "the add-on is off", "enable Cycles in the preferences")
    devices = sorted({device.name for kind in ("CUDA", "OPTIX", "HIP", "METAL", "ONEAPI")
                      for device in _devices(addon.preferences, kind) if device.type == kind})
    return Check("Cycles", True, "GPU: " + ", ".join(devices) if devices else "CPU only, no GPU found")


def _devices(preferences, kind: str) -> list:
    try:
        return list(preferences.get_devices_for_type(kind))
    except (TypeError, ValueError):  # a kind this build does not know
        return []


def _egl() -> Check:
    """A window or an EGL display, which EEVEE needs."""
    import bpy

    if not bpy.app.background:
        return Check("EEVEE", True, "in a window", required=False)
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError as error:
        return Check("EEVEE", False, str(error), install_command(["libEGL.so.1"]), required=False)
    egl.eglGetDisplay.restype = ctypes.c_void_p
    egl.eglGetDisplay.argtypes = [ctypes.c_void_p]
    egl.eglInitialize.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    platform_before = os.environ.get("EGL_PLATFORM")
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")
    try:
        works = bool(egl.eglInitialize(egl.eglGetDisplay(None), None, None))
    finally:
        if platform_before is None:
            del os.environ["EGL_PLATFORM"]
    return Check("EEVEE", works, "EGL works without a screen" if works else "EGL finds no driver",
                 "" if works else install_command(["libEGL.so.1", "libEGL_mesa.so.0"]), required=False)


def _compiler() -> Check:
    try:
        version = importlib.import_module("numba").__version__
    except ImportError:
        return Check("numba", False, "noise in the reference runs on NumPy, four times slower", "pip install numba",
                     required=False)
    return Check("numba", True, version, required=False)


def to_json(results: list[Check]) -> list[dict]:
    return [asdict(check) for check in results]
