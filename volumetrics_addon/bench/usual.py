# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes with volumes the way users make them: Blender's start-up settings plus what the tutorials of the genre set.

Each builder adds to the start-up scene, from which the cube has been deleted as every tutorial begins, and sets nothing that
its users would not: the engines' defaults stay, the good ones and the slow ones. A medium on the ground reaches into it: of two faces
in one plane Cycles loses one or the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import bmesh
import bpy
from mathutils import Matrix, Vector

from ..blender.compat import use_nodes
from ..blender.nodes import Tree

Point = tuple[float, float, float]


@dataclass(frozen=True)
class UsualScene:
    """A scene of users: its name, what it shows, what builds it, and the frames that its picture is made of."""

    name: str
    title: str
    fill: Callable[[bpy.types.Scene], None]
    frames: tuple[int, ...] = (1,)

    def build(self) -> bpy.types.Scene:
        """The scene in a fresh file; whatever was open is closed."""
        bpy.ops.wm.read_factory_settings(use_empty=False)
        bpy.data.objects.remove(bpy.data.objects["Cube"])
        scene = bpy.context.scene
        self.fill(scene)
        bpy.context.view_layer.update()
        return scene


SCENES: list[UsualScene] = []


def by_name(name: str) -> UsualScene:
    """The scene of that name. Raises ValueError for an unknown one."""
    for scene in SCENES:
        if scene.name == name:
            return scene
    raise ValueError(f"there is no scene {name!r}; the scenes are {', '.join(scene.name for scene in SCENES)}")


def _usual(name: str, title: str, frames: tuple[int, ...] = (1,)) -> Callable:
    def register(fill: Callable[[bpy.types.Scene], None]) -> Callable:
        SCENES.append(UsualScene(name, title, fill, frames))
        return fill
    return register


# --- what all scenes are made of ---------------------------------------------------------------------------------------


def _tree(block: bpy.types.Material | bpy.types.World, output: str) -> tuple[Tree, bpy.types.Node]:
    build = Tree(use_nodes(block))
    return build, build.node(output)


def _surface(name: str, color: Point, roughness: float = 0.8) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    build, output = _tree(material, "ShaderNodeOutputMaterial")
    shader = build.node("ShaderNodeBsdfPrincipled", {"Base Color": (*color, 1.0), "Roughness": roughness})
    build.feed(output.inputs["Surface"], shader.outputs[0])
    return material


def _volume(name: str, shader: Callable[[Tree], bpy.types.Node]) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    build, output = _tree(material, "ShaderNodeOutputMaterial")
    build.feed(output.inputs["Volume"], shader(build).outputs[0])
    return material


def _haze(density: float, anisotropy: float = 0.0, color: Point = (0.8, 0.8, 0.8)) -> Callable[[Tree], bpy.types.Node]:
    """Volume Scatter, as tutorials add it, with its default colour."""
    inputs = {"Color": (*color, 1.0), "Density": density, "Anisotropy": anisotropy}
    return lambda build: build.node("ShaderNodeVolumeScatter", inputs)


def _noise(build: Tree, scale: float, detail: float, low: float, high: float, coordinate: str = "Object",
           w: bool = False) -> tuple[bpy.types.NodeSocket, bpy.types.Node]:
    """Texture Coordinate -> Noise -> Color Ramp, the usual three nodes: 0 below ``low``, 1 above ``high``."""
    where = build.node("ShaderNodeTexCoord").outputs[coordinate]
    inputs = {"Vector": where, "Scale": scale, "Detail": detail}
    noise = build.node("ShaderNodeTexNoise", inputs, noise_dimensions="4D" if w else "3D")
    ramp = build.node("ShaderNodeValToRGB", {0: noise.outputs[0]})
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = low, high
    return ramp.outputs[0], noise


def _smoke(density: float, scale: float, detail: float = 4.0, low: float = 0.45, high: float = 0.65, anisotropy: float = 0.0,
           coordinate: str = "Object") -> Callable[[Tree], bpy.types.Node]:
    """Principled Volume, its density a noise through a color ramp times a number."""
    def shader(build: Tree) -> bpy.types.Node:
        ramp, _ = _noise(build, scale, detail, low, high, coordinate)
        inputs = {"Density": build.math("MULTIPLY", ramp, density), "Anisotropy": anisotropy}
        return build.node("ShaderNodeVolumePrincipled", inputs)
    return shader


