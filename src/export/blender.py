"""Run in Blender (Scripting, Open, Run) or with `blender --python blender.py`: sets the world to
environment.exr and makes the material "flatlight". The plane of the measurement is z = 0, theta = 0 is +X.

environment.exr holds the whole light, suns too. With LAMPS = True suns become lamps, which are free of noise, and
are then twice there unless the environment is switched off.
"""
import math
import os

import bpy

LAMPS = False
# FACTS


def world(folder):
    scene_world = bpy.data.worlds.new("flatlight")
    bpy.context.scene.world = scene_world
    scene_world.use_nodes = True
    nodes, links = scene_world.node_tree.nodes, scene_world.node_tree.links
    nodes.clear()
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.load(os.path.join(folder, "environment.exr"))
    background = nodes.new("ShaderNodeBackground")
    output = nodes.new("ShaderNodeOutputWorld")
    links.new(texture.outputs["Color"], background.inputs["Color"])
    links.new(background.outputs["Background"], output.inputs["Surface"])


def lamps():
    for degrees, irradiance in SUNS:
        strength = max(irradiance)
        data = bpy.data.lights.new("flatlight sun", "SUN")
        data.energy, data.angle = strength, 0.0
        data.color = [v / strength for v in irradiance]
        lamp = bpy.data.objects.new("flatlight sun", data)
        # A lamp shines along its own -Z: turn that from -Z to the horizon, then to the sun's opposite.
        lamp.rotation_euler = (math.radians(90), 0.0, math.radians(degrees + 90))
        bpy.context.collection.objects.link(lamp)


def material():
    made = bpy.data.materials.new("flatlight")
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")

    def shader(kind, colour, roughness=None):
        node = nodes.new(kind)
        if "Color" in node.inputs:
            node.inputs["Color"].default_value = (*colour, 1.0)
        if roughness is not None:
            node.inputs["Roughness"].default_value = roughness
        return node

    def scaled(colour):
        return [c * s for c, s in zip(colour, MATERIAL["scale"])]

    parts = []
    if any(MATERIAL["lambert"]):
        parts.append(shader("ShaderNodeBsdfDiffuse", MATERIAL["lambert"], 0.0))
    if MODEL == "ggx-conductor":
        # Blender's roughness is the root of alpha. Its glossy node has no conductor's Fresnel term: the
        # reflectance at normal incidence stands for it, within some percent below 60 degrees for metals.
        pairs = zip(MATERIAL["eta"], MATERIAL["k"])
        normal = [((n - 1) ** 2 + k * k) / ((n + 1) ** 2 + k * k) for n, k in pairs]
        colour = scaled([f * s for f, s in zip(normal, MATERIAL["specular"])])
        gloss = shader("ShaderNodeBsdfGlossy", colour, math.sqrt(sum(MATERIAL["alpha"]) / 3))
        gloss.distribution = "GGX"
        parts.append(gloss)
    elif MODEL == "lambertian":
        parts.append(shader("ShaderNodeBsdfDiffuse", scaled(MATERIAL["albedo"]), 0.0))
    elif MODEL == "oren-nayar":
        sigma = math.radians(MATERIAL["sigma_deg"][0])
        parts.append(shader("ShaderNodeBsdfDiffuse", scaled(MATERIAL["albedo"]), sigma))
    else:
        print("flatlight: Blender has no shader of the model", MODEL, "- only its diffuse part is set")
        parts.append(shader("ShaderNodeBsdfDiffuse", scaled(MATERIAL.get("diffuse", (0, 0, 0))), 0.0))
    result = parts[0].outputs[0]
    for part in parts[1:]:
        both = nodes.new("ShaderNodeAddShader")
        links.new(result, both.inputs[0])
        links.new(part.outputs[0], both.inputs[1])
        result = both.outputs[0]
    links.new(result, output.inputs["Surface"])


world(os.path.dirname(os.path.abspath(__file__)))
if LAMPS:
    lamps()
if MODEL:
    material()
