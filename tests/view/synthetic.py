"""Writes an LCM log of an artificial session: a smooth body pressed by a probe and opened by a cautery.

For fast tests of the viewer, without a simulation. `python synthetic.py BUILD/python FILE [SECONDS]`.
"""
import math
import sys


def body(rows):
    """Returns a unit sphere as rows of latitude: (points, triangles), triangles outward."""
    points = [(0.0, 0.0, 1.0)]
    around = 2 * rows
    for i in range(1, rows):
        for j in range(around):
            theta, phi = math.pi * i / rows, 2 * math.pi * j / around
            points.append((math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)))
    points.append((0.0, 0.0, -1.0))

    def number(i, j):
        return 0 if i == 0 else len(points) - 1 if i == rows else 1 + (i - 1) * around + j % around

    triangles = []
    for i in range(rows):
        for j in range(around):
            a, b, c, d = number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)
            if i < rows - 1:
                triangles.append((a, b, c))
            if i > 0:
                triangles.append((a, c, d))
    return points, triangles


def shape(points, tip, pressed):
    """Returns the body, 20 x 14 x 6 cm, dented at the tip."""
    out = []
    for x, y, z in points:
        x, y, z = 0.10 * x * (1 + 0.2 * y), 0.07 * y, 0.03 * z * (1 + 0.4 * x)
        if z > 0 and pressed > 0:
            z -= pressed * math.exp(-((x - tip[0]) ** 2 + (y - tip[1]) ** 2) / (2 * 0.012 ** 2))
        out.append([x, y, z])
    return out


class Session:
    """Returns the messages of one moment."""

    def __init__(self, types, rows=16, session=77):
        self.types, self.session = types, session
        self.points, self.triangles = body(rows)
        self.seq = 0

    def tissue(self, utime, t):
        m = self.types.tissue_t()
        m.utime, m.seq, m.session, m.sim_utime = utime, self.seq, self.session, int(t * 1e6)
        cut = min(40, max(0, int((t - 1) * 40)))
        first = len(self.triangles) // 3
        kept = [(tri, 0) for n, tri in enumerate(self.triangles) if not first <= n < first + cut]
        kept += [((a, c, b), 1) for a, b, c in self.triangles[first:first + cut]]
        m.topology_revision = cut
        m.vertex_m = shape(self.points, self.tip(t), self.pressed(t))
        m.vertex_id = list(range(len(self.points)))
        m.triangle = [list(tri) for tri, _ in kept]
        m.triangle_kind = [kind for _, kind in kept]
        m.vertex_count, m.triangle_count = len(m.vertex_m), len(m.triangle)
        m.tie_total, m.tie_count, m.tie_id, m.tie_m = 2, 1, [1], [[0, 0, 0, 0.01, 0, 0]]  # within the body
        return m

    def tip(self, t):
        return [0.03 * math.sin(t), 0.01, 0.0325 - self.pressed(t)]

    def pressed(self, t):
        return 0.006 * (1 - math.cos(2 * t)) / 2

    def status(self, utime, t):
        m = self.types.sim_status_t()
        m.utime, m.seq, m.session = utime, self.seq, self.session
        m.scene, m.model = "synthetic.yaml", "dynamic"
        m.tets_alive, m.substeps, m.dt_s, m.frame_s, m.compute_s = 12345, 14, 0.0024, 1 / 30, 0.011
        m.sim_seconds_per_wall_second, m.instrument_count = 1.0, 2
        m.tip_m = [self.tip(t), [-0.05, -0.02, 0.03]]
        m.trocar_m = [[0.06, 0.05, 0.16], [-0.1, 0.04, 0.16]]
        m.radius_m, m.roll_rad, m.grip = [0.0025, 0.0025], [0.3, 0.0], [0.4, 0.0]
        m.mode, m.active = [1, 2], [0, int(1 < t < 2)]
        m.force_N = [[0.1, 0.05, 300 * self.pressed(t)], [0.0, 0.0, 0.1]]
        return m

    def controller(self, utime, t, instrument):
        m = self.types.controller_status_t()
        m.utime, m.seq, m.session, m.instrument = utime, self.seq, 5, instrument
        m.state, m.fault_text, m.extrapolator, m.passivity_on = 3, "", "local_model", 1
        m.ticks, m.missed_ticks, m.sample_age_s = int(t * 500), 0, 0.02
        m.lateness_us = [20.0, 60.0, 200.0, 500.0]
        return m


def import_types(python_dir):
    sys.path.insert(0, str(python_dir))
    import tensormass_lcm

    return tensormass_lcm


def write_log(python_dir, path, seconds=2.0, hz=30, rows=16, spoil=None):
    """`spoil(session, frame, messages)` may change the list of (channel, bytes) of a frame."""
    import lcm

    types = import_types(python_dir)
    log = lcm.EventLog(str(path), "w", overwrite=True)
    session = Session(types, rows)
    for frame in range(int(seconds * hz) + 1):
        t = frame / hz
        utime = 1_700_000_000_000_000 + round(t * 1e6)
        session.seq = frame
        messages = [("TISSUE", session.tissue(utime, t).encode()), ("SIM_STATUS", session.status(utime, t).encode())]
        if frame % 3 == 0:
            messages += [(f"CONTROLLER_{i}", session.controller(utime, t, i).encode()) for i in (0, 1)]
        if spoil:
            messages = spoil(session, frame, messages)
        for channel, data in messages:
            log.write_event(utime, channel, data)
    log.close()


if __name__ == "__main__":
    write_log(sys.argv[1], sys.argv[2], float(sys.argv[3]) if len(sys.argv) > 3 else 2.0)
