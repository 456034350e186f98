# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tool itself costs: enabling it, applying a preset, planning a large scene, and memory over many cycles.

    python scripts/bench_tool.py [--cycles 1000] [--repeats 7] [enable] [apply] [plan] [memory]

Milliseconds of the processor in the thread that the user waits for, medians of the repeats: on an idle machine Blender's other
threads go on spinning for a while after a file is read, which nobody waits for. The clock's stand beside them, and are more where the
machine is busy. What a fresh process pays once is measured in fresh processes. A preset is
applied to Blender's start-up scene with the values that the panel offers. ``first`` holds the imports of a session,
``later`` does not. Goals are those of each family's default values; presets above them are marked too. The exit status is 1 where one is missed.
"""

from __future__ import annotations

import argparse
import atexit
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

ENABLE_MS, APPLY_MS, PLAN_MS, GROWTH_MB = 20.0, 50.0, 100.0, 8.0
MARK = {True: "", False: "  ABOVE THE GOAL"}
OBJECTS, LAMPS = 5000, 50


@cache
def environment() -> dict[str, str]:
    """Of a fresh process: bytecode is kept, as it is in an installed extension."""
    folder = tempfile.mkdtemp(prefix="volumetrics")
    atexit.register(shutil.rmtree, folder, True)
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPYCACHEPREFIX": folder}


def fresh(code: str) -> dict:
    """What the code leaves in ``result``, in a fresh process."""
    text = f"import json, sys, time\nimport bpy\n{code}\nprint('RESULT' + json.dumps(result))"
    done = subprocess.run([sys.executable, "-c", text], cwd=ROOT, check=True, capture_output=True, text=True, env=environment())
    return json.loads(done.stdout.partition("RESULT")[2])


def enable(repeats: int) -> bool:
    code = """
import gc
gc.collect()  # a full collection, which is due at any time, takes 25 ms over all that Blender has loaded
before = set(sys.modules)  # Blender's own add-ons load NumPy
start = time.thread_time()
import volumetrics_addon
volumetrics_addon.register()
spent = time.thread_time() - start
result = {'ms': 1e3 * spent, 'numpy': any(name.partition('.')[0] == 'numpy' for name in set(sys.modules) - before)}
volumetrics_addon.unregister()"""
    fresh(code)  # compiles
    runs = [fresh(code) for _ in range(repeats)]
    spent = median(run["ms"] for run in runs)
    good = spent <= ENABLE_MS and not any(run["numpy"] for run in runs)
    print(f"enabling          {spent:8.1f} ms, goal {ENABLE_MS:g}; "
          f"numpy {'loaded' if runs[0]['numpy'] else 'not loaded'}{MARK[good]}")
    return good


def families() -> dict[str, list[str]]:
    from volumetrics_addon.parameters.preset import load, names

    result: dict[str, list[str]] = {}
    for name in names():
        result.setdefault(load(name).family, []).append(name)
    return result


def add(scene, name: str):
    """The preset of that name in the scene, or the family's default values, as the panel adds them."""
    from volumetrics_addon.blender import items
    from volumetrics_addon.parameters.families import FAMILIES
    from volumetrics_addon.parameters.preset import load

    if name in FAMILIES:
        return items.add_item(scene, name, FAMILIES[name].defaults(), name.title())
    preset = load(name)
    return items.add_item(scene, preset.family, preset.parameters, preset.label, preset.stage["orders"])


def apply(repeats: int) -> bool:
    import bpy

    from volumetrics_addon.blender import items

    good = True
    for family, presets in families().items():
        code = (f"sys.path.insert(0, 'scripts')\nimport bench_tool\nstart = time.thread_time()\n"
                f"bench_tool.add(bpy.context.scene, {family!r})\nresult = 1e3 * (time.thread_time() - start)")
        fresh(code)
        first = median(fresh(code) for _ in range(min(repeats, 3)))
        for name in (family, *presets):
            spent, removing, clock = [], [], []
            for _ in range(repeats):
                bpy.ops.wm.read_factory_settings()
                start, began = time.thread_time(), time.perf_counter()
                item = add(bpy.context.scene, name)
                spent.append(1e3 * (time.thread_time() - start))
                clock.append(1e3 * (time.perf_counter() - began))
                start = time.thread_time()
                items.remove_item(bpy.context.scene, item)
                removing.append(1e3 * (time.thread_time() - start))
            fine = median(spent) <= APPLY_MS
            if name == family:
                good &= fine
            once = f"first {first:7.1f} ms" if name == family else " " * 16
            print(f"applying {family:<8} {'its defaults' if name == family else name:<18} {once}  later {median(spent):7.1f} ms  "
                  f"clock {median(clock):7.1f} ms  removing {median(removing):6.1f} ms{MARK[fine]}", flush=True)
    return good


