"""The MuJoCo plugin with MuJoCo's PyPI package: an arm presses the liver. The tests run in the environment that `make mujoco` makes."""
import json
import subprocess

import pytest

SCRIPT = """
import json, sys
import numpy as np
sys.path.insert(0, "{root}/plugins/mujoco")
import mujoco, press
model, data = press.open_arm("{plugin}")
told = {{}}
before = press.press(model, data, 0.4)
told["before"] = float(abs(before).max())
press.press(model, data, 1.0)
still = press.press(model, data, 1.5)
axis = data.site("tip").xmat.reshape(3, 3)[:, 2]
told["force"] = still[-1].tolist()
told["along"] = float(still[-1] @ axis)
told["roughness"] = float(abs(np.diff(still[-50:], axis=0)).max())
told["actuator"] = float(data.actuator_force[2])
told["turn"] = data.qfrc_actuator[:2].tolist()
told["passive"] = data.qfrc_passive[:2].tolist()
other = mujoco.MjData(model)
told["other"] = float(abs(other.plugin_state).max())
mujoco.mj_resetData(model, data)
told["reset"] = float(abs(data.plugin_state).max())
data.qpos[:] = data.ctrl[:] = press.joints(model, press.WAY[0][1])
again = press.press(model, data, 0.6)
told["again"] = float(abs(again[-1]).max())
json.dump(told, sys.stdout)
"""


@pytest.fixture(scope="module")
def plugin(root, build):
    made = subprocess.run(["make", "--no-print-directory", "mujoco"], cwd=root, capture_output=True, text=True, timeout=900)
    assert made.returncode == 0, made.stdout[-2000:] + made.stderr[-2000:]
    return build / "mujoco/libtensormass_mujoco.so"


def python(build, script, tmp_path):
    return subprocess.run([build / "mujoco/venv/bin/python", "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=900)


def test_arm_bears_the_tissues_force(root, build, plugin, tmp_path):
    run = python(build, SCRIPT.format(root=root, plugin=plugin), tmp_path)
    assert run.returncode == 0 and run.stderr == "", run.stderr
    told = json.loads(run.stdout)
    assert told["before"] == 0, "a force in the air"
    assert 0.5 < sum(f * f for f in told["force"]) ** 0.5 < 2
    assert told["along"] < 0, "tissue pushes the tool out"
    assert told["actuator"] == pytest.approx(-told["along"], rel=0.01), "at rest the arm's motor holds what the tissue bears"
    for motor, tissue in zip(told["turn"], told["passive"]):
        assert motor == pytest.approx(-tissue, abs=2e-4)
    assert told["roughness"] < 2e-3
    assert told["other"] == 0 and told["reset"] == 0, "each mjData has tissue of its own, and a reset brings it to rest"
    assert told["again"] > 0.05
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists(), "MuJoCo had something to complain of"


@pytest.mark.parametrize("old, new, said", [
    ("liver-press.yaml", "none.yaml", "none.yaml"),
    ('value="tip"', 'value="tap"', "no site 'tap'"),
    ('value="tip"', 'value="tip tip"', "2 sites for 1 instruments"),
    ('<config key="sites"', '<config key="set" value="gravitas=yes"/><config key="sites"', "gravitas"),
])
def test_errors_are_reported(root, build, plugin, tmp_path, old, new, said):
    script = f"""
import mujoco
mujoco.mj_loadPluginLibrary({str(plugin)!r})
text = open({str(root / 'plugins/mujoco/arm.xml')!r}).read().replace("../../apps", {str(root / 'apps')!r})
mujoco.MjData(mujoco.MjModel.from_xml_string(text.replace({old!r}, {new!r})))
"""
    run = python(build, script, tmp_path)
    assert run.returncode != 0 and "tensormass.tissue" in run.stdout + run.stderr and said in run.stdout + run.stderr