def _object(name: str, fill: Callable[[bmesh.types.BMesh], None], where: Matrix, material: bpy.types.Material | None,
            smooth: bool = False) -> bpy.types.Object:
    data = bpy.data.meshes.new(name)
    build = bmesh.new()
    fill(build)
    build.to_mesh(data)
    build.free()
    if smooth:
        data.polygons.foreach_set("use_smooth", [True] * len(data.polygons))
    if material is not None:
        data.materials.append(material)
    made = bpy.data.objects.new(name, data)
    made.matrix_world = where
    bpy.context.scene.collection.objects.link(made)
    return made


def _box(name: str, center: Point, size: Point, material: bpy.types.Material) -> bpy.types.Object:
    """A scaled cube, as Add > Cube and S make it."""
    return _object(name, lambda build: bmesh.ops.create_cube(build, size=2.0),
                   Matrix.LocRotScale(center, None, Vector(size) / 2.0), material)


def _plane(name: str, size: float, material: bpy.types.Material, z: float = 0.0) -> bpy.types.Object:
    return _object(name, lambda build: bmesh.ops.create_grid(build, x_segments=1, y_segments=1, size=size / 2.0),
                   Matrix.Translation((0.0, 0.0, z)), material)


def _ball(name: str, center: Point, radius: float, material: bpy.types.Material) -> bpy.types.Object:
    return _object(name, lambda build: bmesh.ops.create_icosphere(build, subdivisions=4, radius=radius),
                   Matrix.Translation(center), material, smooth=True)


def _cone(name: str, base: Point, radius: float, height: float, material: bpy.types.Material, tip: float = 0.0,
          segments: int = 16) -> bpy.types.Object:
    """A cone on its base, or a cylinder where the tip is as wide."""
    where = Matrix.Translation(Vector(base) + Vector((0.0, 0.0, height / 2.0)))
    return _object(name, lambda build: bmesh.ops.create_cone(build, cap_ends=True, segments=segments, radius1=radius, radius2=tip,
                                                             depth=height), where, material)


def _post(name: str, base: Point, radius: float, height: float, material: bpy.types.Material) -> bpy.types.Object:
    return _cone(name, base, radius, height, material, tip=radius)


def _aimed(position: Point, target: Point) -> Matrix:
    direction = Vector(target) - Vector(position)
    return Matrix.LocRotScale(position, direction.to_track_quat("-Z", "Y"), None)


def _light(kind: str, position: Point, power: float, target: Point = (0.0, 0.0, 0.0), color: Point = (1.0, 1.0, 1.0),
           radius: float = 0.1, **settings: Any) -> bpy.types.Object:
    data = bpy.data.lights.new(kind.title(), kind)
    data.energy, data.color = power, color
    if kind in ("POINT", "SPOT"):
        data.shadow_soft_size = radius
    for name, value in settings.items():
        setattr(data, name, value)
    made = bpy.data.objects.new(kind.title(), data)
    made.matrix_world = _aimed(position, target)
    bpy.context.scene.collection.objects.link(made)
    return made


def _camera(position: Point, target: Point, lens: float = 50.0, reach: float = 100.0) -> None:
    """Cycles leaves out a volume whose far side lies beyond the camera's end and has no surface before it."""
    camera = bpy.context.scene.camera
    camera.matrix_world = _aimed(position, target)
    camera.data.lens, camera.data.clip_end = lens, reach


def _sky(color: Point, strength: float = 1.0) -> tuple[Tree, bpy.types.Node]:
    """The world in one colour; its tree and output, for a volume."""
    build, output = _tree(bpy.context.scene.world, "ShaderNodeOutputWorld")
    background = build.node("ShaderNodeBackground", {"Color": (*color, 1.0), "Strength": strength})
    build.feed(output.inputs["Surface"], background.outputs[0])
    return build, output


def _panorama(horizon: Point, zenith: Point, strength: float = 1.0) -> None:
    """A sky in place of a panorama: Texture Coordinate -> Separate XYZ -> Color Ramp."""
    build, output = _tree(bpy.context.scene.world, "ShaderNodeOutputWorld")
    _, _, height = build.components(build.node("ShaderNodeTexCoord").outputs["Generated"])
    ramp = build.node("ShaderNodeValToRGB", {0: height})
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (*horizon, 1.0), (*zenith, 1.0)
    background = build.node("ShaderNodeBackground", {"Color": ramp.outputs[0], "Strength": strength})
    build.feed(output.inputs["Surface"], background.outputs[0])


def _delete_lamp() -> None:
    bpy.data.objects.remove(bpy.data.objects["Light"])


def _scattered(count: int, low: float, high: float) -> Iterable[tuple[float, float]]:
    """Points over a square in an order without clumps: a golden-ratio sequence."""
    for i in range(count):
        yield low + (high - low) * (0.7548776662 * (i + 1) % 1.0), low + (high - low) * (0.5698402910 * (i + 1) % 1.0)