def large_scene(objects: int = OBJECTS, lamps: int = LAMPS):
    """A field of boxes and lamps in haze, in a fresh file: one mesh for all, as when a user scatters."""
    import bpy

    from volumetrics_addon.bench import usual

    bpy.ops.wm.read_factory_settings(use_empty=False)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.volume_bounces = 4
    stone = usual._surface("Stone", (0.3, 0.3, 0.3))
    data = bpy.data.objects["Cube"].data
    data.materials.clear()
    data.materials.append(stone)
    side = round(objects**0.5)
    for i in range(objects - lamps - 4):
        block = bpy.data.objects.new("Block", data)
        block.location = (3.0 * (i % side), 3.0 * (i // side), 0.0)
        scene.collection.objects.link(block)
    for i in range(lamps):
        usual._light("POINT", (4.0 * i, 3.0 * (i * 7 % side), 3.0), 100.0)
    usual._box("Haze", (1.5 * side, 1.5 * side, 4.0), (3.2 * side, 3.2 * side, 10.0), usual._volume("Haze", usual._haze(0.02)))
    usual._box("Mist", (30.0, 30.0, 0.0), (40.0, 40.0, 2.0), usual._volume("Mist", usual._smoke(0.3, 1.0)))
    bpy.context.view_layer.update()
    return scene


def plan(repeats: int) -> bool:
    from volumetrics_addon.blender import tuning

    scene = large_scene()
    spent = []
    for _ in range(repeats):
        start = time.thread_time()
        advice = tuning.plan(scene)
        spent.append(1e3 * (time.thread_time() - start))
    good = median(spent) <= PLAN_MS
    print(f"planning          {median(spent):8.1f} ms, first {spent[0]:.1f}, goal {PLAN_MS:g}: {len(scene.objects)} objects, "
          f"{LAMPS} lamps, {len(advice)} pieces of advice{MARK[good]}")
    return good


def resident() -> float:
    """Megabytes of this process in memory."""
    import resource

    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def datablocks() -> dict[str, int]:
    import bpy

    return {p.identifier: len(getattr(bpy.data, p.identifier)) for p in bpy.data.bl_rna.properties if p.type == "COLLECTION"}


def memory(cycles: int) -> bool:
    import bpy

    from volumetrics_addon.blender import items

    good = True
    for family in families():
        bpy.ops.wm.read_factory_settings()
        scene, sizes, counts = bpy.context.scene, [], []
        for cycle in range(1, cycles + 1):
            items.remove_item(scene, add(scene, family))
            if cycle in (max(1, cycles // 10), cycles):
                sizes.append(resident())
                counts.append(datablocks())
        grown = sizes[1] - sizes[0]
        fine = grown <= GROWTH_MB and counts[0] == counts[1]
        good &= fine
        print(f"memory {family:<10} {sizes[0]:.1f} MB after {max(1, cycles // 10)} cycles, {grown:+.1f} MB after "
              f"{cycles}; datablocks {'the same' if counts[0] == counts[1] else 'differ'}{MARK[fine]}", flush=True)
    return good


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", default=["enable", "apply", "plan", "memory"], metavar="PART")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--cycles", type=int, default=1000)
    arguments = parser.parse_args()
    runs = {"enable": lambda: enable(arguments.repeats), "apply": lambda: apply(arguments.repeats),
            "plan": lambda: plan(arguments.repeats), "memory": lambda: memory(arguments.cycles)}
    for part in arguments.parts:
        if part not in runs:
            parser.error(f"there is no part {part!r}; the parts are {', '.join(runs)}")
    sys.exit(0 if all([runs[part]() for part in arguments.parts]) else 1)


if __name__ == "__main__":
    main()
