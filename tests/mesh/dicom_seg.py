"""Writes a label image as DICOM-SEG, explicit VR little endian, without a library: one frame per segment and slice that contains it."""
import struct

import numpy as np

LONG = ("OB", "OW", "SQ", "UN", "UT")


def element(group, number, vr, value):
    if isinstance(value, str):
        value = value.encode()
    elif vr == "US":
        value = struct.pack("<H", value)
    elif vr == "UL":
        value = struct.pack("<I", value)
    value += (b"\0" if vr in ("UI", "OB") else b" ") * (len(value) % 2)
    head = struct.pack("<HH", group, number) + vr.encode()
    return head + (b"\0\0" + struct.pack("<I", len(value)) if vr in LONG else struct.pack("<H", len(value))) + value


def sequence(group, number, items):
    return element(group, number, "SQ", b"".join(b"\xfe\xff\x00\xe0" + struct.pack("<I", len(i)) + i for i in items))


def words(values):
    return "\\".join("%.9g" % v for v in np.ravel(values))


def write_dicom_seg(path, image, spacing, origin=(0, 0, 0), direction=np.eye(3), names=None, kind="BINARY", modality="SEG", change=lambda data: data):
    """Writes image [x, y, z]. LABELMAP: every slice is a frame of labels."""
    direction, values = np.asarray(direction, float), [int(v) for v in np.unique(image) if v]
    frames = [(v, z) for v in values for z in range(image.shape[2]) if (image[:, :, z] == v).any()] if kind == "BINARY" else [(0, z) for z in range(image.shape[2])]
    if kind == "BINARY":
        bits = np.concatenate([(image[:, :, z] == v).T.ravel() for v, z in frames]) if frames else np.zeros(0, bool)
        pixels = np.packbits(bits, bitorder="little").tobytes()
    else:
        pixels = b"".join(image[:, :, z].T.astype("u1").tobytes() for _, z in frames)
    place = [np.asarray(origin, float) + direction[:, 2] * spacing[2] * z for _, z in frames]
    shared = sequence(0x0020, 0x9116, [element(0x0020, 0x0037, "DS", words([direction[:, 0], direction[:, 1]]))])
    shared += sequence(0x0028, 0x9110, [element(0x0018, 0x0050, "DS", words(spacing[2])) + element(0x0018, 0x0088, "DS", words(spacing[2])) + element(0x0028, 0x0030, "DS", words([spacing[1], spacing[0]]))])
    per = [sequence(0x0020, 0x9113, [element(0x0020, 0x0032, "DS", words(p))]) + (sequence(0x0062, 0x000A, [element(0x0062, 0x000B, "US", v)]) if v else b"") for (v, _), p in zip(frames, place)]
    wide = 1 if kind == "BINARY" else 8
    body = element(0x0008, 0x0016, "UI", "1.2.840.10008.5.1.4.1.1.66.4") + element(0x0008, 0x0018, "UI", "2.25.1") + element(0x0008, 0x0060, "CS", modality)
    body += element(0x0028, 0x0002, "US", 1) + element(0x0028, 0x0004, "CS", "MONOCHROME2") + element(0x0028, 0x0008, "IS", str(len(frames))) + element(0x0028, 0x0010, "US", image.shape[1]) + element(0x0028, 0x0011, "US", image.shape[0])
    body += element(0x0028, 0x0100, "US", wide) + element(0x0028, 0x0101, "US", wide) + element(0x0028, 0x0102, "US", wide - 1) + element(0x0028, 0x0103, "US", 0)
    body += element(0x0062, 0x0001, "CS", kind) + sequence(0x0062, 0x0002, [element(0x0062, 0x0004, "US", v) + element(0x0062, 0x0005, "LO", (names or {}).get(v, f"segment {v}")) for v in values])
    body += sequence(0x5200, 0x9229, [shared]) + sequence(0x5200, 0x9230, per) + element(0x7FE0, 0x0010, "OB", pixels)
    meta = element(2, 1, "OB", b"\0\1") + element(2, 2, "UI", "1.2.840.10008.5.1.4.1.1.66.4") + element(2, 3, "UI", "2.25.1") + element(2, 0x10, "UI", "1.2.840.10008.1.2.1") + element(2, 0x12, "UI", "2.25.2")
    path.write_bytes(change(b"\0" * 128 + b"DICM" + element(2, 0, "UL", len(meta)) + meta + body))