def _tree_trunks(points: Iterable[tuple[float, float]], height: float, bark: bpy.types.Material,
                 leaves: bpy.types.Material) -> None:
    for x, y in points:
        _post("Trunk", (x, y, 0.0), 0.25, height, bark)
        for level in (0.55, 0.75, 0.95):
            _cone("Branches", (x, y, level * height), 1.6 * (1.35 - level), 0.35 * height, leaves, segments=9)


# --- the scenes --------------------------------------------------------------------------------------------------------


@_usual("foggy-street", "World-volume fog between street lamps")
def _foggy_street(scene: bpy.types.Scene) -> None:
    """Volume Scatter of density 0.03 in the world ("fog everywhere in two clicks"), six lamps of 300 W along a street."""
    _delete_lamp()
    build, output = _sky((0.01, 0.013, 0.025))
    build.feed(output.inputs["Volume"], _haze(0.03, 0.2)(build).outputs[0])
    asphalt, brick, iron = _surface("Asphalt", (0.08,) * 3), _surface("Brick", (0.3, 0.16, 0.1)), _surface("Iron", (0.05,) * 3)
    _plane("Road", 90.0, asphalt)
    for i in range(5):
        for side in (-1, 1):
            _box("House", (side * 9.5, 9.0 * i, 3.0 + 0.5 * (i * 7 % 3)), (7.0, 7.5, 6.0 + i * 7 % 3), brick)
    for y in (2.0, 12.0, 22.0):
        for side in (-1, 1):
            _post("Post", (side * 4.2, y, 0.0), 0.08, 4.0, iron)
            _light("POINT", (side * 4.0, y, 4.2), 300.0, color=(1.0, 0.72, 0.4))
    _camera((0.0, -11.0, 1.7), (0.0, 10.0, 2.4), 35.0)


@_usual("noise-cube", "The start-up cube as a cloud of noise")
def _noise_cube(scene: bpy.types.Scene) -> None:
    """Noise through a color ramp into a Principled Volume on a cube, over a floor, with the start-up lamp and four bounces."""
    _plane("Floor", 40.0, _surface("Floor", (0.4, 0.4, 0.42)), -1.6)
    _box("Cube", (0.0, 0.0, 0.0), (4.0, 4.0, 2.6), _volume("Cloud", _smoke(6.0, 0.9, 4.0, 0.48, 0.62)))
    _light("SUN", (0.0, 0.0, 5.0), 3.0, (-1.0, 1.0, 0.0))
    _camera((8.5, -8.0, 3.4), (0.0, 0.0, -0.2))
    scene.cycles.volume_bounces = 4


@_usual("cathedral", "Sun through the windows of a hall, twelve bounces")
def _cathedral(scene: bpy.types.Scene) -> None:
    """A hall filled by a cube of Volume Scatter, a sun through windows; all bounces at 12 "so that nothing is missing"."""
    _delete_lamp()
    stone = _surface("Stone", (0.45, 0.4, 0.33))
    _sky((0.25, 0.35, 0.5), 0.4)
    _box("Floor", (0.0, 0.0, -0.25), (12.0, 30.0, 0.5), stone)
    _box("Roof", (0.0, 0.0, 9.25), (12.0, 30.0, 0.5), stone)
    _box("Wall", (-5.5, 0.0, 4.5), (0.5, 30.0, 9.0), stone)
    _box("End", (0.0, 14.75, 4.5), (12.0, 0.5, 9.0), stone)
    _box("Entrance", (0.0, -14.75, 4.5), (12.0, 0.5, 9.0), stone)
    _box("Sill", (5.5, 0.0, 1.25), (0.5, 30.0, 2.5), stone)
    _box("Lintel", (5.5, 0.0, 8.25), (0.5, 30.0, 1.5), stone)
    for i in range(9):
        _box("Pillar", (5.5, -13.6 + 3.4 * i, 5.0), (0.6, 1.9, 5.2), stone)
    for side in (-1, 1):
        for i in range(4):
            _post("Column", (2.6 * side, -7.0 + 6.0 * i, 0.0), 0.4, 9.0, stone)
    _box("Haze", (0.0, 0.0, 4.5), (10.4, 29.0, 8.9), _volume("Haze", _haze(0.04, 0.3)))
    _light("SUN", (20.0, 0.0, 20.0), 25.0, (0.0, 4.0, 2.0), (1.0, 0.9, 0.7), angle=math.radians(0.5))
    _camera((-1.0, -13.5, 2.2), (0.6, 6.0, 3.6), 24.0)
    cycles = scene.cycles
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = cycles.volume_bounces = 12


