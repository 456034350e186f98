# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's own scene, foreign volumes included, read into the planner's terms. Nothing is changed and nothing is evaluated."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..plan import visibility
from ..plan.observed import UNKNOWN, Lamp, Medium, Observed, Range, Solids, Substance, Survey, View
from . import compat, ranges, settings
from . import survey as trace

PATHS = ("cycles.use_adaptive_sampling", "cycles.adaptive_threshold", "cycles.volume_bounces", "cycles.volume_biased",
         "cycles.volume_step_rate", "cycles.volume_max_steps", "cycles.use_light_tree", "cycles.use_guiding", "render.use_persistent_data",
         "eevee.volumetric_tile_size", "eevee.volumetric_samples", "eevee.taa_render_samples")
GEOMETRY = {"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "VOLUME"}
# Modifiers whose result stays where it is as long as nothing of them is animated.
STILL = {"SUBSURF", "BEVEL", "MIRROR", "ARRAY", "SOLIDIFY", "TRIANGULATE", "WEIGHTED_NORMAL", "EDGE_SPLIT", "DECIMATE", "REMESH", "SCREW",
         "WELD", "SKIN", "WIREFRAME", "MULTIRES", "SIMPLE_DEFORM", "DISPLACE", "SMOOTH", "CAST"}
MOST_FACES = 64  # of a mesh that is looked through for walls
MIRRORS = 0.3  # roughness below which a surface shows what it mirrors
ADAPTIVE_SAMPLES = 256  # that a pixel takes on average at most
FEWEST_LAMPS, MOST_LAMPS, MOST_TRACED = 4, 200, 250  # lamps and objects of a scene whose light paths are traced: a ray asks all objects
CONTACT = 1e-6  # of a medium's size, within which its face lies in a surface
RAYLEIGH_G = 0.15  # of the HG lobe with at least the peak and the contrast of molecules


@dataclass(frozen=True)
class _Part:
    """Bounds of a volume shader: extinction with its rate, albedo, |g|, whether it emits, whether anything of it is textured."""

    sigma: Range = Range(0.0, 0.0)
    albedo: float = 0.0
    g: float = 0.0
    emits: bool = False
    textured: bool = False


_UNREAD = _Part(Range(0.0, math.inf, math.inf), 1.0, 0.999, True, True)


def scene(blender_scene: bpy.types.Scene, view_layer: bpy.types.ViewLayer | None = None, *, survey: bool = True,
          samples: int | None = None, pixels: float | None = None) -> Observed:
    """What the planner knows of the scene at its current frame, as one of its view layers renders it.

    With ``survey`` light paths are traced where that is quick, and may find lamps that light nothing in the picture. ``samples`` and
    ``pixels`` are those of the picture that is to be rendered, where they are not the scene's. Raises ValueError for an engine other
    than Cycles and EEVEE.
    """
    layer = view_layer or blender_scene.view_layers[0]
    layer.update()
    engine = compat.engine_of(blender_scene)
    present = {path: settings.get(blender_scene, path) for path in PATHS if _has(blender_scene, path)}
    found = list(_rendered(layer))
    materials: dict[str, tuple] = {}
    media, rest, lamps, instances, copied = [], [], [], False, False
    for candidate in found:
        kind = candidate.type
        if kind == "LIGHT":
            lamps.append(_lamp(candidate))
        elif kind in GEOMETRY:
            volume = _volume_slot(candidate, materials)
            if volume is not None:
                media.append(_medium(candidate, volume, materials[volume.name][1]))
            else:
                rest.append(candidate)
        if candidate.instance_type != "NONE" or candidate.modifiers or candidate.particle_systems:
            instances = instances or _instances_matter(candidate, materials)
            copied = copied or candidate.instance_type != "NONE" or bool(candidate.particle_systems) or any(
                modifier.type == "NODES" for modifier in candidate.modifiers)
    # What is rendered is made of these; where objects are copied, of any material of the file.
    surfaces = [_known(material, materials) for material in bpy.data.materials if material.users] if copied else [
        known for _, known in materials.values()]
    media = _with_shared(media, found)
    if (air := _world(blender_scene)) is not None:
        media.append(air)
    view = _view(blender_scene)
    traced = _survey(blender_scene, layer, view, lamps, media, rest, materials) if survey and not instances else None
    solids, faces, room = _surroundings(rest, media, view, materials) if media else (None, (), ())
    world, sky = blender_scene.world, _environment(blender_scene)
    if pixels is None:
        pixels = _pixels(blender_scene)
    expected = ADAPTIVE_SAMPLES if blender_scene.cycles.use_adaptive_sampling else math.inf
    if samples is None:
        samples = blender_scene.cycles.samples
    probe = _probe(world, sky)
    own_map = world is not None and world.library is None and world.cycles.sampling_method == "AUTOMATIC"
    return Observed(
        engine, present, view, tuple(media), tuple(lamps), solids, sky.high, sky.rate,
        world is not None and world.cycles.sampling_method != "NONE", world.name if own_map else "", probe,
        probe is not None and world.use_sun_shadow and blender_scene.eevee.use_shadows, traced, faces, room,
        frames=max(1, (blender_scene.frame_end - blender_scene.frame_start) // max(blender_scene.frame_step, 1) + 1),
        has_emitters=any(_emits(candidate, materials) for candidate in rest), has_surfaces=bool(rest), has_instances=instances,
        mirrors=any(known[4] for known in surfaces), touches=_touches(rest, media),
        pixels=pixels, viewport=_viewport(), samples=samples, paths=pixels * min(samples, expected),
        dithers=_dithers(blender_scene, surfaces),
        unused_passes=tuple(_unused_passes(blender_scene)), null_scattering=compat.current().volume_biased)


def _pixels(blender_scene: bpy.types.Scene) -> float:
    render = blender_scene.render
    return render.resolution_x * render.resolution_y * (render.resolution_percentage / 100.0) ** 2


def _probe(world: bpy.types.World | None, sky: Range) -> tuple[str, int] | None:
    """Not where EEVEE finds a sun in the map: it takes what is brighter than a threshold for one."""
    if world is None or world.library is not None or 0.0 < world.sun_threshold <= sky.high:
        return None
    return world.name, int(world.probe_resolution)


def _viewport() -> float:
    """Pixels of the largest 3D viewport that EEVEE may draw in; none without windows."""
    windows = () if bpy.app.background else bpy.context.window_manager.windows
    return float(max((region.width * region.height for window in windows for area in window.screen.areas if area.type == "VIEW_3D"
                      and area.spaces.active.shading.type in ("RENDERED", "MATERIAL")
                      for region in area.regions if region.type == "WINDOW"), default=0))


def _has(blender_scene: bpy.types.Scene, path: str) -> bool:
    try:
        settings.get(blender_scene, path)
    except AttributeError:
        return False
    return True


def _rendered(layer: bpy.types.ViewLayer) -> Iterator[bpy.types.Object]:
    """Every object that the layer renders, once."""
    seen: set[int] = set()
    waiting = [layer.layer_collection]
    while waiting:
        current = waiting.pop()
        if current.exclude or current.collection.hide_render:
            continue
        waiting += current.children
        for candidate in current.collection.objects:
            key = candidate.as_pointer()
            if key not in seen:
                seen.add(key)
                if not candidate.hide_render:
                    yield candidate


# --- what moves --------------------------------------------------------------------------------------------------


def moves(candidate: bpy.types.Object) -> bool:
    """Whether the object may be elsewhere, or of another shape, in another frame."""
    data = candidate.data
    if ranges.is_animated(candidate) or data is not None and ranges.is_animated(data):
        return True
    if getattr(data, "shape_keys", None) or candidate.rigid_body is not None or candidate.constraints:
        return True
    if any(modifier.type not in STILL for modifier in candidate.modifiers):
        return True
    return candidate.parent is not None and moves(candidate.parent)


def _instances_matter(candidate: bpy.types.Object, materials: dict) -> bool:
    """Whether the object makes copies of lights or media, which are not listed."""
    sources: list[bpy.types.Object] = []
    if candidate.instance_type == "COLLECTION" and candidate.instance_collection is not None:
        sources += candidate.instance_collection.all_objects
    elif candidate.instance_type != "NONE":
        sources += candidate.children
    for system in candidate.particle_systems:
        sources += filter(None, [system.settings.instance_object])
        if system.settings.instance_collection is not None:
            sources += system.settings.instance_collection.all_objects
    for modifier in candidate.modifiers:
        if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN":
            continue  # its medium is the object's own
        if modifier.type == "NODES" and modifier.node_group is not None:
            if any("Volume" in node.bl_idname for node in modifier.node_group.nodes):
                return True
            held = [value for key in modifier.keys() if isinstance(value := modifier[key], (bpy.types.Object, bpy.types.Collection))]
            held += [socket.default_value for node in modifier.node_group.nodes for socket in node.inputs
                     if socket.type in ("OBJECT", "COLLECTION") and socket.default_value is not None]
            for value in held:
                sources += [value] if isinstance(value, bpy.types.Object) else value.all_objects
    return any(source.type == "LIGHT" or source.type in GEOMETRY and _volume_slot(source, materials) is not None for source in sources)


# --- materials ---------------------------------------------------------------------------------------------------


def _tree(block: bpy.types.ID) -> bpy.types.NodeTree | None:
    """The nodes of a material, world or lamp, where it uses them."""
    return None if compat.current().use_nodes and not block.use_nodes else block.node_tree


def _output(tree: bpy.types.NodeTree, kind: str, engine_target: str = "CYCLES") -> bpy.types.Node | None:
    outputs = [node for node in tree.nodes if node.bl_idname == kind and not node.mute]
    exact = [node for node in outputs if getattr(node, "target", "ALL") == engine_target]
    return next((node for node in exact or outputs if node.is_active_output), (exact or outputs or [None])[0])


def _described(material: bpy.types.Material) -> tuple:
    """(output node or None, whether it has a volume, a surface, whether that is opaque, mirrors, emits)."""
    tree = _tree(material)
    if tree is None:
        return None, False, True, True, False, False
    output = _output(tree, "ShaderNodeOutputMaterial")
    if output is None:
        return None, False, False, False, False, False
    has_volume = output.inputs["Volume"].is_linked
    surface = output.inputs["Surface"]
    if not surface.is_linked:
        return output, has_volume, False, False, False, False
    kinds = _shaders(surface)
    opaque = not has_volume and all(_is_opaque(node) for node in kinds)
    return output, has_volume, True, opaque, any(map(_mirrors, kinds)), any(map(_shines, kinds))


def _shaders(socket: bpy.types.NodeSocket, stack: tuple = ()) -> list[bpy.types.Node]:
    """The shader nodes that are mixed and added into a socket."""
    found, stack = ranges.source(socket, stack)
    if found is None or not found.is_output:
        return []
    node = found.node
    if node.bl_idname in ("ShaderNodeMixShader", "ShaderNodeAddShader"):
        return [shader for inner in node.inputs if inner.type == "SHADER" for shader in _shaders(inner, stack)]
    return [node]


def _plain(node: bpy.types.Node, name: str) -> float | None:
    """The value of an input that nothing feeds; None where something does or there is none."""
    socket = node.inputs.get(name)
    return None if socket is None or socket.is_linked else socket.default_value


def _is_opaque(node: bpy.types.Node) -> bool:
    match node.bl_idname:
        case "ShaderNodeBsdfPrincipled":
            return _plain(node, "Alpha") == 1.0 and _plain(node, "Transmission Weight") == 0.0
        case "ShaderNodeBsdfDiffuse" | "ShaderNodeEmission" | "ShaderNodeBsdfGlossy" | "ShaderNodeBsdfAnisotropic":
            return True
    return False


def _mirrors(node: bpy.types.Node) -> bool:
    match node.bl_idname:
        case "ShaderNodeBsdfPrincipled":
            rough = _plain(node, "Roughness")
            coat = node.inputs.get("Coat Weight")
            return (rough is None or rough < MIRRORS or _plain(node, "Transmission Weight") != 0.0 or _plain(node, "Metallic") != 0.0
                    or _plain(node, "Alpha") != 1.0 or (coat is not None and (coat.is_linked or coat.default_value > 0.0)))
        case "ShaderNodeBsdfDiffuse" | "ShaderNodeEmission" | "ShaderNodeBsdfTranslucent":
            return False
    return True


def _shines(node: bpy.types.Node) -> bool:
    if node.bl_idname == "ShaderNodeEmission":
        return _plain(node, "Strength") != 0.0
    strength = node.inputs.get("Emission Strength")
    return strength is not None and (strength.is_linked or strength.default_value != 0.0)


def _known(material: bpy.types.Material, materials: dict) -> tuple:
    if material.name not in materials:
        materials[material.name] = (material, _described(material))
    return materials[material.name][1]


def _volume_slot(candidate: bpy.types.Object, materials: dict) -> bpy.types.Material | None:
    """The material of the object that has a volume; Cycles takes the first, and the object is read as a medium of it. All of its
    materials are known then."""
    found = None
    for slot in candidate.material_slots:
        material = slot.material
        if material is not None and _known(material, materials)[1] and found is None:
            found = material
    return found


def _emits(candidate: bpy.types.Object, materials: dict) -> bool:
    return any(slot.material is not None and _known(slot.material, materials)[5] for slot in candidate.material_slots)


def _volume(socket: bpy.types.NodeSocket, reader: ranges.Reader, stack: tuple = (), grids: bool = False) -> _Part:
    """Bounds of the volume shader that feeds a socket. ``grids``: the object has voxels of its own."""
    found, stack = ranges.source(socket, stack)
    if found is None or not found.is_output:
        return _Part()
    node = found.node
    read = lambda name: reader.of(node.inputs[name], stack)  # noqa: E731
    positive = lambda value: ranges.most(value, Range(0.0, 0.0))  # noqa: E731
    one = Range(1.0, 1.0)
    match node.bl_idname:
        case "ShaderNodeAddShader":
            a, b = (_volume(inner, reader, stack, grids) for inner in node.inputs)
            return _together(a, b)
        case "ShaderNodeMixShader":
            factor = ranges.clamped(reader.of(node.inputs[0], stack))
            a, b = (_volume(inner, reader, stack, grids) for inner in node.inputs[1:3])
            a = _weighted(a, ranges.minus(one, factor))
            return _together(a, _weighted(b, factor))
        case "ShaderNodeVolumeAbsorption":
            sigma = ranges.times(positive(read("Density")), positive(ranges.minus(one, read("Color"))))
            return _Part(sigma, 0.0, 0.0, False, sigma.rate > 0.0)
        case "ShaderNodeVolumeScatter":
            color = read("Color")
            sigma = ranges.times(positive(read("Density")), positive(color))
            g = _lobe(node, read)
            return _Part(sigma, 1.0, g.high, False, sigma.rate > 0.0 or g.rate > 0.0)
        case "ShaderNodeVolumePrincipled":
            return _principled(node, read, grids)
        case "ShaderNodeVolumeCoefficients":
            absorbed, scattered = positive(read("Absorption Coefficients")), positive(read("Scatter Coefficients"))
            g, emission = _lobe(node, read), read("Emission Coefficients")
            sigma = ranges.plus(absorbed, scattered)
            albedo = scattered.high / max(scattered.high + absorbed.low, 1e-300) if math.isfinite(scattered.high) else 1.0
            return _Part(sigma, albedo, g.high, emission.high > 0.0, max(sigma.rate, g.rate, emission.rate) > 0.0)
        case "ShaderNodeEmission":
            strength = read("Strength")
            return _Part(emits=strength.high > 0.0, textured=max(strength.rate, read("Color").rate) > 0.0)
    return _UNREAD


def _lobe(node: bpy.types.Node, read: callable) -> Range:
    """|g| of a node's phase function."""
    phase = getattr(node, "phase", "HENYEY_GREENSTEIN")
    if phase == "RAYLEIGH":
        return Range(RAYLEIGH_G, RAYLEIGH_G)
    if phase != "HENYEY_GREENSTEIN":
        return Range(0.999, 0.999)
    g = read("Anisotropy")
    return Range(0.0, min(0.999, max(abs(g.low), abs(g.high))), g.rate)


def _principled(node: bpy.types.Node, read: callable, grids: bool) -> _Part:
    one, zero = Range(1.0, 1.0), Range(0.0, 0.0)
    density, color = ranges.most(read("Density"), zero), ranges.most(read("Color"), zero)
    dark = ranges.minus(one, ranges.root(ranges.clamped(read("Absorption Color"))))
    absorbed = ranges.times(ranges.most(ranges.minus(one, color), zero), ranges.most(dark, zero))
    # Per channel; extremes of different channels do not meet, so this is a bound.
    sigma = ranges.times(density, ranges.plus(color, absorbed))
    # The brightest channel has the largest albedo: c / (c + (1 - c) (1 - sqrt A)) grows with both.
    bright = min(color.high, 1.0)
    albedo = bright / max(bright + (1.0 - bright) * max(dark.low, 0.0), 1e-300)
    g, strength, glow = read("Anisotropy"), read("Emission Strength"), read("Blackbody Intensity")
    textured = max(sigma.rate, g.rate, strength.rate, glow.rate, color.rate) > 0.0
    if grids:
        sigma, textured = Range(0.0, math.inf if sigma.high > 0.0 else 0.0, math.inf), True
    return _Part(sigma, albedo, min(0.999, max(abs(g.low), abs(g.high))), max(strength.high, glow.high) > 0.0, textured)


def _together(a: _Part, b: _Part) -> _Part:
    return _Part(ranges.plus(a.sigma, b.sigma), max(a.albedo, b.albedo), max(a.g, b.g), a.emits or b.emits, a.textured or b.textured)


def _weighted(a: _Part, factor: Range) -> _Part:
    if factor.high == 0.0:
        return _Part()
    return _Part(ranges.times(a.sigma, factor), a.albedo, a.g, a.emits, a.textured or factor.rate > 0.0)


def _substance(part: _Part) -> Substance:
    sigma = part.sigma
    feature = sigma.high / sigma.rate if 0.0 < sigma.rate < math.inf and math.isfinite(sigma.high) else 0.0
    return Substance(Range(max(sigma.low, 0.0), max(sigma.high, 0.0)), part.albedo, part.g, part.emits, part.textured, feature)


# --- objects -----------------------------------------------------------------------------------------------------


def _corners(candidate: bpy.types.Object) -> tuple:
    frame = candidate.matrix_world
    return tuple(tuple(frame @ Vector(corner)) for corner in candidate.bound_box)


def _medium(candidate: bpy.types.Object, material: bpy.types.Material, described: tuple) -> Medium:
    corners = _corners(candidate)
    low, high = visibility.bounds(corners)
    size = [h - l for l, h in zip(low, high)]
    smoke = any(modifier.type == "FLUID" for modifier in candidate.modifiers)
    grids = candidate.type == "VOLUME" or smoke
    own = [part for corner in candidate.bound_box for part in corner]
    reader = ranges.Reader(size, tuple(candidate.matrix_world.to_scale()), Range(min(own), max(own)), Range(min(low), max(high)))
    part = _volume(described[0].inputs["Volume"], reader, grids=grids)
    # A modifier may fill the mesh with voxels.
    step = 0.0 if grids or any(modifier.type == "NODES" for modifier in candidate.modifiers) else 0.1 * sum(size) / 3.0
    return Medium(candidate.name, material.name, _substance(part), corners, moves(candidate), described[2], grids,
                  material.cycles.volume_sampling, material.cycles.volume_step_rate, step,
                  editable=candidate.library is None and material.library is None and candidate.override_library is None
                  and candidate.instance_type == "NONE" and not candidate.particle_systems)


def _with_shared(media: list[Medium], found: list[bpy.types.Object]) -> list[Medium]:
    """Each medium told whether its material is also in the slots of objects that are not rendered here."""
    users: dict[str, int] = {}
    for medium in media:
        users[medium.material] = users.get(medium.material, 0) + 1
    return [replace(medium, shared=bpy.data.materials[medium.material].users > users[medium.material]) for medium in media]


def _lamp(candidate: bpy.types.Object) -> Lamp:
    data, frame = candidate.data, candidate.matrix_world
    strength = data.energy * 2.0**data.exposure
    color = max(data.color) * (max(data.temperature_color) if data.use_temperature else 1.0)
    if data.type == "AREA":
        across = data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size
        radius = 0.5 * math.hypot(data.size, across) * max(frame.to_scale())
    else:
        radius = 0.5 * data.angle if data.type == "SUN" else data.shadow_soft_size
    power = abs(strength) * color
    tree = _tree(data)
    if tree is not None and tree.nodes and not _plain_emission(tree):
        power = math.inf
    if not getattr(data, "normalize", True):
        power = math.inf  # times the size of what shines, by another rule for each kind
    linking = candidate.light_linking
    return Lamp(candidate.name, data.type, power, tuple(frame.translation),
                tuple((frame.to_3x3() @ Vector((0.0, 0.0, -1.0))).normalized()), radius,
                data.spot_size if data.type == "SPOT" else 0.0, moves(candidate),
                linking.receiver_collection is not None, candidate.library is None and data.library is None, data.volume_factor,
                data.cycles.use_multiple_importance_sampling)


def _plain_emission(tree: bpy.types.NodeTree) -> bool:
    """Whether the nodes of a lamp leave its strength and colour as they are."""
    output = _output(tree, "ShaderNodeOutputLight")
    shaders = _shaders(output.inputs[0]) if output else []
    return bool(shaders) and all(node.bl_idname == "ShaderNodeEmission" and _plain(node, "Strength") == 1.0 and not node.inputs["Color"].is_linked
                                 and tuple(node.inputs["Color"].default_value[:3]) == (1.0, 1.0, 1.0) for node in shaders)


def _world(blender_scene: bpy.types.Scene) -> Medium | None:
    world = blender_scene.world
    if world is None or _tree(world) is None:
        return None
    output = _output(world.node_tree, "ShaderNodeOutputWorld")
    if output is None or not output.inputs["Volume"].is_linked:
        return None
    part = _volume(output.inputs["Volume"], ranges.Reader())
    return Medium(world.name, world.name, _substance(part), (), False, False, False, world.cycles.volume_sampling,
                  editable=world.library is None)


def _environment(blender_scene: bpy.types.Scene) -> Range:
    """Bounds of the world's radiance, and of its change over a radian: coordinates of a world are directions."""
    world = blender_scene.world
    if world is None:
        return Range(0.0, 0.0)
    if _tree(world) is None:
        return Range(0.0, max(world.color))
    output = _output(world.node_tree, "ShaderNodeOutputWorld")
    if output is None or not output.inputs["Surface"].is_linked:
        return Range(0.0, 0.0)
    reader, result = ranges.Reader(local=Range(-1.0, 1.0), world=Range(-1.0, 1.0)), Range(0.0, 0.0)
    for node in _shaders(output.inputs["Surface"]):
        if node.bl_idname != "ShaderNodeBackground":
            return UNKNOWN
        radiance = ranges.times(reader.of(node.inputs["Strength"]), reader.of(node.inputs["Color"]))
        result = ranges.plus(result, ranges.most(radiance, Range(0.0, 0.0)))
    return result


def _view(blender_scene: bpy.types.Scene) -> View | None:
    """The camera where it is a perspective one; a lens that spreads wide or moves the eye is not described."""
    camera = blender_scene.camera
    if camera is None or camera.type != "CAMERA" or camera.data.type != "PERSP" or blender_scene.render.use_multiview:
        return None
    data = camera.data
    frame = Matrix.LocRotScale(camera.matrix_world.translation, camera.matrix_world.to_quaternion(), None)
    # Corners of the picture at depth 1, with shift and the aspect of the picture.
    points = [tuple(corner / -corner.z) for corner in map(Vector, data.view_frame(scene=blender_scene))]
    low = (min(p[0] for p in points), min(p[1] for p in points))
    high = (max(p[0] for p in points), max(p[1] for p in points))
    if data.dof.use_dof:  # what is out of focus spreads beyond its outline: taken as seen in a frame twice as wide
        low, high = tuple(2.0 * l - h for l, h in zip(low, high)), tuple(2.0 * h - l for l, h in zip(low, high))
    axes = frame.to_3x3()
    markers = any(marker.camera is not None for marker in blender_scene.timeline_markers)
    return View(tuple(frame.translation), tuple(axes.col[0]), tuple(axes.col[1]), tuple(axes.col[2]), low, high, data.clip_end,
                moves(camera) or markers)


def _surroundings(rest: list[bpy.types.Object], media: list[Medium], view: View | None,
                  materials: dict) -> tuple[Solids | None, tuple, tuple]:
    """Solids where a medium may be out of the picture, opaque faces that may fill it, and the room around the camera."""
    if view is None:
        return None, (), ()
    faces, room = [], ()
    side = min(h - l for l, h in zip(view.low, view.high))  # of the picture, the shorter one
    reach = 0.5 * side / (1.0 + side)  # of an object's size, to fill the picture: by half, as its origin may be at an end
    for candidate in rest:
        if candidate.type != "MESH" or len(candidate.data.polygons) > MOST_FACES or not candidate.visible_camera:
            continue
        away = math.dist(candidate.matrix_world.translation, view.position)
        if max(candidate.dimensions) < reach * away:  # cannot fill the picture, nor be around the camera
            continue
        slots = candidate.material_slots
        if not candidate.data.polygons or candidate.modifiers or moves(candidate) or any(
                slot.material is not None and not _known(slot.material, materials)[3] for slot in slots):
            continue
        frame, points = candidate.matrix_world, candidate.data.vertices
        outlines = [tuple(tuple(frame @ points[index].co) for index in polygon.vertices) for polygon in candidate.data.polygons]
        faces += [face for face in outlines if math.isfinite(visibility.filled_depth(view, face))]
        if not room and _holds(candidate.data, outlines, view.position):
            room = _corners(candidate)
    depth = min((visibility.filled_depth(view, face) for face in faces), default=math.inf)
    out = any(medium.corners and (not visibility.in_frame(view, medium.corners, depth)
                                  or room and visibility.apart(medium.corners, room)) for medium in media)
    if not out:
        return None, (), ()
    return _solids(rest, view, depth, room, materials), tuple(faces), room


def _touches(rest: list[bpy.types.Object], media: list[Medium]) -> bool:
    """Whether a face of a medium's box lies in a face of another's or of an object's box, and some of the boxes is in both."""
    boxed = np.array([medium.corners for medium in media if medium.corners])
    if not boxed.size:
        return False
    corners = np.concatenate([boxed, _boxes(rest)]) if rest else boxed
    lows, highs = corners.min(axis=1), corners.max(axis=1)
    for index, (low, high) in enumerate(zip(lows[:len(boxed)], highs)):
        slack = CONTACT * math.dist(low, high)
        meets = ((lows <= high + slack) & (highs >= low - slack)).all(axis=1)
        meets[index] = False  # itself
        if any((np.abs(sides[meets] - face) <= slack).any() for sides in (lows, highs) for face in (low, high)):
            return True
    return False


def _boxes(found: list[bpy.types.Object]) -> np.ndarray:
    """(n, 8, 3): the corners of the objects' bounding boxes in the world."""
    boxes = np.empty((len(bpy.data.objects), 8, 3), np.float32)
    frames = np.empty((len(bpy.data.objects), 4, 4), np.float32)  # column-major
    bpy.data.objects.foreach_get("bound_box", boxes.ravel())
    bpy.data.objects.foreach_get("matrix_world", frames.ravel())
    places = {candidate.as_pointer(): index for index, candidate in enumerate(bpy.data.objects)}
    rows = [places[candidate.as_pointer()] for candidate in found]
    return np.einsum("nck,nkr->ncr", boxes[rows], frames[rows, :3, :3]) + frames[rows, None, 3, :3]


def _solids(rest: list[bpy.types.Object], view: View, depth: float, room: tuple, materials: dict) -> Solids:
    """What of the objects is in the picture, by the same planes as ``visibility.in_frame``, for all of them at once."""
    corners = _boxes(rest)
    x, y, z = ((corners - np.array(view.position)) @ np.array((view.right, view.up, view.back)).T).transpose(2, 0, 1)
    far = min(depth, view.clip_end)
    sides = (x + view.high[0] * z, y + view.high[1] * z, -x - view.low[0] * z, -y - view.low[1] * z, z, -z - far)
    seen = ~np.logical_or.reduce([(side > 0.0).all(axis=1) for side in sides])
    if room:
        low, high = visibility.bounds(room)
        seen &= ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
    if not seen.any():
        return Solids((), any(map(moves, rest)))
    shown = corners[seen]
    return Solids(visibility.corners(tuple(map(float, shown.min(axis=(0, 1)))), tuple(map(float, shown.max(axis=(0, 1))))),
                  any(map(moves, rest)), any(_reflects(rest[index], materials) for index in np.flatnonzero(seen)))


def _survey(blender_scene: bpy.types.Scene, layer: bpy.types.ViewLayer, view: View | None, lamps: list[Lamp], media: list[Medium],
            rest: list[bpy.types.Object], materials: dict) -> Survey | None:
    # Media worth leaving out: those whose texture costs before each picture.
    spare = {medium.name for medium in media if medium.substance.textured and medium.corners and medium.editable and not (
        medium.moves or medium.has_surface or medium.substance.emits)} if len(media) > 1 else set()
    if view is None or view.moves or not (FEWEST_LAMPS <= len(lamps) <= MOST_LAMPS or spare) or len(rest) > MOST_TRACED:
        return None
    if any(lamp.moves or not math.isfinite(lamp.power) for lamp in lamps) or any(map(moves, rest)):
        return None
    # A ray meets what the viewport shows; a face counts as opaque where all of its object lets no light through.
    opaque = {candidate.name for candidate in rest if candidate.visible_shadow and candidate.visible_get(view_layer=layer) and all(
        slot.material is None or _known(slot.material, materials)[3] for slot in candidate.material_slots)}
    mirrors = any(_reflects(candidate, materials) for candidate in rest)
    points = [corner for candidate in rest for corner in _corners(candidate)]
    points += [corner for medium in media for corner in medium.corners] + [lamp.position for lamp in lamps] + [view.position]
    found = trace.survey(blender_scene, layer, view, lamps, media, opaque, mirrors, 2.0 * visibility.diagonal(points), spare=spare)
    return found if len(lamps) >= FEWEST_LAMPS else replace(found, lamps={})


def _reflects(candidate: bpy.types.Object, materials: dict) -> bool:
    return any(slot.material is not None and _known(slot.material, materials)[4] for slot in candidate.material_slots)


def _dithers(blender_scene: bpy.types.Scene, surfaces: list[tuple]) -> bool:
    """Whether EEVEE takes samples for blur, traced rays, or surfaces that let light through."""
    camera = blender_scene.camera
    blurs = blender_scene.render.use_motion_blur or blender_scene.eevee.use_raytracing or (
        camera is not None and camera.type == "CAMERA" and camera.data.dof.use_dof)
    return blurs or any(known[2] and not known[3] for known in surfaces)


def _holds(mesh: bpy.types.Mesh, outlines: list, eye: tuple) -> bool:
    """Whether the mesh is closed and convex, and the eye inside."""
    if len(outlines) < 4:
        return False
    count: dict[tuple, int] = {}
    for polygon in mesh.polygons:
        for key in polygon.edge_keys:
            count[key] = count.get(key, 0) + 1
    if any(times != 2 for times in count.values()):
        return False
    vertices = [point for outline in outlines for point in outline]
    middle = tuple(sum(column) / len(vertices) for column in zip(*vertices))
    size = visibility.diagonal(vertices)
    for outline in outlines:
        normal = visibility.cross(visibility.subtract(outline[1], outline[0]), visibility.subtract(outline[2], outline[0]))
        side = lambda point: visibility.dot(visibility.subtract(point, outline[0]), normal)  # noqa: E731
        inward = side(middle)
        slack = 1e-6 * size * math.hypot(*normal)
        if inward == 0.0 or side(eye) * inward <= 0.0 or any(side(p) * math.copysign(1.0, inward) < -slack for p in vertices):
            return False
    return True


# --- passes ------------------------------------------------------------------------------------------------------


def _unused_passes(blender_scene: bpy.types.Scene) -> Iterator[tuple[str, str]]:
    """Passes that are rendered, where the file holds the picture alone and no compositor reads them."""
    image = blender_scene.render.image_settings
    if image.file_format == "OPEN_EXR_MULTILAYER" or blender_scene.render.use_compositing and \
            compat.present_compositing_tree(blender_scene) is not None:
        return
    if blender_scene.render.use_freestyle:
        return
    for layer in blender_scene.view_layers:
        for path in _PASSES:
            owner = layer
            *parents, name = path.split(".")
            for parent in parents:
                owner = getattr(owner, parent, None)
            if owner is not None and getattr(owner, name, False):
                yield layer.name, path


_PASSES = (
    *(f"use_pass_{name}" for name in (
        "z", "mist", "position", "normal", "vector", "uv", "object_index", "material_index", "shadow", "ambient_occlusion", "emit",
        "environment", "diffuse_direct", "diffuse_indirect", "diffuse_color", "glossy_direct", "glossy_indirect", "glossy_color",
        "transmission_direct", "transmission_indirect", "transmission_color", "subsurface_direct", "subsurface_indirect",
        "subsurface_color", "cryptomatte_object", "cryptomatte_material", "cryptomatte_asset")),
    "cycles.use_pass_volume_direct", "cycles.use_pass_volume_indirect", "cycles.denoising_store_passes",
    "cycles.pass_debug_sample_count")
