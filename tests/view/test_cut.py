"""The wall of a cut in pictures of a log: each face has the colour of the remaining region; inner objects move with their tissue."""
import subprocess
import sys

import pytest

sys.path[:0] = ["tests/mesh", "tests/view"]
import meshlib  # noqa: E402
import synthetic  # noqa: E402
from test_regions import FLAT, blue, red  # noqa: E402
from test_view import pixels, run, share  # noqa: E402

FACES = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))  # outward


@pytest.fixture(scope="module")
def organ(bin, tmp_path_factory):
    """Makes a block of liver, 10 cm, with a cube of vein (blue) in its middle, and its scene."""
    m, path = meshlib.block(5), tmp_path_factory.mktemp("cut") / "block.msh"
    m.names = {(3, 1): "liver", (3, 2): "vein"}
    m.region = [2 if all(0.039 < m.points[v][a] < 0.061 for v in t for a in range(3)) else 1 for t in m.tets]
    path.write_text(meshlib.msh2(m))
    subprocess.run([bin / "tm-scene", "new", path], check=True, capture_output=True, timeout=300)
    return m, path.with_suffix(".yaml")


def surface_left(m, gone):
    """Returns the faces of the remaining tetrahedra: [(outward corners, exposed by the cut)]."""
    sides = {}
    for n, t in enumerate(m.tets):
        for f in FACES:
            corners = [t[i] for i in f]
            sides.setdefault(tuple(sorted(corners)), []).append((n, corners))
    out = []
    for pair in sides.values():
        left = [corners for n, corners in pair if not gone[n]]
        if len(left) == 1:
            out.append((left[0], int(len(pair) == 2)))
    return out


def draw(bin, build, organ, gone, *more):
    """Writes a log of one moment with this surface; draws it with the organ's scene."""
    import lcm
    m, scene = organ
    types, left = synthetic.import_types(build / "python"), surface_left(m, gone)
    used = sorted({v for corners, _ in left for v in corners})
    message = types.tissue_t()
    message.vertex_id, message.vertex_count, message.triangle_count = used, len(used), len(left)
    message.vertex_m = [list(m.points[v]) for v in used]
    message.triangle = [[used.index(v) for v in corners] for corners, _ in left]
    message.triangle_kind = [opened for _, opened in left]
    path = scene.parent / "cut.lcm"
    log = lcm.EventLog(str(path), "w", overwrite=True)
    log.write_event(1_700_000_000_000_000, "TISSUE", message.encode())
    log.close()
    done = run(bin, path, "--scene", scene, "--no-supports", "--png", path.with_suffix(".png"), *FLAT, "--elevation", "80", *more)
    assert done.returncode == 0, done.stderr
    picture = pixels(path.with_suffix(".png"))
    return share(picture, blue), share(picture, red)


def above(m, height_m):
    return [sum(m.points[v][2] for v in t) / 4 > height_m for t in m.tets]


def test_a_wall_has_its_regions_colours(bin, build, organ):
    """Cut across: jagged tetrahedra of liver, of vein in the middle. Cut together with the vein: the tissue below is liver, though the face was the
    vein's too."""
    m, _ = organ
    whole, across = draw(bin, build, organ, [False] * len(m.tets)), draw(bin, build, organ, above(m, 0.05))
    assert whole[0] == 0 and across[0] > 0.003 and across[1] > 0.05
    assert draw(bin, build, organ, [a or r == 2 for a, r in zip(above(m, 0.05), m.region)])[0] == 0


def test_what_lies_inside_goes_with_its_tissue(bin, build, organ):
    """A face between two regions is drawn if both remain; one that lost the tissue on both sides is not."""
    m, _ = organ
    through = ("--through", "0.8")
    whole, low = draw(bin, build, organ, [False] * len(m.tets), *through), draw(bin, build, organ, above(m, 0.062), *through)
    assert whole[0] > 0.005 and low[0] > 0.005  # the vein under the wall
    assert draw(bin, build, organ, above(m, 0.035), *through)[0] == 0