@_usual("club", "Twenty lights, of which three light the stage")
def _club(scene: bpy.types.Scene) -> None:
    """Three strong spots through the haze of a stage; seventeen lamps of the house that are dim, far or behind the set."""
    _delete_lamp()
    _sky((0.0, 0.0, 0.0))
    black, wood = _surface("Black", (0.03,) * 3), _surface("Wood", (0.25, 0.14, 0.07))
    skin = _surface("Figure", (0.5, 0.35, 0.28))
    _box("Stage", (0.0, 4.0, 0.5), (14.0, 8.0, 1.0), wood)
    _box("Backdrop", (0.0, 8.2, 4.0), (16.0, 0.3, 8.0), black)
    _plane("Floor", 60.0, black)
    for x in (-3.5, 0.0, 3.5):
        _cone("Singer", (x, 3.5, 1.0), 0.45, 1.5, skin)
        _ball("Head", (x, 3.5, 2.65), 0.28, skin)
    _box("Haze", (0.0, 1.0, 4.1), (16.0, 13.0, 8.0), _volume("Haze", _haze(0.06)))
    for x, color in ((-3.5, (1.0, 0.3, 0.25)), (0.0, (0.4, 0.6, 1.0)), (3.5, (0.9, 0.4, 1.0))):
        _light("SPOT", (0.6 * x, -1.5, 7.6), 9000.0, (x, 3.6, 1.2), color, spot_size=math.radians(22.0), spot_blend=0.2)
    for i in range(8):  # bulbs of the dressing rooms, behind the backdrop
        _light("POINT", (-7.0 + 2.0 * i, 12.0, 2.5), 100.0, color=(1.0, 0.85, 0.6))
    for i in range(5):  # exit signs
        _light("POINT", (-12.0 + 6.0 * i, -16.0, 2.6), 0.2, color=(0.2, 1.0, 0.3))
    for i in range(4):  # the bar
        _light("SPOT", (-22.0, -10.0 + 3.0 * i, 3.0), 25.0, (-26.0, -10.0 + 3.0 * i, 0.0), (1.0, 0.8, 0.5))
    _camera((0.0, -11.0, 2.6), (0.0, 3.5, 3.1), 35.0)


@_usual("lone-cloud", "A small cloud in a huge domain")
def _lone_cloud(scene: bpy.types.Scene) -> None:
    """A cube of 160 m, so that the domain is never in the way, a ball of noise in its middle; sun, blue sky, four bounces."""
    _delete_lamp()
    _panorama((0.45, 0.6, 0.85), (0.08, 0.2, 0.5))
    _plane("Meadow", 600.0, _surface("Meadow", (0.12, 0.2, 0.05)), -30.0)

    def shader(build: Tree) -> bpy.types.Node:
        noise, _ = _noise(build, 9.0, 5.0, 0.46, 0.6)
        where = build.node("ShaderNodeTexCoord").outputs["Object"]
        ball = build.node("ShaderNodeMapRange", {0: build.scalar("LENGTH", where), 1: 0.08, 2: 0.2, 3: 1.0, 4: 0.0})
        density = build.math("MULTIPLY", build.math("MULTIPLY", ball.outputs[0], noise), 0.6)
        return build.node("ShaderNodeVolumePrincipled", {"Color": (0.95, 0.95, 0.95, 1.0), "Density": density, "Anisotropy": 0.3})

    _box("Domain", (0.0, 0.0, 0.0), (160.0, 160.0, 160.0), _volume("Cloud", shader))
    _light("SUN", (30.0, -10.0, 30.0), 4.0, angle=math.radians(0.5))
    _camera((0.0, -62.0, -14.0), (0.0, 0.0, -1.0), 40.0, 1000.0)
    scene.cycles.volume_bounces = 4


@_usual("spot-haze", "A spot on a statue in a large box of haze")
def _spot_haze(scene: bpy.types.Scene) -> None:
    """One spot from above, black world, a cube of 40 m of Volume Scatter around everything."""
    _delete_lamp()
    _sky((0.0, 0.0, 0.0))
    marble = _surface("Marble", (0.7, 0.68, 0.62))
    _plane("Floor", 38.0, _surface("Floor", (0.15, 0.14, 0.13)), 0.01)
    _box("Plinth", (0.0, 0.0, 0.6), (1.4, 1.4, 1.2), marble)
    _cone("Robe", (0.0, 0.0, 1.2), 0.6, 2.0, marble)
    _ball("Head", (0.0, 0.0, 3.2), 0.32, marble)
    _box("Haze", (0.0, 0.0, 10.0), (40.0, 40.0, 20.0), _volume("Haze", _haze(0.04)))
    _light("SPOT", (2.5, 1.5, 9.0), 20000.0, (0.0, 0.0, 1.5), (1.0, 0.93, 0.8), spot_size=math.radians(28.0))
    _camera((0.0, -14.0, 3.0), (0.0, 0.0, 3.6), 40.0)


