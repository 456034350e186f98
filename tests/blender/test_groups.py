# SPDX-License-Identifier: GPL-3.0-or-later
"""The node trees as text, one snapshot for both Blender LTS.

Rewrite the snapshots with:  VOLUMETRICS_UPDATE_SNAPSHOTS=1 python -m pytest tests/blender/test_groups.py
"""

import math
import os
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from volumetrics_addon.blender import build, groups  # noqa: E402
from volumetrics_addon.blender.fields import fields_of  # noqa: E402
from volumetrics_addon.parameters.families import FAMILIES  # noqa: E402
from volumetrics_addon.parameters.preset import load, names  # noqa: E402
from volumetrics_addon.verify import scene_of  # noqa: E402

SNAPSHOTS = Path(__file__).parent / "snapshots"
# What tells one node from another of its type; versions add properties of their own.
PROPERTIES = ("operation", "use_clamp", "target", "phase", "noise_dimensions", "noise_type", "normalize", "vector_type",
              "convert_from", "convert_to")

# Shown by newer versions on nodes that do not use them.
UNUSED = ("Thin Film Thickness", "Thin Film IOR")


def plain(value):
    if hasattr(value, "__len__") and not isinstance(value, str):
        return "(" + ", ".join(f"{v:.6g}" for v in value) + ")"
    return f"{value:.6g}" if isinstance(value, float) else repr(value)


def describe(tree):
    """One line per node that the outputs reach, numbered depth first from the outputs in the order of their inputs."""
    numbers, lines = {}, []

    def visit(node):
        if node in numbers:
            return numbers[node]
        settings = [f"{p}={getattr(node, p)!r}" for p in PROPERTIES if hasattr(node, p)]
        inputs = []
        for index, socket in enumerate(node.inputs):
            if not socket.enabled or socket.bl_idname == "NodeSocketVirtual" or socket.identifier in UNUSED:
                continue
            if socket.is_linked:
                link = socket.links[0]
                inputs.append(f"{socket.identifier}<-{visit(link.from_node)}.{link.from_socket.identifier}")
            elif hasattr(socket, "default_value") and not socket.hide_value:
                inputs.append(f"{socket.identifier}={plain(socket.default_value)}")
        numbers[node] = f"n{len(numbers)}"
        lines.append(f"{numbers[node]} = {node.bl_idname}({', '.join(settings + inputs)})")
        return numbers[node]

    ends = [n for n in tree.nodes if n.bl_idname in ("NodeGroupOutput", "ShaderNodeOutputMaterial")]
    for end in sorted(ends, key=lambda node: getattr(node, "target", "")):
        visit(end)
    assert len(numbers) == len(tree.nodes), "a node leads nowhere"
    return [f"{item.in_out} {item.name}: {item.socket_type}" for item in tree.interface.items_tree] + lines


def variants():
    yield "cloud-homogeneous-hg", "cloud", {"density": "homogeneous", "phase": "hg"}, "mist"
    yield "cloud-noise-dual", "cloud", {}, "cumulus"
    yield "cloud-billows-mie", "cloud", {"billow_octaves": 3, "base": 0.1, "profile": "anvil", "phase": "mie"}, "storm"
    yield "fog", "fog", {}, "fog"
    yield "godray", "godray", {}, "beam"
    yield "godray-dust", "godray", {"dust_strength": 1.5, "dust_seed": 3}, "beam"
    yield "glass-sphere", "glass", {}, "ball"
    yield "glass-block", "glass", {"shape": "block"}, "block"
    yield "glass-shell", "glass", {"shape": "shell"}, "shell"
    yield "glass-sheet", "glass", {"shape": "sheet"}, "sheet"
    yield "glass-lead", "glass", {"shape": "sheet", "coverage_pattern": "lead"}, "lead"
    yield "glass-dirt", "glass", {"shape": "sheet", "coverage_pattern": "dirt", "refraction": False}, "dirt"
    yield "glass-tint", "glass", {"refraction": False}, "tint"
    yield "air", "air", {}, "air"


VARIANTS = list(variants())


@pytest.mark.parametrize("snapshot, family, changes, label", VARIANTS, ids=[v[0] for v in VARIANTS])
def test_node_trees_are_as_recorded(snapshot, family, changes, label):
    from volumetrics_addon.scene import assemble

    values = FAMILIES[family].check(changes)
    volume = assemble.ASSEMBLERS[family](values, assemble.Bounds([(-5, -5, 0), (5, 5, 3)])).volumes[0]
    with build.temporary():
        material = groups.material(FAMILIES[family], values, volume.domain, label, fields_of(volume))
        node = next(n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeGroup")
        lines = ["# group", *describe(node.node_tree), "# material", *describe(material.node_tree)]
    text = "\n".join(lines) + "\n"
    path = SNAPSHOTS / f"{snapshot}.txt"
    if os.environ.get("VOLUMETRICS_UPDATE_SNAPSHOTS"):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8")


def test_every_snapshot_is_tested():
    assert {path.stem for path in SNAPSHOTS.glob("*.txt")} == {v[0] for v in VARIANTS}


@pytest.mark.parametrize("family", FAMILIES)
def test_live_parameters_are_sockets_with_their_declaration(family):
    from volumetrics_addon.scene import assemble

    values = FAMILIES[family].defaults()
    domain = assemble.ASSEMBLERS[family](values, assemble.Bounds([(-5, -5, 0), (5, 5, 3)])).volumes[0].domain
    with build.temporary():
        tree = groups.group(FAMILIES[family], values, domain, "group")
        sockets = [item for item in tree.interface.items_tree if item.in_out == "INPUT"]
        assert [s.name for s in sockets] == [p.label for p in FAMILIES[family].live] and sockets
        for socket, parameter in zip(sockets, FAMILIES[family].live):
            assert socket.description == parameter.description
            if parameter.kind in ("float", "int"):
                factor = math.radians(1.0) if parameter.unit == "deg" else 1.0
                assert socket.min_value == pytest.approx(factor * parameter.minimum)
                assert socket.max_value == pytest.approx(factor * parameter.maximum)
                assert socket.default_value == pytest.approx(factor * parameter.default)


def test_both_engines_get_an_output_of_their_own():
    for name in names():
        preset = load(name)
        with build.temporary():
            volume = scene_of(preset).volumes[0]
            material = groups.material(preset.group, preset.parameters, volume.domain, name, fields_of(volume))
            outputs = [n for n in material.node_tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial"]
            assert {o.target for o in outputs} == {"CYCLES", "EEVEE"}
            for output in outputs:
                linked = [s for s in output.inputs if s.is_linked]
                assert linked, f"{name}: {output.target} gets nothing"


def test_eevee_never_gets_two_lobes():
    """EEVEE adds the g of added scatter nodes; its shader has exactly one."""
    values = FAMILIES["cloud"].defaults()
    from volumetrics_addon.scene.model import Ellipsoid

    with build.temporary():
        tree = groups.group(FAMILIES["cloud"], values, Ellipsoid((0, 0, 0), (1, 1, 1)), "group")
        leave = next(n for n in tree.nodes if n.bl_idname == "NodeGroupOutput")
        seen, queue = set(), [next(s for s in leave.inputs if s.name.startswith("EEVEE"))]
        while queue:
            for link in queue.pop().links:
                if link.from_node not in seen:
                    seen.add(link.from_node)
                    queue += [s for s in link.from_node.inputs if s.is_linked]
        assert sum(n.bl_idname == "ShaderNodeVolumeScatter" for n in seen) == 1
