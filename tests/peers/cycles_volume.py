"""Pictures of a volume by Blender's Cycles. Run by an interpreter that has `bpy`; knows nothing of
weft.

`python cycles_volume.py job.json`: volume (.vdb), camera, target, fov, light of radiance 1 from all
around, albedo, resolution, samples, runs, march, out (folder). Writes run_<n>.exr, and
seconds.json: CPU seconds of the first picture and of each run. One thread, no roulette by a light
threshold, no denoising, box filter. march: Cycles' ray marching in place of its null scattering.
"""

import json
import sys
import time

import bpy
from mathutils import Matrix, Vector


def main(path):
    with open(path) as file:
        job = json.load(file)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    add_volume(scene, job)
    add_camera(scene, job)
    add_light(scene)
    set_up_cycles(scene, job)
    seconds = []
    for run in range(job["runs"] + 1):  # the first one loads
        scene.cycles.seed = run
        scene.render.filepath = f"{job['out']}/run_{run}.exr"
        started = time.process_time()
        bpy.ops.render.render(write_still=True)
        seconds.append(time.process_time() - started)
    with open(f"{job['out']}/seconds.json", "w") as file:
        json.dump(seconds, file)


def add_volume(scene, job):
    volume = bpy.data.volumes.new("volume")
    volume.filepath = job["volume"]
    scene.collection.objects.link(bpy.data.objects.new("volume", volume))
    material = bpy.data.materials.new("fibers")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    # extinction is the grid's value: albedo of it scattered, the rest absorbed
    links = material.node_tree.links
    density = nodes.new("ShaderNodeAttribute")
    density.attribute_name = "density"
    total, output = nodes.new("ShaderNodeAddShader"), nodes.new("ShaderNodeOutputMaterial")
    color = (job["albedo"], job["albedo"], job["albedo"], 1)
    for n, kind in enumerate(("ShaderNodeVolumeScatter", "ShaderNodeVolumeAbsorption")):
        medium = nodes.new(kind)
        medium.inputs["Color"].default_value = color
        links.new(density.outputs["Fac"], medium.inputs["Density"])
        links.new(medium.outputs["Volume"], total.inputs[n])
    links.new(total.outputs["Shader"], output.inputs["Volume"])
    volume.materials.append(material)


def add_camera(scene, job):
    data = bpy.data.cameras.new("camera")
    data.angle = job["fov"]
    camera = bpy.data.objects.new("camera", data)
    camera.location = job["camera"]
    away = Vector(job["target"]) - Vector(job["camera"])
    z = -away.normalized()
    x = Vector((0, 1, 0)).cross(z).normalized()
    y = z.cross(x)
    camera.rotation_mode = "QUATERNION"
    camera.rotation_quaternion = Matrix((x, y, z)).transposed().to_quaternion()
    scene.collection.objects.link(camera)
    scene.camera = camera


def add_light(scene):
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = 1
    scene.world = world


def set_up_cycles(scene, job):
    scene.render.engine = "CYCLES"
    scene.render.threads_mode = "FIXED"
    scene.render.threads = 1
    scene.render.use_persistent_data = True
    scene.render.resolution_x = scene.render.resolution_y = job["resolution"]
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.view_settings.view_transform = "Raw"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = job["samples"]
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.pixel_filter_type = "BOX"
    cycles.max_bounces = cycles.volume_bounces = 1000
    cycles.min_light_bounces = cycles.min_transparent_bounces = 1000
    cycles.light_sampling_threshold = 0
    cycles.volume_biased = job["march"]
    cycles.sample_clamp_indirect = 0


if __name__ == "__main__":
    main(sys.argv[1])
