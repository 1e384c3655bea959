"""Writes the seeds of the photo targets: tiny files of every kind that the program reads, and damaged ones.

    python3 fuzz/seeds/make.py        needs numpy, OpenImageIO (with OpenEXR, PNG, TIFF, JPEG, HDR)
"""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio

HERE = Path(__file__).parent
RNG = np.random.default_rng(7)


def save(name, pixels, kind, **attributes):
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    for key, value in attributes.items():
        spec.attribute(key.replace("__", ":"), value)
    if "names" in attributes:
        spec.channelnames = tuple(attributes["names"].split(","))
    path = HERE / name
    path.parent.mkdir(exist_ok=True)
    out = oiio.ImageOutput.create(str(path))
    tile = attributes.get("tile")
    if tile:
        spec.tile_width = spec.tile_height = tile
    assert out.open(str(path), spec), (name, out.geterror())
    assert out.write_image(pixels.astype(np.float32)), (name, out.geterror())
    out.close()


def noise(width, height, channels):
    return RNG.random((height, width, channels))


for compression in ["none", "rle", "zip", "zips", "piz", "pxr24", "b44", "dwaa"]:
    save(f"photo_exr/{compression}.exr", noise(9, 7, 3), "half", compression=compression)
save("photo_exr/float.exr", noise(9, 7, 1), "float", names="Y")
save("photo_exr/tiled.exr", noise(20, 18, 3), "half", tile=16)
save("photo_exr/bands.exr", noise(4, 4, 3), "float", names="S.450nm,S.550nm,S.650nm", ExposureTime=0.25)
for bits in ["uint8", "uint16"]:
    for channels, word in [(1, "grey"), (2, "grey-alpha"), (3, "rgb"), (4, "rgba")]:
        save(f"photo_png/{word}{bits[4:]}.png", noise(9, 7, channels), bits)
for compression in ["none", "lzw", "zip", "packbits"]:
    save(f"photo_tiff/{compression}.tif", noise(9, 7, 3), "uint8", compression=compression)
save("photo_tiff/grey16.tif", noise(9, 7, 1), "uint16")
save("photo_tiff/float.tif", noise(9, 7, 3), "float")
save("photo_tiff/half.tif", noise(9, 7, 3), "half")
save("photo_tiff/tiled.tif", noise(40, 20, 3), "uint8", tile=16)
save("photo_tiff/planar.tif", noise(9, 7, 3), "uint8", planarconfig="separate")
save("photo_tiff/exif.tif", noise(4, 4, 3), "uint8", ExposureTime=0.02, Orientation=6, Exif__FNumber=8.0)
save("photo_jpeg/rgb.jpg", noise(17, 9, 3), "uint8", ExposureTime=0.02, Orientation=6, Exif__FNumber=8.0)
save("photo_jpeg/grey.jpg", noise(17, 9, 1), "uint8")
save("photo_jpeg/progressive.jpg", noise(17, 9, 3), "uint8", jpeg__progressive=1)
save("photo_hdr/rle.hdr", noise(16, 5, 3), "float")
save("photo_hdr/flat.hdr", noise(5, 5, 3), "float")
(HERE / "photo_hdr/exposure.hdr").write_bytes(
    b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\nCOLORCORR=1 2 1\n\n+X 2 -Y 2\n" + bytes(range(100, 116))
)
for name in ["photo_exr/float.exr", "photo_exr/zip.exr", "photo_hdr/flat.hdr"]:
    target = HERE / "environment" / Path(name).name
    target.parent.mkdir(exist_ok=True)
    target.write_bytes((HERE / name).read_bytes())
