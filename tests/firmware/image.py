"""Sizes of a firmware image from its link map, and a run of it in QEMU."""
import pathlib
import re
import struct
import subprocess
import time

MACHINE = {"m7": "mps2-an500", "m4f": "mps2-an386"}
OUT_FRAME, OUT_RESULT = 1, 2
FRAME = struct.Struct("<IBB8s")
OUTPUT = struct.Struct("<iiiIi3f3f5f3f3fffqi")
RESULT_FIELDS = (["state", "fault", "fault_detail", "limits", "motors_on"] + [f"torque[{i}]" for i in range(3)] + [f"force_N[{i}]" for i in range(3)]
                 + [f"joint[{i}]" for i in range(5)] + [f"tip_m[{i}]" for i in range(3)] + [f"velocity_m_s[{i}]" for i in range(3)]
                 + ["gain", "passivity_J", "sample_age_us", "extrapolator"])


def sections(map_path):
    """Returns [(section, bytes, object)] of everything kept in the image."""
    text = pathlib.Path(map_path).read_text()
    text = text[text.index("Linker script and memory map"):]
    found = re.findall(r"^ (\.[\w.$*]+|COMMON)\s+0x([0-9a-f]+)\s+0x([0-9a-f]+) (\S+)$", text, re.M)
    discarded = {"ARM.attributes", "debug", "comment"}
    return [(name, int(size, 16), obj) for name, address, size, obj in found
            if int(size, 16) and not any(word in name for word in discarded)]


def weigh(map_path):
    """Returns bytes of flash by origin: core, can, firmware (start-up, loop, board), libraries (libm, libc, libgcc)."""
    flash = {"core": 0, "can": 0, "libraries": 0, "firmware": 0}
    for name, size, obj in sections(map_path):
        if not re.match(r"\.(text|rodata|data|vectors|ARM\.ex)", name):
            continue
        if ".ltrans" in obj:  # the core alone is linked as one object (haptic_rt/firmware/module.mk)
            flash["core"] += size
        elif "/haptic_rt/can/" in obj:
            flash["can"] += size
        elif ".a(" in obj:
            flash["libraries"] += size
        else:
            flash["firmware"] += size
    return flash


def emulate(cpu, elf, directory, limit_s):
    """Runs the replay image on the recording in `directory`; one instruction is one nanosecond of its time."""
    for name in ("replay.out", "replay.cost", "replay.report", "replay.panic"):
        (directory / name).unlink(missing_ok=True)
    command = ["timeout", "-k", "5", str(limit_s), "qemu-system-arm", "-M", MACHINE[cpu], "-display", "none", "-monitor", "none", "-serial", "none",
               "-semihosting-config", "enable=on,target=native", "-icount", "shift=0,sleep=off", "-kernel", str(elf)]
    done = subprocess.run(command, cwd=directory, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    panic = directory / "replay.panic"
    assert done.returncode == 0, f"{elf}: status {done.returncode} (124 time-out): {panic.read_text() if panic.exists() else ''} {done.stderr[-2000:]}"


def outputs(path):
    """Returns [(tick output as a dict) or (frame)] in order, from replay.out."""
    data, at, parsed = pathlib.Path(path).read_bytes(), 0, []
    while at < len(data):
        kind, at = data[at], at + 1
        layout = FRAME if kind == OUT_FRAME else OUTPUT
        values = layout.unpack_from(data, at)
        at += layout.size
        parsed.append(("frame", values) if kind == OUT_FRAME else ("output", dict(zip(RESULT_FIELDS, values))))
    return parsed


def symbol(elf, name):
    """Returns the address of a symbol, including file-local ones."""
    for line in subprocess.run(["arm-none-eabi-nm", elf], capture_output=True, text=True, check=True).stdout.splitlines():
        *address, _, found = line.split()  # undefined weak symbols have no address
        if address and found == name:
            return int(address[0], 16)
    raise AssertionError(f"{elf} has no symbol {name}")


def peek(cpu, elf, addresses, times, pause_s):
    """Runs an image and reads 32-bit words of its memory `times` times through the emulator's monitor."""
    command = ["timeout", "-k", "5", "60", "qemu-system-arm", "-M", MACHINE[cpu], "-display", "none", "-monitor", "stdio", "-serial", "none", "-icount", "shift=3,sleep=off",
               "-kernel", str(elf)]
    machine = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    for _ in range(times):
        time.sleep(pause_s)
        for address in addresses:
            machine.stdin.write(f"xp /1wx {address:#x}\n")
        machine.stdin.flush()
    text, _ = machine.communicate("quit\n", timeout=300)
    words = [int(word, 16) for word in re.findall(r"^[0-9a-f]{8,16}: 0x([0-9a-f]{8})", text, re.M)]
    assert len(words) == times * len(addresses), text[-2000:]
    return [words[i : i + len(addresses)] for i in range(0, len(words), len(addresses))]
