"""An emulator of Haply's Inverse Service, written from its published messages (docs.haply.co, "WebSocket Protocol", 3.5; the tutorials of 3.1 to
3.4).

The service speaks first (an inventory with config, state and status) and then answers each message with one state. Stricter than the service: each
version accepts only its own key (`vector` since 3.5, `values` before), so a driver that sends the other one gets no force. Its filters change the
force until they are switched off. The cursor is a mass with friction that a hand holds: a spring and a damper to a target that moves up and down.

    haply_service.py --port 0 --log FILE [--version 3.4] [--trouble late:50 --after 0.5] ...

Prints the port. Each command is a line of the log: time_us,requested x,y,z,applied x,y,z,cursor x,y,z. `--after` counts from the first force."""
import argparse
import asyncio
import json
import math
import sys
import time

import websockets

parser = argparse.ArgumentParser()
parser.add_argument("--port", type=int, default=0)
parser.add_argument("--version", default="3.5", choices=("3.4", "3.5"))
parser.add_argument("--log")
parser.add_argument("--devices", type=int, default=1)
parser.add_argument("--trouble", help="late:MS, nonsense, flood, silent, close, unpowered")
parser.add_argument("--after", type=float, default=0.5)
parser.add_argument("--swing", type=float, default=0.0, help="m, of the hand's target downwards, every two seconds")
parser.add_argument("--move", default="0,0,0", help="m, where the hand wants the cursor after a second, from its start")
parser.add_argument("--buttons", default="", help="BUTTON:FROM-TO s, comma separated, of the handle")
parser.add_argument("--hand", type=float, default=300.0, help="N/m")
parser.add_argument("--wrong", default="1,1,1", help="factors of the force on each axis: -1 a wrong sign, 0.001 a wrong unit")
parser.add_argument("--stuck-filters", action="store_true", help="the filters cannot be switched off")
args = parser.parse_args()

IDS = ["049D", "04BA", "05AA"][:args.devices]
START = (0.0, -0.12, 0.15)
MASS, VISCOUS, COULOMB, HAND, HAND_DAMPING, STEP = 0.12, 0.3, 0.15, args.hand, 11.0, 5.0e-6
WRONG = [float(w) for w in args.wrong.split(",")]
NONSENSE = ['{"inverse3": [', "[]", '{"inverse3":[{"device_id":"049D","state":{}}]}', "\x00\x01", "null",
            '{"inverse3":[{"device_id":"049D","state":{"cursor_position":{"x":"0","y":0,"z":0}}}]}',
            '{"inverse3":[{"device_id":"049D","state":{"cursor_position":{"x":1e99,"y":0,"z":0}}}]}',
            '{"inverse3":[{"device_id":"049D","state":{"cursor_position":{"x":77,"y":0,"z":0}}}]}', "x" * 70000]


def now_us():
    return time.monotonic_ns() // 1000


class Device:
    def __init__(self, name):
        self.name, self.cursor, self.speed, self.force = name, list(START), [0.0] * 3, [0.0] * 3
        self.gate, self.damping, self.last_us, self.begin_us = 0.3, 0.5, now_us(), now_us()

    def move(self):
        now = now_us()
        time_s, dt = 1e-6 * (now - self.begin_us), min(1e-6 * (now - self.last_us), 0.005)
        self.last_us = now
        share = min(max(time_s - 1.0, 0.0), 1.0)
        goal = [a + share * float(b) for a, b in zip(START, args.move.split(","))]
        goal[2] -= args.swing * 0.5 * (1 - math.cos(math.pi * time_s))
        for i in range(3):
            push = WRONG[i] * self.force[i] + HAND * (goal[i] - self.cursor[i])
            v = (self.speed[i] + dt * push / MASS) / (1 + dt * (HAND_DAMPING + VISCOUS) / MASS)
            least = dt * COULOMB / MASS
            self.speed[i] = v - least if v > least else v + least if v < -least else 0.0
            self.cursor[i] += dt * self.speed[i]

    def entry(self, whole):
        self.move()
        vector = [round(c / STEP) * STEP for c in self.cursor]
        config = {"type": "inverse3", "port": "COM12", "device_info": {"major_version": 7, "minor_version": 4, "id": self.name, "device_type": 4, "uuid": "2D35F80DD9005F599B68F49944CB" + self.name},
                  "extended_device_id": "2D35F80DD9005F599B68F49944CB" + self.name, "extended_firmware_version": "F7BACE8FF058FF8206CD336A475CF81F",
                  "gravity_compensation": {"enabled": True, "scaling_factor": 1.0}, "handedness": "right", "streaming_mode": "USB", "torque_scaling": {"enabled": True}}
        if args.version == "3.5":
            config |= {"preset": "defaults", "basis": {"permutation": "XYZ"}, "mount": {}, "filters": {"force_gate": {"gain": self.gate}, "damping": {"scalar": self.damping}}}
        state = {"cursor_position": dict(zip("xyz", vector)), "cursor_velocity": dict(zip("xyz", self.speed)), "angular_position": {"a0": 0.0, "a1": 0.0, "a2": 0.0},
                 "angular_velocity": {"a0": 0.0, "a1": 0.0, "a2": 0.0}, "body_orientation": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0},
                 "current_cursor_force": dict(zip("xyz", self.force)), "current_cursor_position": {"x": 0.0, "y": 0.0, "z": 0.0}, "current_angular_torques": {"a0": 0.0, "a1": 0.0, "a2": 0.0},
                 "current_angular_position": {"a0": 0.0, "a1": 0.0, "a2": 0.0}, "control_domain": "cartesian", "control_mode": "idle", "mode": "idle", "transform": {}, "transform_velocity": {}}
        status = {"calibrated": True, "in_use": True, "power_supply": not unpowered(), "ready": True, "started": True}
        return {"device_id": self.name, **({"config": config} if whole else {}), "state": state, "status": status}


