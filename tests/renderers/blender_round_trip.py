"""Runs RUN_FOLDER/export/blender.py, as `flatlight export --to blender` wrote it, renders the object in Cycles and compares it with the
photographs.

    python blender_round_trip.py RUN_FOLDER CAPTURE_FOLDER LIMB_DEG

The photographs are linear EXR files, one per view, by a perspective camera whose plane of measurement is level. Compared are the pixels of the
object's cross-section row by row, up to LIMB_DEG from the normal. Prints, as JSON, the root mean square of the difference over that of the
photographs: of all views together, and of each view by itself.
"""
import json
import math
import pathlib
import runpy
import sys
import tempfile
import tomllib

import numpy as np

import bpy

SAMPLES = 512
VIEWS = 4


def main(run_folder, capture_folder, limb_deg):
    run, folder = pathlib.Path(run_folder), pathlib.Path(capture_folder)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    runpy.run_path(str(run / "export/blender.py"), run_name="__main__")
    # As the run resolved it: every view, every default.
    capture = tomllib.loads((run / "capture.toml").read_text())
    radius, camera = capture["object"]["radius"], capture["camera"]
    (width, height), distance = camera["image_size"], camera["distance"]
    sphere = capture["object"]["shape"] == "sphere"
    if sphere:
        bpy.ops.mesh.primitive_uv_sphere_add(segments=1024, ring_count=512, radius=radius)
    else:
        bpy.ops.mesh.primitive_cylinder_add(vertices=2048, radius=radius, depth=40 * radius, end_fill_type="NOTHING")
    photographed = bpy.context.object
    photographed.data.materials.append(bpy.data.materials["flatlight"])
    for polygon in photographed.data.polygons:
        polygon.use_smooth = True

    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = SAMPLES, False, 1
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    lens = bpy.data.cameras.new("camera")
    lens.sensor_width, lens.sensor_fit, lens.clip_start = 36.0, "HORIZONTAL", 1e-3
    lens.lens = camera["focal_px"] / width * lens.sensor_width
    scene.camera = bpy.data.objects.new("camera", lens)
    bpy.context.collection.objects.link(scene.camera)

    column = np.arange(width) + 0.5 - camera.get("principal_point_px", [width / 2, 0])[0]
    tangent = column / camera["focal_px"]
    seen = np.abs(distance / radius * tangent / np.sqrt(1 + tangent**2)) < math.sin(math.radians(float(limb_deg)))
    rows = slice(height // 2 - 2, height // 2 + 2) if sphere else slice(0, height)
    views = capture["view"]
    shares, squares, power = [], 0.0, 0.0
    with tempfile.TemporaryDirectory() as temporary:
        for view in views[:: max(1, len(views) // VIEWS)]:
            orbit = math.radians(view["orbit_deg"])
            scene.camera.location = (distance * math.cos(orbit), distance * math.sin(orbit), 0)
            scene.camera.rotation_euler = (math.pi / 2, 0, orbit + math.pi / 2)
            scene.render.filepath = str(pathlib.Path(temporary) / "view.exr")
            bpy.ops.render.render(write_still=True)
            a = pixels(scene.render.filepath)[rows].mean(0)[seen]
            b = pixels(folder / view["photos"][0]["file"])[rows].mean(0)[seen]
            difference, whole = ((a - b) ** 2).sum(0), (b**2).sum(0)
            squares, power = squares + difference, power + whole
            shares.append(np.sqrt(difference / whole).tolist())
    print()
    print(json.dumps({"views": len(shares), "relative_rms": np.sqrt(squares / power).tolist(), "of_each_view": shares}))


def pixels(file):
    """Red, green and blue as they are in the file, the top row first."""
    image = bpy.data.images.load(str(file))
    image.colorspace_settings.name = "Non-Color"
    values = np.array(image.pixels[:]).reshape(image.size[1], image.size[0], 4)[::-1, :, :3]
    bpy.data.images.remove(image)
    return values


if __name__ == "__main__":
    main(*sys.argv[1:])
