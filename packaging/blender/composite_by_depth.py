"""Blender script: draws objects of Blender into an image of Surfel, each hiding what lies behind it.

Surfel's EXR has a plane of depth. This script renders Blender's scene from the same camera, and composites both images
pixel by pixel by depth. It runs in Blender, or in Python with the package `bpy`:

    surfel scan.ply --size 960x540 -o scan.exr
    blender -b scene.blend -P composite_by_depth.py -- scan.exr composite.png
    python composite_by_depth.py scan.exr composite.png

Without a .blend file, a cone and a ring stand in the scene as an example. The camera is read from the text
`surfel:camera` of the EXR.
"""

import json
import math
import os
import struct
import sys

import bpy
import mathutils


def text_of(path, name):
    """Returns a text attribute of an EXR file's header."""
    with open(path, "rb") as file:
        data = file.read(1 << 20)
    at = data.find(name.encode() + b"\0string\0")
    if at < 0:
        raise SystemExit(f"error: {path}: has no text '{name}', expected an EXR image of surfel")
    at += len(name) + len("string") + 2
    (size,) = struct.unpack_from("<i", data, at)
    return data[at + 4 : at + 4 + size].decode()


def place_camera(scene, camera):
    """Gives the scene a camera that sees what Surfel's camera sees."""
    width, height = camera["size"]
    data = bpy.data.cameras.new("surfel")
    data.sensor_fit = "VERTICAL"
    projection = camera["projection"]
    if "perspective" in projection:
        data.angle_y = math.radians(projection["perspective"]["fov_y_deg"])
    elif "orthographic" in projection:
        data.type = "ORTHO"
        # Blender measures the longer side.
        data.ortho_scale = projection["orthographic"]["height"] * max(1.0, width / height)
    else:
        raise SystemExit(f"error: projection {sorted(projection)} isn't supported, expected perspective or orthographic")
    view = mathutils.Vector(camera["target"]) - mathutils.Vector(camera["eye"])
    # Blender's camera looks along -z, with y up.
    back = -view.normalized()
    right = mathutils.Vector(camera["up"]).cross(back).normalized()
    up = back.cross(right)
    rotation = mathutils.Matrix((right, up, back)).transposed().to_4x4()
    data.clip_start, data.clip_end = view.length * 1e-3, view.length * 1e3
    placed = bpy.data.objects.new("surfel", data)
    placed.matrix_world = mathutils.Matrix.Translation(camera["eye"]) @ rotation
    scene.collection.objects.link(placed)
    scene.camera = placed
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100


def example_objects(camera):
    """Adds a ring around the view's target, a cone beside it, and a light."""
    for other in list(bpy.data.objects):
        bpy.data.objects.remove(other)
    eye, target = mathutils.Vector(camera["eye"]), mathutils.Vector(camera["target"])
    size = (eye - target).length
    up = mathutils.Vector(camera["up"]).normalized()
    turn = up.to_track_quat("Z", "Y").to_euler()
    bpy.ops.mesh.primitive_torus_add(location=target, rotation=turn, major_radius=0.24 * size, minor_radius=0.02 * size,
                                     major_segments=96)
    side = (target - eye).cross(up).normalized()
    bpy.ops.mesh.primitive_cone_add(location=target + 0.3 * size * side, rotation=turn, radius1=0.08 * size,
                                    depth=0.3 * size)
    bpy.ops.object.light_add(type="SUN", rotation=(eye - target).to_track_quat("Z", "Y").to_euler())
    bpy.context.object.data.energy = 3.0


def compositor(scene):
    """Returns nodes and links of an empty compositor, and the input of its result."""
    if hasattr(scene, "compositing_node_group"):  # Blender 5
        tree = bpy.data.node_groups.new("Composite by depth", "CompositorNodeTree")
        tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        scene.compositing_node_group = tree
        return tree.nodes, tree.links, tree.nodes.new("NodeGroupOutput").inputs[0]
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    return tree.nodes, tree.links, tree.nodes.new("CompositorNodeComposite").inputs[0]


def composite(scene, exr, output):
    """Connects both images: the nearer pixel wins, and Surfel's edges blend by their alpha."""
    scene.view_layers[0].use_pass_z = True
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    nodes, links, result = compositor(scene)
    blender = nodes.new("CompositorNodeRLayers")
    surfel = nodes.new("CompositorNodeImage")
    surfel.image = bpy.data.images.load(exr)
    planes = {output.name: output for output in surfel.outputs}
    if "Depth" not in planes:
        raise SystemExit(f"error: {exr}: has the planes {sorted(planes)}, expected Depth among them")
    # Depth lies along the view in both images, and is very large where nothing is.
    merge = nodes.new("CompositorNodeZcombine")
    if "Use Alpha" in merge.inputs:
        merge.inputs["Use Alpha"].default_value = True
    else:
        merge.use_alpha = True
    links.new(planes.get("Combined", surfel.outputs[0]), merge.inputs[0])
    links.new(planes["Depth"], merge.inputs[1])
    links.new(blender.outputs["Image"], merge.inputs[2])
    links.new(blender.outputs["Depth"], merge.inputs[3])
    links.new(merge.outputs[0], result)
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.filepath = output


def main():
    words = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    if len(words) != 2:
        raise SystemExit("usage: composite_by_depth.py IMAGE.exr OUTPUT.png")
    # Blender resolves relative paths against the folder of the .blend file.
    exr, output = map(os.path.abspath, words)
    camera = json.loads(text_of(exr, "surfel:camera"))
    scene = bpy.context.scene
    if not bpy.data.filepath:
        example_objects(camera)
        scene.render.engine = "CYCLES"
        scene.cycles.samples = 16
        scene.cycles.device = "CPU"
    place_camera(scene, camera)
    composite(scene, exr, output)
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()