devices = {name: Device(name) for name in IDS}
first_force_us = None
log = open(args.log, "w", buffering=1) if args.log else None


def in_trouble():
    return bool(args.trouble) and first_force_us is not None and now_us() - first_force_us > 1e6 * args.after


def unpowered():
    return args.trouble == "unpowered" and in_trouble()


def grip(whole, begin_us):
    time_s, pressed = 1e-6 * (now_us() - begin_us), set()
    for word in filter(None, args.buttons.split(",")):
        button, span = word.split(":")
        low, high = map(float, span.split("-"))
        if low <= time_s < high:
            pressed.add(button)
    turn = 0.5 * min(time_s, 3.0)
    return [{"device_id": "1402", **({"config": {"type": "wireless_verse_grip", "port": "COM46", "major_version": 2, "minor_version": 2, "hardware_version": 1, "streaming_mode": "Radio"}} if whole else {}),
             "state": {"battery_level": 0.8, "battery_voltage": 4.0, "buttons": {b: b in pressed for b in "abc"}, "hall": 15,
                       "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(turn / 2), "w": math.cos(turn / 2)}}, "status": {"connected": True, "awake": True, "ready": True}}]


def message(whole, begin_us):
    head = {"session_id": 7, "session": {"session_id": 7}} if args.version == "3.5" else {}
    return json.dumps({**head, "inverse3": [d.entry(whole) for d in devices.values()], "verse_grip": [], "wireless_verse_grip": grip(whole, begin_us)})


def obey(text):
    """Carries out a message; returns whether it requests the configuration."""
    global first_force_us
    told = json.loads(text)
    for entry in told.get("inverse3", []):
        device = devices[entry["device_id"]]
        device.move()
        configure = {} if args.stuck_filters or args.version != "3.5" else entry.get("configure", {})
        device.gate = configure.get("force_gate", {}).get("gain", device.gate)
        device.damping = configure.get("damping", {}).get("scalar", device.damping)
        force = entry.get("commands", {}).get("set_cursor_force", {}).get("vector" if args.version == "3.5" else "values")
        if force is None:
            continue
        wanted = [float(force[a]) for a in "xyz"]
        filters = args.version == "3.5"
        device.force = [f * (1 - device.gate * filters) - device.damping * filters * v for f, v in zip(wanted, device.speed)]
        if any(wanted) and first_force_us is None:
            first_force_us = now_us()
        if log:
            log.write(",".join([str(now_us()), *(f"{x:.6f}" for x in wanted + device.force + device.cursor)]) + "\n")
    return "force_render_full_state" in told.get("session", {})


async def serve(socket):
    begin_us, said = now_us(), False
    await socket.send(message(True, begin_us))
    try:
        async for text in socket:
            whole = obey(text)
            if in_trouble() and log and not said:
                log.write(f"# trouble {now_us()}\n")
                said = True
            if not in_trouble() or args.trouble == "unpowered":
                await socket.send(message(whole, begin_us))
                continue
            kind, _, amount = args.trouble.partition(":")
            if kind == "late":
                await asyncio.sleep(1e-3 * float(amount))
                await socket.send(message(whole, begin_us))
            elif kind == "nonsense":
                await socket.send(NONSENSE[int(time.monotonic() * 1000) % len(NONSENSE)])
            elif kind == "flood":
                text = message(whole, begin_us)  # once: a slow machine would make them no faster than they are asked for
                for _ in range(500):
                    await socket.send(text)
            elif kind == "close":
                return
    except websockets.ConnectionClosed:
        pass
    finally:
        for device in devices.values():
            device.force = [0.0] * 3


async def main():
    async with websockets.serve(serve, "127.0.0.1", args.port, compression=None) as server:
        print(server.sockets[0].getsockname()[1], flush=True)
        await asyncio.Future()

try:
    asyncio.run(main())
except KeyboardInterrupt:
    sys.exit(0)
