#!/usr/bin/env python3
"""Makes a segmented image from formulas: liver (1), vessels (2), tumours (3), ribs (4), as NIfTI, NRRD or MetaImage.

python tests/mesh/phantom.py [--spacing 4,4,5] [--noise 0] [--seed 1] OUT.nii.gz"""
import argparse
import gzip
import struct
import zlib
from pathlib import Path

import numpy as np

NAMES = {1: "liver", 2: "vessels", 3: "tumour", 4: "ribs"}
EXTENT_MM = np.array([190.0, 190.0, 160.0])


def capsule(p, a, b, radius):
    """Returns the distance to a segment less a radius that changes linearly from radius[0] at a to radius[1] at b."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    along = np.clip(((p - a) @ (b - a)) / ((b - a) @ (b - a)), 0, 1)
    return np.linalg.norm(p - a - along[..., None] * (b - a), axis=-1) - (radius[0] + (radius[1] - radius[0]) * along)


def ellipsoid(p, middle, axes):
    """Returns approximately the distance to an ellipsoid."""
    q = np.linalg.norm((p - middle) / axes, axis=-1)
    return (q - 1) * min(axes)


def labels_at(p):
    """Returns the labels at places [..., 3], mm from the middle."""
    lobes = [ellipsoid(p, (-18, 0, 0), (58, 52, 44)), ellipsoid(p, (32, -8, 12), (46, 34, 26))]
    liver = -8 * np.log(sum(np.exp(-d / 8) for d in lobes))
    trunk = [((-18, 10, -48), (-14, 4, -10), (7, 6)), ((-14, 4, -10), (-40, -8, 12), (6, 4)), ((-14, 4, -10), (24, -4, 12), (6, 4)),
             ((-40, -8, 12), (-52, -4, 20), (4, 3.5))]
    vessels = np.minimum.reduce([capsule(p, *t) for t in trunk])
    tumour = np.minimum(ellipsoid(p, (-46, 22, -8), (12, 10, 11)), ellipsoid(p, (42, -12, 8), (8, 8, 8)))
    around = np.hypot(p[..., 0], p[..., 1] * 1.15)
    ribs = np.minimum.reduce([np.hypot(around - 80, (p[..., 2] - z) / 1.4) - 5.5 for z in (-40, -5, 30)])
    out = np.zeros(p.shape[:-1], np.uint8)
    out[(ribs < 0) & (p[..., 1] > -30)] = 4
    out[liver < 0] = 1
    out[(vessels < 0) & (liver < 0)] = 2
    out[tumour < 0] = 3
    return out


def brain_at(p):
    """Returns grey (1) and white matter (2) at places [..., 3], mm from the middle: about 170 mm long, folded like a cortex, with the grey matter as
    a thin sheet over the folds."""
    q = p / np.array([62.0, 80.0, 56.0])
    r = np.linalg.norm(q, axis=-1) + 1e-9
    u = q / r[..., None]
    fold = np.sin(11 * u[..., 0] + 3 * np.sin(5 * u[..., 1])) * np.sin(9 * u[..., 2] + 3 * np.sin(4 * u[..., 0])) + 0.6 * np.sin(14 * u[..., 1] + 4 * u[..., 2])
    cleft = 0.1 * np.exp(-((p[..., 0] / 5) ** 2)) * (u[..., 2] > -0.3)  # between the hemispheres
    outer, inner = 1 + 0.025 * fold - cleft, 0.93 + 0.085 * fold - 2.2 * cleft
    out = np.zeros(p.shape[:-1], np.uint8)
    out[r < outer] = 1
    out[r < np.minimum(inner, outer - 0.05)] = 2
    return out


def vein_at(p):
    """Returns a liver's lobe (1) with a winding vein (2) of 3 mm and less."""
    out = np.zeros(p.shape[:-1], np.uint8)
    out[ellipsoid(p, (0, 0, 0), (60, 45, 35)) < 0] = 1
    t = np.linspace(-1, 1, 25)
    way = np.stack([45 * t, 15 * np.sin(4 * t), 10 * np.cos(3 * t)], -1)
    vein = np.minimum.reduce([capsule(p, a, b, (1.8 - 0.6 * abs(x), 1.8 - 0.6 * abs(x))) for a, b, x in zip(way, way[1:], t)])
    out[(vein < 0) & (out == 1)] = 2
    return out


def grid_of(labels, extent_mm, spacing):
    """Makes a label image [x, y, z] from a function of places, centred."""
    size = np.ceil(np.asarray(extent_mm) / spacing).astype(int)
    return labels(np.stack(np.meshgrid(*[(np.arange(n) - (n - 1) / 2) * s for n, s in zip(size, spacing)], indexing="ij"), -1))


