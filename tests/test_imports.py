# SPDX-License-Identifier: GPL-3.0-or-later
"""Who may import what: Blender stays in its rooms, and looking costs nothing."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "volumetrics_addon"
FILES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))

BLENDER = {"bpy", "bmesh", "mathutils", "blf", "imbuf", "gpu", "bpy_extras", "bl_math"}
NUMERIC = {"numpy", "numba"}
HEADLESS = {"bench/chart.py": {"matplotlib"}}  # inside functions only, and never in Blender
BLENDER_ROOMS = ("blender/", "ui/", "bench/usual.py")
BLENDER_IN_FUNCTIONS = ("cli/", "verify.py")
# What the panel, the command line and a test without Blender load.
STANDARD_ONLY = ("__init__.py", "parameters/", "plan/", "cli/", "scene/__init__.py", "scene/model.py", "scene/assemble.py", "scene/families/",
                 "scene/describe.py", "scene/derived.py")


def imports(file):
    """(absolute top-level names, files inside the package) that a module imports: at its top, and in functions."""
    found = {False: (set(), set()), True: (set(), set())}

    def visit(node, in_function):
        absolute, relative = found[in_function]
        if isinstance(node, ast.Import):
            absolute.update(alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            absolute.add(node.module.partition(".")[0])
        elif isinstance(node, ast.ImportFrom):
            folder = (PACKAGE / file).parents[node.level - 1]
            assert folder.is_relative_to(PACKAGE), f"{file} reaches out of the package"
            base = folder.joinpath(*(node.module or "").split("."))
            for path in (base, *(base / alias.name for alias in node.names)):
                for candidate in (path.with_suffix(".py"), path / "__init__.py"):
                    if candidate.is_file():
                        relative.add(candidate.relative_to(PACKAGE).as_posix())
        deeper = in_function or isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
        for child in ast.iter_child_nodes(node):
            visit(child, deeper)

    visit(ast.parse((PACKAGE / file).read_text(encoding="utf-8")), False)
    return found


def closure(file):
    """Everything that importing the file imports: files of the package and absolute top-level names."""
    seen, names, waiting = set(), set(), [file]
    while waiting:
        current = waiting.pop()
        if current in seen:
            continue
        seen.add(current)
        absolute, relative = imports(current)[False]
        names |= absolute
        waiting += relative
        parents = Path(current).parents
        waiting += [(parent / "__init__.py").as_posix() for parent in parents]
    return seen, names


def test_the_walk_finds_the_package():
    assert len(FILES) >= 40
    assert "bpy" in imports("blender/items.py")[False][0]
    assert "bpy" in imports("cli/doctor.py")[True][0]
    assert "parameters/families.py" in imports("parameters/preset.py")[False][1]
    assert closure("plan/rules.py")[0] >= {"plan/model.py", "scene/model.py", "scene/__init__.py", "__init__.py"}


@pytest.mark.parametrize("file", FILES)
def test_blender_stays_in_its_rooms(file):
    top, inside = (names & BLENDER for names, _ in imports(file).values())
    if not file.startswith(BLENDER_ROOMS):
        assert not top, f"{file} imports {top} at module level"
    if not file.startswith(BLENDER_ROOMS + BLENDER_IN_FUNCTIONS):
        assert not inside, f"{file} imports {inside} in a function"


@pytest.mark.parametrize("file", FILES)
def test_imports_are_relative_inside_and_known_outside(file):
    """Inside Blender the package has another name, and an extension brings no modules of its own."""
    known = set(sys.stdlib_module_names) | BLENDER | NUMERIC
    for in_function, (absolute, _) in imports(file).items():
        allowed = known | (HEADLESS.get(file, set()) if in_function else set())
        assert absolute <= allowed, f"{file} imports {absolute - allowed}"


@pytest.mark.parametrize("file", [file for file in FILES if file.startswith(STANDARD_ONLY)])
def test_light_modules_need_only_the_standard_library(file):
    _, names = closure(file)
    assert names <= set(sys.stdlib_module_names), f"importing {file} imports {names - set(sys.stdlib_module_names)}"


def test_ui_registers_without_numpy_and_without_builders():
    """At module level the panels need bpy and the declarations, nothing that builds."""
    files, names = closure("ui/__init__.py")
    assert names <= set(sys.stdlib_module_names) | {"bpy"}
    assert not {file for file in files if file.startswith(("blender/", "reference/", "scene/", "compare/"))}


def test_light_modules_import_where_numpy_and_blender_are_missing():
    light = [file.removesuffix(".py").replace("/", ".") for file in FILES
             if file.startswith(STANDARD_ONLY) and not file.endswith("__init__.py")]
    assert len(light) >= 15
    code = "\n".join(["import sys", *(f"sys.modules[{name!r}] = None" for name in sorted(BLENDER | NUMERIC)),
                      *(f"import volumetrics_addon.{name}" for name in light)])
    subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=ROOT, check=True)


def test_importing_the_package_imports_nothing_else():
    code = ("import sys; before = set(sys.modules); import volumetrics_addon; "
            "print(*sorted(set(sys.modules) - before))")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["volumetrics_addon"]
