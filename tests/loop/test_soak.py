"""Random kills, stops, clock steps and double starts of all three programs: 100 here, 1,000 in the long run. Each rig has a network namespace and a
bus of its own. The second rig authenticates its messages with a key; no clock step may break that either. TM_SEED=N selects another seed; the
machine's scheduling is not reproducible."""
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

from kit import NETWORK, block_scene

RIGS = 2


def test_a_program_that_comes_back_is_accepted_within_a_second_or_told_why_not(build, root, long_run):
    first, each = int(os.environ.get("TM_SEED", 1)), 500 if long_run else 50
    folders = [pathlib.Path(tempfile.mkdtemp(prefix="tm-soak-", dir="/dev/shm")) for _ in range(RIGS)]
    rigs = []
    try:
        for i, folder in enumerate(folders):
            scene = block_scene(folder, root, "instruments:\n  - trocar: [50 mm, 50 mm, 180 mm]\ncontact:\ndamping: {rate: 60 /s}\nhaptics:\n")
            key = folder / "key"
            key.write_text("00112233445566778899aabbccddeeff\n")
            key.chmod(0o600)
            rigs.append(subprocess.Popen([*NETWORK, sys.executable, root / "tests/loop/soak.py", build, scene, folder, str(first + i), str(each), *([key] if i else [])],
                                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True))
        said = [rig.communicate(timeout=300 + 4 * each)[0] for rig in rigs]
    finally:
        for rig in rigs:
            rig.kill()
        for folder in folders:
            shutil.rmtree(folder)
    print(*said)
    assert all(rig.returncode == 0 for rig in rigs), "\n".join(said)
    for text in said:
        done = json.loads(text)
        assert sum(done["events"].values()) == each and all(n > 0 for n in done["events"].values()), done
