"""Checks the emulator of Haply's service by clients that are independent of the project's driver: the maker's crate `haply` (long form: it is fetched
and built), and the loop of the maker's tutorials."""
import asyncio
import json
import shutil
import subprocess

import pytest
import websockets
from drivekit import HERE, commands, emulator


@pytest.mark.parametrize("version, key", [("3.5", "vector"), ("3.4", "values")])
def test_tutorial_loop_runs_against_the_emulator(tmp_path, version, key):
    async def play(port):
        async with websockets.connect(f"ws://127.0.0.1:{port}") as socket:
            first = json.loads(await socket.recv())
            assert first["inverse3"][0]["config"]["type"] == "inverse3" and first["inverse3"][0]["status"]["calibrated"]
            assert ("filters" in first["inverse3"][0]["config"]) == (version == "3.5")
            name = first["inverse3"][0]["device_id"]
            for push in (0.0, 1.0, 1.0):
                await socket.send(json.dumps({"inverse3": [{"device_id": name, "commands": {"set_cursor_force": {key: {"x": 0, "y": 0, "z": push}}}}]}))
                state = json.loads(await socket.recv())["inverse3"][0]
                assert "config" not in state and {"x", "y", "z"} == set(state["state"]["cursor_position"])
            with pytest.raises(asyncio.TimeoutError):  # exactly one state per message
                await asyncio.wait_for(socket.recv(), 0.2)
    with emulator(tmp_path, "--version", version) as (_, port, log):
        asyncio.run(play(port))
        rows, _ = commands(log)
    assert [row[1] for row in rows] == [[0, 0, 0], [0, 0, 1], [0, 0, 1]]
    assert rows[-1][2][2] == pytest.approx(0.7 if version == "3.5" else 1.0, abs=0.05), "the filters of 3.5 are on until switched off"


@pytest.mark.long
def test_makers_client_runs_against_the_emulator(tmp_path):
    if not shutil.which("cargo"):
        pytest.skip("no cargo (apt-get install cargo) to build the maker's client with")
    shutil.copytree(HERE / "maker_client", tmp_path / "client")
    built = subprocess.run(["cargo", "build", "-q"], cwd=tmp_path / "client", capture_output=True, text=True, timeout=900)
    assert built.returncode == 0, built.stderr
    with emulator(tmp_path) as (_, port, log):
        said = subprocess.run([tmp_path / "client/target/debug/maker_client", str(port)], capture_output=True, text=True, timeout=60).stdout
        rows, _ = commands(log)
    assert said.startswith("7 049D 0.0000 -0.1200 0.15") and "calibrated true filters true grip true" in said
    assert len(rows) > 150 and rows[-1][1] == [0, 0, 0.75]