@_usual("bottle", "Coloured glass by absorption, with caustics")
def _bottle(scene: bpy.types.Scene) -> None:
    """Glass BSDF and Volume Absorption on a bottle and a ball, an area light, caustics as they are by default: on."""
    _delete_lamp()
    _sky((0.25, 0.27, 0.3))

    def glass(name: str, color: Point, density: float) -> bpy.types.Material:
        material = bpy.data.materials.new(name)
        build, output = _tree(material, "ShaderNodeOutputMaterial")
        build.feed(output.inputs["Surface"], build.node("ShaderNodeBsdfGlass", {"Roughness": 0.0, "IOR": 1.45}).outputs[0])
        inside = build.node("ShaderNodeVolumeAbsorption", {"Color": (*color, 1.0), "Density": density})
        build.feed(output.inputs["Volume"], inside.outputs[0])
        return material

    _plane("Table", 14.0, _surface("Table", (0.55, 0.45, 0.36)))
    green = glass("Green glass", (0.15, 0.7, 0.3), 1.5)
    _post("Bottle", (-0.9, 0.0, 0.01), 0.7, 2.0, green)
    _post("Neck", (-0.9, 0.0, 2.02), 0.25, 0.9, green)
    _ball("Ball", (1.0, -0.3, 0.76), 0.75, glass("Amber glass", (0.9, 0.45, 0.08), 1.2))
    _light("AREA", (-2.5, 3.0, 4.5), 400.0, (0.0, 0.0, 0.8), size=1.0)
    _camera((0.3, -6.5, 2.3), (0.0, 0.0, 1.1), 45.0)


@_usual("ruins", "Ground mist, haze and smoke over each other")
def _ruins(scene: bpy.types.Scene) -> None:
    """A flat cube of noise as ground mist, a big one of thin Volume Scatter and a column of smoke, all overlapping; a low sun."""
    _delete_lamp()
    _panorama((0.5, 0.4, 0.32), (0.1, 0.14, 0.25), 0.5)
    stone = _surface("Stone", (0.3, 0.27, 0.23))
    _plane("Ground", 80.0, _surface("Ground", (0.12, 0.1, 0.07)))
    for i, (x, y) in enumerate(_scattered(14, -9.0, 9.0)):
        _post("Column", (x, y + 4.0, 0.0), 0.45, 1.5 + 3.5 * (0.618 * i % 1.0), stone)
    _box("Mist", (0.0, 4.0, 0.65), (30.0, 26.0, 1.5), _volume("Mist", _smoke(0.5, 0.35, 3.0, 0.4, 0.7, coordinate="Generated")))
    _box("Haze", (0.0, 5.0, 6.0), (44.0, 40.0, 12.5), _volume("Haze", _haze(0.012, 0.5)))
    _box("Smoke", (3.0, 8.0, 4.2), (3.0, 3.0, 8.0), _volume("Smoke", _smoke(1.5, 1.2, 4.0, 0.5, 0.7)))
    _light("SUN", (-20.0, 15.0, 9.0), 6.0, (0.0, 0.0, 0.0), (1.0, 0.75, 0.5), angle=math.radians(0.5))
    _camera((0.0, -12.0, 2.2), (0.0, 4.0, 2.4), 30.0, 1000.0)


@_usual("forest", "Camera inside a box of fog among trees")
def _forest(scene: bpy.types.Scene) -> None:
    """Everything inside one cube of Volume Scatter, the camera too; the sun ahead behind the trees, two bounces."""
    _delete_lamp()
    _panorama((0.6, 0.62, 0.6), (0.25, 0.35, 0.5), 0.6)
    bark, leaves = _surface("Bark", (0.07, 0.05, 0.035)), _surface("Needles", (0.04, 0.09, 0.03))
    _plane("Moss", 100.0, _surface("Moss", (0.08, 0.1, 0.04)))
    _tree_trunks(((x, y) for x, y in _scattered(45, -20.0, 20.0) if abs(x) > 1.2 or y > 8.0), 9.0, bark, leaves)
    _box("Fog", (0.0, 5.0, 7.4), (70.0, 70.0, 15.0), _volume("Fog", _haze(0.025, 0.6)))
    _light("SUN", (6.0, 30.0, 16.0), 8.0, (0.0, 0.0, 0.0), (1.0, 0.85, 0.6), angle=math.radians(0.5))
    _camera((0.0, -17.0, 1.7), (0.5, 6.0, 4.2), 28.0, 1000.0)
    scene.cycles.volume_bounces = 2


