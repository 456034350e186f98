# SPDX-License-Identifier: GPL-3.0-or-later
"""From a fresh clone to a picture or to tested: makes its own environments, needs only Python with pip.

    python3 scripts/run.py tour            one preset of each family with its error
    python3 scripts/run.py test            the tests, on every supported Blender LTS whose Python is here
    python3 scripts/run.py test --all      the same, and fails when one of the Pythons is missing
    python3 scripts/run.py COMMAND ...     any command of volumetrics

Environments lie in .venv-3.11 (Blender 4.5 LTS) and .venv-3.13 (Blender 5.2 LTS).
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PYTHONS = {"3.11": "4.5 LTS", "3.13": "5.2 LTS"}  # Python -> the Blender whose bpy wheel it takes


def find_python(version: str) -> str | None:
    """A working interpreter of that version: this one, on the PATH, from pyenv, or from uv."""
    candidates = [sys.executable, shutil.which(f"python{version}")]
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    candidates += [str(path) for path in sorted(pyenv.glob(f"{version}.*/bin/python"))]
    if uv := shutil.which("uv"):
        found = subprocess.run([uv, "python", "find", version], capture_output=True, text=True)
        candidates.append(found.stdout.strip())
    check = "import sys; print('%d.%d' % sys.version_info[:2])"
    for candidate in filter(None, candidates):
        answer = subprocess.run([candidate, "-c", check], capture_output=True, text=True)
        if answer.stdout.strip() == version:
            return candidate
    return None


def environment(version: str, python: str, *extras: str) -> Path:
    """The interpreter of an environment with the package and extras installed in place; made or completed when needed."""
    folder = ROOT / f".venv-{version}"
    interpreter = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    stamp = folder / "installed"
    digest = hashlib.sha256((ROOT / "pyproject.toml").read_bytes()).hexdigest()
    installed = stamp.read_text().split() if stamp.exists() else []
    if installed[:1] == [digest] and set(extras) <= set(installed):
        return interpreter
    print(f"preparing {folder.name} with bpy for Blender {PYTHONS[version]} (about 400 MB) ...", file=sys.stderr, flush=True)
    if not interpreter.exists():
        # --without-pip works on a Debian without python3-venv; the outer pip installs into it.
        subprocess.run([python, "-m", "venv", "--without-pip", str(folder)], check=True)
    subprocess.run([python, "-m", "pip", "--python", str(interpreter), "install", "--quiet", "--disable-pip-version-check",
                    "--editable", f"{ROOT}[{','.join(extras)}]"], check=True)
    stamp.write_text(" ".join([digest, *extras]))
    return interpreter


def test(arguments: list[str]) -> int:
    """The tests on every version at once, which takes two thirds of the time of one after the other."""
    need_all = "--all" in arguments
    arguments = [argument for argument in arguments if argument != "--all"]
    found = {version: find_python(version) for version in PYTHONS}
    for version in [version for version, python in found.items() if python is None]:
        print(f"Python {version} is not here, so Blender {PYTHONS[version]} is not tested", file=sys.stderr)
        if need_all:
            return 3
    interpreters = {version: environment(version, python, "test", "fast", "bench") for version, python in found.items() if python}
    if not interpreters:
        print(f"no supported Python is here; install one of {', '.join(PYTHONS)}", file=sys.stderr)
        return 3
    runs: list[tuple[str, subprocess.Popen, Path | None]] = []
    with tempfile.TemporaryDirectory(prefix="volumetrics") as folder:
        for version, interpreter in interpreters.items():
            log = Path(folder) / version if runs else None  # the first is seen as it runs, the others when it has ended
            with open(log, "wb") if log else contextlib.nullcontext() as output:
                if not log:
                    print(f"== Python {version}, Blender {PYTHONS[version]}", flush=True)
                runs.append((version, subprocess.Popen([str(interpreter), "-m", "pytest", *arguments], cwd=ROOT, stdout=output,
                                                       stderr=subprocess.STDOUT if log else None), log))
        codes = []
        for version, process, log in runs:
            codes.append(process.wait())
            if log:
                print(f"== Python {version}, Blender {PYTHONS[version]}\n{log.read_text(encoding='utf-8', errors='replace')}", flush=True)
    return max(abs(code) for code in codes)


def main(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help"):
        print(__doc__)
        return 0 if arguments else 2
    if arguments[0] == "test":
        return test(arguments[1:])
    for version in PYTHONS:
        if python := find_python(version):
            interpreter = environment(version, python, "fast", *(["bench"] if arguments[0] == "bench" else []))
            return subprocess.run([str(interpreter), "-m", "volumetrics_addon", *arguments]).returncode
    print(f"no supported Python is here; install one of {', '.join(PYTHONS)}", file=sys.stderr)
    return 3


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except subprocess.CalledProcessError as error:
        sys.exit(f"run.py: {' '.join(map(str, error.cmd[:4]))} ... failed with exit code {error.returncode}")
    except KeyboardInterrupt:
        sys.exit(130)
