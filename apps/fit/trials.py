"""Requests to `tm-sim --trials` and its answers: many short computations of one scene in one process (docs/fitting.md)."""
import json
import pathlib
import subprocess


class Refused(Exception):
    """The simulation's own error: file:line: what is wrong; what to do."""


class Trials:
    """One process of tm-sim that answers requests about one scene. Close it, or use it in a `with`."""

    def __init__(self, sim, scene, sets=(), unsets=()):
        words = [w for s in sets for w in ("--set", s)] + [w for u in unsets for w in ("--unset", u)]
        self.scene = pathlib.Path(scene)
        self.asked = 0
        self._process = subprocess.Popen([str(sim), str(scene), *words, "--trials", "-", "--quiet"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                         start_new_session=True)  # Ctrl-C is the caller's: it closes this process itself

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        for stream in (self._process.stdin, self._process.stdout):
            stream.close()
        self._process.terminate()
        self._process.wait()

    def ask(self, sets=(), *, settle=None, duration_s=None, points_m=(), cold=False, slopes=None):
        """Settles to a relative residual, or runs `duration_s`. Returns a dict: `time_s` (n), `points_m` (n, points, 3) displacements, `supports` names,
        `supports_N` (n, supports, 3) and `instruments_N` (n, instruments, 3) forces on the tissue; n is 1 at rest, else frames + 1. `slopes` of a rest:
        {"of": quantities, "by": pairs of settings}; the answer then has `slopes` (quantities, pairs), or None and `why`. Refused: with the simulation's
        error."""
        request = {"set": list(sets), "points": [[float(x) for x in p] for p in points_m], "cold": cold}
        request.update({"settle": settle} if duration_s is None else {"duration": float(duration_s)})
        if slopes:
            request["slopes"] = slopes
        self.asked += 1
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            raise Refused(f"{self.scene}: tm-sim ended with exit {self._process.wait()}; tm-sim {self.scene} --check says why")
        answer = json.loads(line)
        if "error" in answer:
            raise Refused(answer["error"])
        return answer