@_usual("lake", "Mist drifting over a lake, an animation", (1, 9, 17))
def _lake(scene: bpy.types.Scene) -> None:
    """24 frames of mist whose noise moves (W has keyframes) over still water with rocks and trees; the sky and a sun."""
    _delete_lamp()
    _panorama((0.75, 0.6, 0.5), (0.2, 0.3, 0.5), 0.8)
    _plane("Water", 200.0, _surface("Water", (0.03, 0.05, 0.06), 0.1))
    rock = _surface("Rock", (0.2, 0.19, 0.18))
    bark, leaves = _surface("Bark", (0.07, 0.05, 0.035)), _surface("Needles", (0.05, 0.1, 0.04))
    for i, (x, y) in enumerate(_scattered(24, -14.0, 14.0)):
        _ball("Rock", (x, y + 4.0, 0.0), 0.3 + 0.5 * (0.618 * i % 1.0), rock)
    _box("Shore", (0.0, 30.0, 0.3), (120.0, 16.0, 1.6), _surface("Shore", (0.1, 0.12, 0.05)))
    _tree_trunks(((x * 2.2, 26.0 + 0.2 * y) for x, y in _scattered(24, -14.0, 14.0)), 8.0, bark, leaves)

    def shader(build: Tree) -> bpy.types.Node:
        ramp, noise = _noise(build, 2.5, 3.0, 0.42, 0.68, "Generated", w=True)
        w = next(socket for socket in noise.inputs if socket.identifier == "W")
        for frame, value in ((1, 0.0), (24, 0.4)):
            w.default_value = value
            w.keyframe_insert("default_value", frame=frame)
        return build.node("ShaderNodeVolumePrincipled", {"Density": build.math("MULTIPLY", ramp, 0.12), "Anisotropy": 0.2})

    _box("Mist", (0.0, 8.0, 0.95), (46.0, 34.0, 2.1), _volume("Mist", shader))
    _light("SUN", (-25.0, 20.0, 12.0), 5.0, (0.0, 0.0, 0.0), (1.0, 0.8, 0.6), angle=math.radians(0.5))
    _camera((0.0, -14.0, 2.6), (0.0, 10.0, 1.6), 35.0, 1000.0)
    scene.frame_start, scene.frame_end = 1, 24


@_usual("film-set", "Clouds of noise that the camera does not see")
def _film_set(scene: bpy.types.Scene) -> None:
    """A room with haze and a window; fog banks of other shots, of noise, are left behind the walls and behind the camera."""
    _delete_lamp()
    _sky((0.05, 0.06, 0.09))
    plaster, wood = _surface("Plaster", (0.5, 0.46, 0.4)), _surface("Wood", (0.28, 0.15, 0.08))
    _box("Floor", (0.0, 0.0, -0.1), (7.0, 9.0, 0.2), wood)
    _box("Ceiling", (0.0, 0.0, 3.1), (7.0, 9.0, 0.2), plaster)
    _box("Back", (0.0, 4.4, 1.5), (7.0, 0.2, 3.0), plaster)
    _box("Front", (0.0, -4.4, 1.5), (7.0, 0.2, 3.0), plaster)
    _box("Left", (-3.4, 0.0, 1.5), (0.2, 9.0, 3.0), plaster)
    for z, height in ((0.45, 0.9), (2.75, 0.5)):
        _box("Right", (3.4, 0.0, z), (0.2, 9.0, height), plaster)
    for y, width in ((-2.75, 3.5), (0.5, 0.3), (3.4, 2.2)):
        _box("Right", (3.4, y, 1.7), (0.2, width, 1.7), plaster)
    _box("Table", (-0.6, 1.6, 0.75), (2.0, 1.0, 0.08), wood)
    for x in (-1.5, 0.3):
        _box("Leg", (x, 1.6, 0.36), (0.08, 0.8, 0.72), wood)
    _ball("Vase", (-0.6, 1.6, 1.04), 0.25, _surface("Vase", (0.1, 0.25, 0.5), 0.3))
    _box("Haze", (0.0, 0.0, 1.5), (6.6, 8.6, 2.98), _volume("Haze", _haze(0.08)))
    for center in ((0.0, 9.5, 2.0), (0.0, -11.0, 2.0), (-9.0, 0.0, 2.0)):
        _box("Fog bank", center, (8.0, 6.0, 4.0), _volume("Fog bank", _smoke(1.0, 0.8)))
    _light("SUN", (12.0, -3.0, 8.0), 30.0, (0.0, 1.0, 0.5), (1.0, 0.88, 0.7), angle=math.radians(0.5))
    _light("POINT", (-2.4, 3.4, 2.2), 25.0, color=(1.0, 0.7, 0.4))
    _camera((-0.6, -4.0, 1.6), (0.4, 2.0, 1.4), 22.0)


