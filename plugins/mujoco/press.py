"""press.py PLUGIN.so [--png FILE]: a MuJoCo arm presses the liver of the demo; the force at its tip, a line a tenth of a second."""
import argparse
import math
import pathlib

import mujoco
import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
# Time, s, and target of the tip, m: next to the liver, at it, 10 mm inside, away.
WAY = [(0.0, (-0.036, -0.018, 0.080)), (0.4, (-0.040, -0.004, 0.057)), (1.0, (-0.040, -0.002, 0.048)), (1.6, (-0.040, -0.002, 0.048)), (2.0, (-0.036, -0.018, 0.080))]


def joints(model, tip):
    """Returns pitch, yaw and insertion for this tip position of the probe."""
    body = model.body("trocar")
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, body.quat)
    x, y, z = turn.reshape(3, 3).T @ (np.asarray(tip) - body.pos)
    length = math.sqrt(x * x + y * y + z * z)
    return math.atan2(-y, z), math.asin(x / length), length


def wanted(time):
    return [np.interp(time, [t for t, _ in WAY], [p[a] for _, p in WAY]) for a in range(3)]


def open_arm(plugin):
    mujoco.mj_loadPluginLibrary(str(plugin))
    text = (HERE / "arm.xml").read_text().replace("../../apps", str(HERE.parents[1] / "apps"))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = data.ctrl[:] = joints(model, WAY[0][1])
    mujoco.mj_forward(model, data)
    return model, data


def press(model, data, seconds, each=lambda: None):
    """Steps the model; returns the force on the tip, N, world, one row a step."""
    forces = []
    while data.time < seconds - 1e-9:
        data.ctrl[:] = joints(model, wanted(data.time))
        mujoco.mj_step(model, data)
        forces.append(data.plugin_state.copy())
        each()
    return np.array(forces)


def picture(model, data, path):
    import PIL.Image
    renderer = mujoco.Renderer(model, 640, 960, max_geom=20000)
    eye = mujoco.MjvCamera()
    eye.lookat, eye.distance, eye.azimuth, eye.elevation = (-0.02, 0, 0.06), 0.33, 100, -30
    renderer.update_scene(data, eye)
    PIL.Image.fromarray(renderer.render()).save(path)


def main():
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("plugin", type=pathlib.Path)
    p.add_argument("--png", type=pathlib.Path, help="a picture of the deepest press (MUJOCO_GL=osmesa without a display; needs Pillow)")
    a = p.parse_args()
    model, data = open_arm(a.plugin)
    for end in np.arange(0.1, 2.05, 0.1):
        force = press(model, data, end)[-1]
        print(f"{end:4.1f} s  tip {np.array2string(1e3 * data.site('tip').xpos, precision=1)} mm  force {np.array2string(force, precision=3)} N")
        if a.png and abs(end - 1.5) < 0.01:
            picture(model, data, a.png)


if __name__ == "__main__":
    main()
