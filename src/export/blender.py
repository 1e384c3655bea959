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

# Models of reflecting facets: Blender's name for their distribution, and the parameter that is its width.
FACETS = {
    "ggx-conductor": ("GGX", "alpha"),
    "ggx-dielectric": ("GGX", "alpha"),
    "torrance-sparrow": ("BECKMANN", "roughness"),
}


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

    def dimmed(node, colour):
        """The node's light times a colour: what is taken away goes into a shader that returns none."""
        if max(abs(c - 1) for c in colour) < 1e-3:
            return node
        mix = nodes.new("ShaderNodeMixShader")
        mix.inputs[0].default_value = 1 - min(1.0, sum(colour) / 3)
        links.new(node.outputs[0], mix.inputs[1])
        links.new(shader("ShaderNodeBsdfDiffuse", (0, 0, 0), 0.0).outputs[0], mix.inputs[2])
        return mix

    parts = []
    if any(MATERIAL["lambert"]):
        parts.append(shader("ShaderNodeBsdfDiffuse", MATERIAL["lambert"], 0.0))
    if MODEL in FACETS:
        distribution, width = FACETS[MODEL]
        # Blender's roughness is the root of the width of the facets' distribution.
        roughness = math.sqrt(sum(MATERIAL[width]) / 3)
        index, extinction = MATERIAL.get("eta") or MATERIAL["ior"], MATERIAL.get("k", (0, 0, 0))
        if hasattr(bpy.types, "ShaderNodeBsdfMetallic"):  # 4.3 and later: Fresnel's equations; without extinction, of a dielectric
            gloss = nodes.new("ShaderNodeBsdfMetallic")
            gloss.fresnel_type = "PHYSICAL_CONDUCTOR"
            gloss.inputs["IOR"].default_value = index
            gloss.inputs["Extinction"].default_value = extinction
            gloss.inputs["Roughness"].default_value = roughness
        else:  # the reflectance at normal incidence at all angles: too dark towards grazing
            normal = [((n - 1) ** 2 + k * k) / ((n + 1) ** 2 + k * k) for n, k in zip(index, extinction)]
            gloss = shader("ShaderNodeBsdfGlossy", normal, roughness)
        gloss.distribution = distribution
        parts.append(dimmed(gloss, scaled(MATERIAL.get("specular", (1, 1, 1)))))
        if "diffuse" in MATERIAL:
            parts.append(shader("ShaderNodeBsdfDiffuse", scaled(MATERIAL["diffuse"]), 0.0))
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