@_usual("leftovers", "Volumes that were turned down to nothing and left")
def _leftovers(scene: bpy.types.Scene) -> None:
    """A still life under two lamps; three cubes of noise whose density was turned down to 1e-6 or 0 instead of being deleted."""
    _plane("Table", 30.0, _surface("Table", (0.35, 0.3, 0.26)), -0.01)
    red, blue, yellow = (_surface(name, color, 0.4) for name, color in
                         (("Red", (0.6, 0.06, 0.04)), ("Blue", (0.05, 0.15, 0.5)), ("Yellow", (0.7, 0.5, 0.05))))
    _ball("Ball", (-1.4, 0.3, 1.0), 1.0, red)
    _cone("Cone", (1.3, 0.8, 0.0), 0.9, 2.2, yellow)
    _box("Block", (0.4, -1.2, 0.5), (1.0, 1.0, 1.0), blue)
    for density, size in ((1e-6, 9.0), (0.0, 7.0), (1e-6, 5.0)):
        _box("Old fog", (0.0, 0.0, size / 2.0 - 0.5), (size, size, size), _volume("Old fog", _smoke(density, 1.5)))
    _light("AREA", (-4.0, -3.0, 5.0), 300.0, (0.0, 0.0, 0.5), size=2.0)
    _camera((0.5, -8.0, 3.2), (0.0, 0.0, 0.9))


@_usual("rooms", "A house of six hazy rooms with four lamps each")
def _rooms(scene: bpy.types.Scene) -> None:
    """Twenty-four lamps in six rooms; the camera stands in one and sees a second through the door. One cube of haze over all."""
    _delete_lamp()
    _sky((0.02, 0.02, 0.03))
    plaster, wood = _surface("Plaster", (0.5, 0.48, 0.45)), _surface("Wood", (0.3, 0.18, 0.1))
    _box("Floor", (7.5, 5.0, -0.1), (15.4, 10.4, 0.2), wood)
    _box("Ceiling", (7.5, 5.0, 3.1), (15.4, 10.4, 0.2), plaster)
    for x in (0.0, 15.0):
        _box("Wall", (x, 5.0, 1.5), (0.2, 10.2, 3.0), plaster)
    for y in (0.0, 10.0):
        _box("Wall", (7.5, y, 1.5), (15.2, 0.2, 3.0), plaster)
    _box("Wall", (2.5, 5.0, 1.5), (5.0, 0.2, 3.0), plaster)
    _box("Wall", (12.5, 5.0, 1.5), (5.0, 0.2, 3.0), plaster)
    for low, high in ((5.0, 6.6), (8.0, 10.0)):  # the door of the middle room
        _box("Wall", ((low + high) / 2.0, 5.0, 1.5), (high - low, 0.2, 3.0), plaster)
    _box("Door head", (7.3, 5.0, 2.6), (1.4, 0.2, 0.8), plaster)
    for x in (5.0, 10.0):
        _box("Wall", (x, 5.0, 1.5), (0.2, 10.0, 3.0), plaster)
    warm, cold = (1.0, 0.7, 0.42), (0.6, 0.75, 1.0)
    for i in range(3):
        for j in range(2):
            for dx, dy in ((1.0, 1.0), (4.0, 1.0), (1.0, 4.0), (4.0, 4.0)):
                _light("POINT", (5.0 * i + dx, 5.0 * j + dy, 2.5), 14.0, color=cold if j else warm, radius=0.05)
    _box("Chest", (6.0, 3.9, 0.4), (1.0, 0.9, 0.8), wood)
    _ball("Globe", (7.4, 8.4, 1.0), 0.6, _surface("Globe", (0.15, 0.4, 0.45), 0.4))
    _box("Haze", (7.5, 5.0, 1.5), (15.0, 10.0, 2.98), _volume("Haze", _haze(0.08)))
    _camera((8.6, 0.3, 1.7), (7.1, 6.0, 1.4), 22.0)