def phantom(spacing=(4, 4, 5), noise=0.0, seed=1):
    """Makes a label image [x, y, z]. Noise: this share of voxels takes the label of a neighbour three voxels away."""
    size = np.ceil(EXTENT_MM / spacing).astype(int)
    grid = np.stack(np.meshgrid(*[(np.arange(n) - (n - 1) / 2) * s for n, s in zip(size, spacing)], indexing="ij"), -1)
    out = labels_at(grid)
    if noise:
        dice = np.random.default_rng(seed)
        hit = dice.random(out.shape) < noise
        out[hit] = np.roll(out, (3, -3, 2), (0, 1, 2))[hit]
    return out


def write_nifti(path, image, spacing, origin=(0, 0, 0), direction=np.eye(3), unit=2, change=lambda header: None):
    """Writes the image with LPS place and axes; NIfTI stores RAS. `change` edits the header [352 bytes] before it is written."""
    kind = {"u1": (2, 8), "i2": (4, 16), "i4": (8, 32), "f4": (16, 32), "u2": (512, 16), "i8": (1024, 64)}[image.dtype.str[1:]]
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, image.ndim, *image.shape, *[1] * (7 - image.ndim))
    struct.pack_into("<2h", header, 70, *kind)
    struct.pack_into("<8f", header, 76, 1, *spacing, *[1] * 4)
    struct.pack_into("<3f", header, 108, 352, 1, 0)
    header[123] = unit
    struct.pack_into("<2h", header, 252, 0, 1)
    affine = np.diag([-1, -1, 1]) @ np.column_stack([np.asarray(direction) * np.asarray(spacing), origin])
    struct.pack_into("<12f", header, 280, *affine.ravel())
    header[344:348] = b"n+1\0"
    change(header)
    data = bytes(header) + image.tobytes(order="F")
    path.write_bytes(gzip.compress(data, 6, mtime=0) if path.suffix == ".gz" else data)


def write_nrrd(path, image, spacing, origin=(0, 0, 0), direction=np.eye(3), unit="mm"):
    kind = {"u1": "uint8", "i2": "int16", "u2": "uint16"}[image.dtype.str[1:]]
    columns = np.asarray(direction) * np.asarray(spacing)
    text = ["NRRD0005", f"type: {kind}", "dimension: 3", "space: left-posterior-superior", "sizes: " + " ".join(map(str, image.shape)),
            "space directions: " + " ".join("(%r,%r,%r)" % tuple(map(float, c)) for c in columns.T), "kinds: domain domain domain", "endian: little", "encoding: gzip",
            "space origin: (%r,%r,%r)" % tuple(map(float, origin))]
    if unit:
        text.append(f'space units: "{unit}" "{unit}" "{unit}"')
    for n, value in enumerate(v for v in np.unique(image) if v in NAMES):
        text += [f"Segment{n}_LabelValue:={value}", f"Segment{n}_Name:={NAMES[value]}"]
    path.write_bytes(("\n".join(text) + "\n\n").encode() + gzip.compress(image.tobytes(order="F"), 6, mtime=0))


def write_meta(path, image, spacing, origin=(0, 0, 0), direction=np.eye(3)):
    kind = {"u1": "MET_UCHAR", "i2": "MET_SHORT", "u2": "MET_USHORT"}[image.dtype.str[1:]]
    data = zlib.compress(image.tobytes(order="F")) if path.suffix == ".mha" else image.tobytes(order="F")
    words = lambda v: " ".join(repr(float(x)) for x in np.ravel(v))
    text = ["ObjectType = Image", "NDims = 3", "BinaryData = True", "BinaryDataByteOrderMSB = False", f"CompressedData = {path.suffix == '.mha'}",
            *([f"CompressedDataSize = {len(data)}"] if path.suffix == ".mha" else []), f"TransformMatrix = {words(np.asarray(direction).T)}", f"Offset = {words(origin)}",
            f"ElementSpacing = {words(spacing)}", "DimSize = " + " ".join(map(str, image.shape)), f"ElementType = {kind}",
            "ElementDataFile = " + ("LOCAL" if path.suffix == ".mha" else path.stem + ".raw")]
    head = ("\n".join(text) + "\n").encode()
    if path.suffix == ".mha":
        path.write_bytes(head + data)
    else:
        path.write_bytes(head)
        path.with_suffix(".raw").write_bytes(data)


def write(path, image, spacing, **place):
    path = Path(path)
    writer = write_nifti if path.name.endswith((".nii", ".nii.gz")) else write_nrrd if path.suffix == ".nrrd" else write_meta
    writer(path, image, spacing, **place)
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spacing", default="4,4,5", help="mm of a voxel along each axis; 0.75,0.75,0.65 makes about 256 of each")
    parser.add_argument("--noise", type=float, default=0, help="share of voxels with a wrong label")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("out", help=".nii .nii.gz .nrrd .mha .mhd")
    args = parser.parse_args()
    spacing = [float(s) for s in args.spacing.split(",")]
    image = phantom(spacing, args.noise, args.seed)
    write(args.out, image, spacing, origin=-(np.array(image.shape) - 1) / 2 * spacing)
    print(args.out, *image.shape)


if __name__ == "__main__":
    main()