@_usual("valley", "Fog that thins with height, a sun and a sky")
def _valley(scene: bpy.types.Scene) -> None:
    """A large cube whose density falls with height (Generated -> Separate XYZ -> Color Ramp), hills, a low sun, a panorama."""
    _delete_lamp()
    _panorama((0.8, 0.62, 0.45), (0.15, 0.28, 0.55), 0.9)
    grass = _surface("Grass", (0.1, 0.14, 0.05))
    bark, leaves = _surface("Bark", (0.07, 0.05, 0.035)), _surface("Needles", (0.05, 0.1, 0.04))
    _plane("Grass", 400.0, grass)
    for x, y, radius in ((-40.0, 70.0, 30.0), (35.0, 90.0, 42.0), (0.0, 130.0, 50.0)):
        hill = _ball("Hill", (x, y, -0.45 * radius), radius, grass)
        hill.scale.z = 0.8
    _tree_trunks(((x, y + 8.0) for x, y in _scattered(20, -24.0, 24.0)), 7.0, bark, leaves)

    def shader(build: Tree) -> bpy.types.Node:
        _, _, height = build.components(build.node("ShaderNodeTexCoord").outputs["Generated"])
        ramp = build.node("ShaderNodeValToRGB", {0: height})
        ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (1.0,) * 4, (0.0, 0.0, 0.0, 1.0)
        ramp.color_ramp.elements[1].position = 0.6
        density = build.math("MULTIPLY", ramp.outputs[0], 0.03)
        return build.node("ShaderNodeVolumeScatter", {"Density": density, "Anisotropy": 0.4})

    _box("Fog", (0.0, 60.0, 7.9), (260.0, 200.0, 16.2), _volume("Fog", shader))
    _light("SUN", (-40.0, 50.0, 18.0), 5.0, (0.0, 0.0, 0.0), (1.0, 0.72, 0.45), angle=math.radians(0.5))
    _camera((0.0, -30.0, 6.0), (0.0, 40.0, 5.0), 35.0, 1000.0)


@_usual("campfire", "Fire by blackbody emission, and its smoke")
def _campfire(scene: bpy.types.Scene) -> None:
    """Principled Volume with noise in its density and blackbody light in the lower cube, grey smoke above; night, two bounces."""
    _delete_lamp()
    _sky((0.002, 0.003, 0.006))
    _plane("Ground", 40.0, _surface("Ground", (0.2, 0.16, 0.11)))
    log = _surface("Log", (0.12, 0.07, 0.04))
    for i in range(7):
        angle = 2.0 * math.pi * i / 7.0
        made = _post("Log", (0.55 * math.cos(angle), 0.55 * math.sin(angle), 0.0), 0.1, 1.1, log)
        made.matrix_world = _aimed((0.4 * math.cos(angle), 0.4 * math.sin(angle), 0.35), (0.0, 0.0, 0.9))
        _ball("Stone", (1.2 * math.cos(angle), 1.2 * math.sin(angle), 0.1), 0.25, _surface("Stone", (0.3, 0.3, 0.3)))

    def fire(build: Tree) -> bpy.types.Node:
        ramp, _ = _noise(build, 2.2, 4.0, 0.45, 0.6)
        x, y, z = build.components(build.node("ShaderNodeTexCoord").outputs["Object"])
        far = build.math("SQRT", build.math("ADD", build.math("MULTIPLY", x, x), build.math("MULTIPLY", y, y)))
        out = build.math("ADD", far, build.math("MULTIPLY", z, 0.45))
        flame = build.node("ShaderNodeMapRange", {0: out, 1: 0.0, 2: 0.5, 3: 1.0, 4: 0.0})
        shape = build.math("MULTIPLY", ramp, flame.outputs[0])
        return build.node("ShaderNodeVolumePrincipled", {
            "Color": (0.2, 0.1, 0.05, 1.0), "Density": build.math("MULTIPLY", shape, 3.0),
            "Blackbody Intensity": build.math("MULTIPLY", shape, 2.5), "Temperature": 1400.0})

    _box("Fire", (0.0, 0.0, 1.1), (1.8, 1.8, 2.2), _volume("Fire", fire))
    _box("Smoke", (0.0, 0.0, 3.7), (2.0, 2.0, 3.2), _volume("Smoke", _smoke(0.3, 1.5, 4.0, 0.5, 0.7)))
    _light("POINT", (0.0, 0.0, 1.0), 120.0, color=(1.0, 0.45, 0.15), radius=0.3)
    _camera((0.0, -8.5, 2.4), (0.0, 0.0, 1.7), 40.0)
    scene.cycles.volume_bounces = 2
