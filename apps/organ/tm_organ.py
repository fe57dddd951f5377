#!/usr/bin/python3
"""Turns a segmented image, a surface or a mesh into an organ with haptic feedback: meshes it, writes a scene, checks it at rest, tunes it to half a core in real time, runs a press and a cut, draws a picture and a video."""
import argparse
import hashlib
import json
import math
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time

BIN = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(BIN.parent / "lib/tensormass/organ"), str(BIN)]
from organ_bodies import names_of, shared_refusal, split, write_bodies  # noqa: E402

IMAGES = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd", ".dcm")
SURFACES = (".stl", ".obj", ".ply", ".off", ".vtp")
MESHES = (".msh", ".vtk", ".vtu", ".mesh")
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
LIVE = 0.5  # share of a core, in the busiest second of the press
AIM = 0.8  # share of that, so that a busier machine keeps up too
MASS_GOOD, MASS_MOST = 0.1, 1.0  # added mass relative to the tissue's: accepted before coarsening; maximum
SUBSTEPS_LEAST = 10  # per frame: 4 ms
TOO_MUCH = "too much for real time"
COARSER, COARSENINGS = 0.6, 3  # share of tetrahedra kept by each coarsening; number of coarsenings
SAG_MOST = 0.3  # relative to the organ's size, under its own weight: more means too few supports


class Stop(Exception):
    """An error message with the exit code."""
    def __init__(self, message, code=2):
        super().__init__(message)
        self.code = code


def arguments():
    p = argparse.ArgumentParser(prog="tm-organ", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
                                epilog="FOLDER gets organ.msh, organ.yaml (yours to edit: an edited file is not overwritten), press.lcm, force.csv, organ.png,\n"
                                       "organ.mp4 and the figures of each stage. Run again, it repeats only the stages that are incomplete or whose inputs changed.\n"
                                       "Images need the module 'image' (tm-mesh image); surfaces and meshes need nothing more.")
    p.add_argument("source", type=pathlib.Path, metavar="SOURCE", help="image (%s), closed surface (%s) or tetrahedra (%s)" % (" ".join(IMAGES), " ".join(SURFACES), " ".join(MESHES)))
    p.add_argument("-o", "--out", type=pathlib.Path, metavar="FOLDER", required=True, help="folder for all results")
    p.add_argument("--unit", choices=UNITS, help="unit of a surface's or mesh's numbers [surface: required; mesh: m]. Images contain theirs")
    p.add_argument("--size", metavar="SIZE", help="edge length of tetrahedra, such as 8mm [surface: a fourteenth of its longest side; image: by --budget]")
    p.add_argument("--budget", metavar="N", help="image: largest number of tetrahedra [10000]")
    p.add_argument("--label", action="append", default=[], metavar="N=NAME", help="image: use this label under this name; may be repeated [all]. Names select the materials")
    p.add_argument("--bodies", action="store_true", help="make a body of each region, with a mesh of its own; bodies touch each other")
    p.add_argument("--smooth", metavar="S", help="image: width of the smoothing of voxels' steps, in voxels; less keeps thin labels [1, and less in thin ones]")
    p.add_argument("--up", choices=("x", "y", "z", "-x", "-y", "-z"), help="direction towards the surgeon [image: -y, the front of a patient; else z]")
    p.add_argument("--no-cut", action="store_true", help="only press: no cautery, and the longer steps of uncuttable tissue")
    p.add_argument("--video", metavar="WxH", default="960x540", help="size of the video [960x540]")
    p.add_argument("--no-video", action="store_true", help="draw only a picture")
    p.add_argument("--no-film", dest="no_video", action="store_true", help=argparse.SUPPRESS)  # its name in 0.1
    p.add_argument("--again", action="store_true", help="repeat all stages; an edited organ.yaml is kept")
    p.add_argument("--quiet", action="store_true", help="print warnings and errors only")
    p.add_argument("--version", action="version", version="tm-organ @VERSION@")
    return p.parse_args()


def plain(path):
    """Returns the path, made absolute if it looks like an option (pathlib drops "./")."""
    return path.absolute() if str(path).startswith("-") else path


def kind_of(path):
    name = path.name.lower()
    for kind, endings in (("image", IMAGES), ("surface", SURFACES), ("mesh", MESHES)):
        if name.endswith(endings):
            return kind
    raise Stop(f"{path}: neither an image ({' '.join(IMAGES)}), a surface ({' '.join(SURFACES)}) nor tetrahedra ({' '.join(MESHES)})")


def digest(path):
    sha = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            sha.update(block)
    return sha.hexdigest()


class Coarser(Exception):
    """The mesh is too fine for real time; a coarser one can be made."""


class Work:
    """The folder and its stages: .organ.done records the inputs of each completed stage."""
    def __init__(self, a):
        self.folder, self.quiet, self.again = a.out, a.quiet, a.again
        self.state, self.ours = a.out / ".organ.done", not a.out.exists()
        try:
            self.done = json.loads(self.state.read_text())
        except (OSError, ValueError):
            self.done = {}
        self.number, self.of, self.warned = 0, 0, False

    def say(self, text, end="\n"):
        if not self.quiet:
            print(text, end=end, flush=True)

    def warn(self, line):
        """Prints a warning between a stage's name and its result."""
        if not self.quiet and not self.warned:
            print(flush=True)
        self.warned = True
        print("    " + line, file=sys.stderr, flush=True)

    def path(self, name):
        return self.folder / name

    def call(self, *command):
        """Runs one of our programs in the folder; returns its output, or raises Stop with it: the program's own error is clear."""
        run = subprocess.run([str(BIN / command[0]), *map(str, command[1:])], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if run.returncode < 0 or run.returncode in (130, 143):
            raise KeyboardInterrupt
        if run.returncode:
            raise Stop(run.stderr.strip() or f"{command[0]}: exit {run.returncode}", 2 if run.returncode == 2 else 1)
        return run.stdout, run.stderr

    def yours(self):
        """Returns the scene's digest if the user has changed it since tm-scene wrote it, else None."""
        path = self.path("organ.yaml")
        now = digest(path) if path.exists() else None
        return now if now != self.done.get("written") else None

    def stage(self, name, what, inputs, outputs, act):
        """Runs act() unless the outputs exist and have the same inputs. Prints its result."""
        self.number += 1
        key = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()
        self.say(f"{self.number}/{self.of} {what:<26}", end="")
        if not self.again and self.done.get(name, {}).get("key") == key and all(self.path(o).is_file() for o in outputs):
            self.say(f"{self.done[name]['said']} (done before)")
            return
        began, self.warned = time.monotonic(), False
        try:
            said = act()
        except BaseException:
            self.say("")
            raise
        self.done[name] = {"key": key, "said": said, "seconds": round(time.monotonic() - began, 2)}
        self.state.write_text(json.dumps(self.done, indent=1))
        self.say(("    " if self.warned else "") + f"{said} ({self.done[name]['seconds']:.1f} s)")


def mesh(a, kind, coarser, w):
    """Makes organ.msh, in metres, and the bodies' meshes; `coarser`: share of the tetrahedra to keep."""
    f = tetrahedra(a, kind, coarser, w, a.smooth)
    shared = split(w.call, w.path, f, names_of(f, Stop)) if a.bodies else 0
    if shared and kind == "image" and not a.smooth:  # smoothing closes a gap of about a voxel
        f = tetrahedra(a, kind, coarser, w, "0")
        left = split(w.call, w.path, f, names_of(f, Stop))
        if not left:
            w.warn(f"{a.source}: warning: smoothing closes the gap ({shared} shared vertices), so the voxels are not smoothed; a finer image would have smooth surfaces")
        shared = left
    if shared:
        raise Stop(shared_refusal(shared, kind))
    return f"{f['tets']:,} tetrahedra, {len(f['regions'])} region{'s' * (len(f['regions']) != 1)}, {f['volume_m3'] * 1e6:.4g} cm3"


def tetrahedra(a, kind, coarser, w, smooth):
    """Makes organ.msh and returns its figures."""
    out, figures = w.path("organ.msh"), w.path("mesh.json")
    size = a.size
    if coarser < 1 and (size or kind == "surface"):
        size = "%.4gmm" % (1e3 * w.done["edge_m"] * coarser ** (-1 / 3))
    if kind == "image":
        budget = str(max(300, int(coarser * int(a.budget or 10000))))
        words = [x for label in a.label for x in ("--label", label)] + (["--size", size] if size else ["--budget", budget])
        if "  image " not in w.call("tm-mesh", "--list")[0]:
            raise Stop(f"{a.source}: this tm-mesh has no module for images; build it (make image), or give a surface")
        try:
            for line in w.call("tm-mesh", "image", *words, *(["--smooth", smooth] if smooth else []), "--space", "lps", a.source, "-o", out)[1].splitlines():
                if "warning:" in line or "all labels are kept" in line:
                    w.warn(line)
        except Stop as stop:  # a missing module's message does not name the image
            raise Stop(str(stop) if str(a.source) in str(stop) else f"{a.source}: {stop}", stop.code)
    elif kind == "surface":
        w.call("tm-mesh", "fill", *(["--size", size] if size else []), "--scale", UNITS[a.unit], a.source, "-o", out)
    elif UNITS[a.unit or "m"] == 1 and a.source.suffix.lower() == ".msh":
        shutil.copyfile(a.source, w.path("organ.part"))
        try:
            w.call("tm-mesh", "check", a.source)
        except Stop:
            w.path("organ.part").unlink()
            raise
        os.replace(w.path("organ.part"), out)  # unchanged: the scene uses its groups and regions
    else:
        w.call("tm-mesh", "convert", "--scale", UNITS[a.unit or "m"], a.source, "-o", out)
    w.call("tm-mesh", "info", "--json", figures, out)
    f = json.loads(figures.read_text())
    if coarser == 1:
        w.done["edge_m"] = edge_m(a, f)
    return f


def edge_m(a, f):
    """Returns the edge length of the first mesh."""
    if a.size:
        number, unit = re.fullmatch(r"\s*([\d.eE+-]+)\s*([a-z]*)\s*", a.size).groups()
        return float(number) * UNITS.get(unit or "m", 1.0)
    return max(h - l for h, l in zip(f["high_m"], f["low_m"])) / 14


def scene(a, up, w):
    """Writes organ.yaml unless the user has changed it."""
    path = w.path("organ.yaml")
    if w.yours():
        said = "yours, kept; "
    else:
        stem = a.source.name.split(".")[0]
        _, words = w.call("tm-scene", "new", "--force", "--up", up, "--title", f"{stem}, pressed{'' if a.no_cut else ' and cut'}", *([] if a.no_cut else ["--cut"]), w.path("organ.msh"), "-o", path)
        for line in words.splitlines():
            if "warning:" in line:
                w.warn(line)
        if a.bodies:
            write_bodies(path, names_of(json.loads(w.path("mesh.json").read_text()), Stop))
        w.done["written"], said = digest(path), ""
    out, words = w.call("tm-scene", "check", path)
    w.path("check.txt").write_text(words + out)
    odd = sum("warning:" in line for line in words.splitlines())
    for line in words.splitlines():
        w.warn(line)
    return said + (f"{odd} warning{'s' * (odd != 1)}" if odd else "no warnings")


def rest(up, w):
    """Checks that the supports hold the organ under its own weight."""
    figures, axis, sign = w.path("rest.json"), "xyz".index(up[-1]), 1 if up[0] == "-" else -1
    g = [0, 0, 0]
    g[axis] = sign * 9.81
    w.call("tm-sim", w.path("organ.yaml"), "--settle", "1e-6", "--set", f"gravity.acceleration={g}".replace(" ", ""), "--json", figures, "--write", w.path("rest.vtk"))
    sag, f = json.loads(figures.read_text())["largest_displacement_m"], json.loads(w.path("mesh.json").read_text())
    size = max(h - l for h, l in zip(f["high_m"], f["low_m"]))
    if sag > SAG_MOST * size:
        w.warn(f"{w.path('organ.yaml')}: warning: under its own weight it sags by {1e3 * sag:.3g} of {1e3 * size:.3g} mm: its supports are too few; add supports")
    return f"at rest under its weight, sags {1e3 * sag:.3g} mm"


def figures_of(w, seconds=None, step_s=None):
    """Returns figures of a press in lockstep, or of its first seconds, with mass scaling to this step."""
    figures = w.path("live.json")
    sets = [f"time.step={step_s:.4g}", "time.mass_scaling=yes", "time.mass_scaling_max=100"] if step_s else []
    w.call("tm-sim", w.path("organ.yaml"), "--lockstep", "--json", figures, *(["--duration", f"{seconds} s"] if seconds else []), *(x for s in sets for x in ("--set", s)))
    return json.loads(figures.read_text())


def heavier(w, step_s):
    """Computes the effect of mass scaling to this step: share of the tissue's mass, lowest frequencies with and without it."""
    figures = w.path("heavier.json")
    sets = [f"time.step={step_s:.4g}", "time.mass_scaling=yes", "time.mass_scaling_max=100"]
    w.call("tm-sim", w.path("organ.yaml"), "--explain", "--json", figures, *(x for s in sets for x in ("--set", s)))
    m = json.loads(figures.read_text()).get("mass_scaling", {"physical_kg": 1, "added_kg": 0})
    figures.unlink()
    return m["added_kg"] / m["physical_kg"], m.get("own_frequency_Hz"), m.get("frequency_Hz")


def make_heavier(w, step_s, share, own_Hz, Hz):
    """Writes mass scaling into the scene, with its effect."""
    path = w.path("organ.yaml")
    most = max(0.2, round(1.5 * share + 0.05, 2))
    what = f"{100 * share:.2g} % of mass is added where tetrahedra are small" + (f", lowest frequency {min(own_Hz):.3g} -> {min(Hz):.3g} Hz" if Hz else "")
    text = re.sub(r"^time: \{frame_rate: 25 Hz,.*$", lambda m: "# so that half a core of this machine steps it in real time: %s. At rest nothing changes.\n%s" % (
        what, re.sub(r"\}.*", ", step: %.4g ms, mass_scaling: yes, mass_scaling_max: %g} # tm-sim --explain says where" % (1e3 * step_s, most), m[0])), path.read_text(), flags=re.M)
    path.write_text(text)
    w.done["written"] = digest(path)
    return what


def lighter(w, f, coarsens):
    """Finds a longer step, by mass scaling of small tetrahedra, at which half a core computes the press: (step, share of mass, frequencies, load), or
    None."""
    frame, first, substeps = f["frame_s"], f["busiest_second_s"], f["substeps_per_frame"]
    quiet = figures_of(w, 0.4)
    one_s = quiet["processor_s"] / quiet["sim_s"] / substeps  # load per substep of a frame without contact
    load = first
    for _ in range(5):
        rest_s = load - substeps * one_s  # load independent of substeps: patches, contact
        wanted = int(min((AIM * LIVE - rest_s) / one_s, 0.97 * substeps * AIM * LIVE / load))
        substeps = max(SUBSTEPS_LEAST, wanted if rest_s < 0.9 * AIM * LIVE else substeps // 2)
        share, own_Hz, Hz = heavier(w, frame / substeps)
        if share > (MASS_GOOD if coarsens else MASS_MOST):
            break
        load = figures_of(w, None, frame / substeps)["busiest_second_s"]
        if load <= LIVE:
            return frame / substeps, share, own_Hz, Hz, load
        if substeps == SUBSTEPS_LEAST:
            break
    if coarsens:
        raise Coarser(f"{first:.2g} s of a core a second are too much for real time, and more mass takes it to {load:.2g} s alone")
    return None


def live(w, coarsens):
    """Changes the scene until half a core computes it in real time: by mass scaling of small tetrahedra, else with a coarser mesh."""
    f = figures_of(w, 3)
    if f["busiest_second_s"] <= LIVE:
        f = figures_of(w)
    load, scene = f["busiest_second_s"], w.path("organ.yaml")
    if load <= LIVE:
        return f"{load:.2g} s of a core a second"
    if w.yours():
        w.warn(f"{scene}: warning: its busiest second takes {load:.2g} s of a core; you have edited it, so it is not changed; add time.step with time.mass_scaling, or use a coarser mesh")
        return f"{load:.2g} s of a core a second, {TOO_MUCH}"
    found = lighter(w, f, coarsens)
    if not found:
        w.warn(f"{scene}: warning: its busiest second takes {load:.2g} s of a core, and neither mass scaling nor a coarser mesh suffices for real time; use softer regions, or fewer tetrahedra")
        return f"{load:.2g} s of a core a second, {TOO_MUCH}"
    step_s, share, own_Hz, Hz, after = found
    what = make_heavier(w, step_s, share, own_Hz, Hz)
    if share > 3 * MASS_GOOD:
        w.warn(f"{scene}: warning: {what}: its oscillations are slower; a coarser mesh or softer regions would need less")
    return f"{after:.2g} s of a core a second, was {load:.2g}: {what}"


def press(cuts, w):
    figures = w.path("press.json")
    w.call("tm-sim", w.path("organ.yaml"), "--lockstep", "--record", w.path("press.lcm"), "--csv", w.path("force.csv"), "--json", figures)
    f = json.loads(figures.read_text())
    peak, removed, load = f["force_N"]["peak"], f.get("tets_removed", 0), f["busiest_second_s"]
    if not peak > 1e-3:
        raise Stop(f"{w.path('organ.yaml')}: the hand felt nothing; move the tip deeper ('above: -5 mm'); tm-scene check prints its distance", 1)
    if cuts and not removed:
        w.warn(f"{w.path('organ.yaml')}: warning: the cautery cut nothing; move its tip deeper while its pedal is down")
    return f"peak {peak:.3g} N" + (f", {removed} tetrahedra cut" if cuts else "") + f", {load:.2g} s of a core in the busiest second"


def run(a, kind):
    w = Work(a)
    up = a.up or ("-y" if kind == "image" else "z")
    w.of = 6 if a.no_video else 7
    wanted = [digest(a.source), kind, a.unit, a.size, a.budget, a.label, a.smooth] + (["bodies"] if a.bodies else [])
    of = hashlib.sha256(json.dumps(wanted).encode()).hexdigest()
    if w.done.get("coarser", {}).get("of") != of or a.again:
        w.done["coarser"] = {"of": of, "share": 1.0}
    a.out.mkdir(parents=True, exist_ok=True)
    coarsenings = 0
    while True:
        share, w.number = w.done["coarser"]["share"], 0
        try:
            w.stage("mesh", "tetrahedra", wanted + [share], ["organ.msh", "mesh.json"], lambda: mesh(a, kind, share, w))
            tets = digest(w.path("organ.msh"))
            w.stage("scene", "scene", [tets, up, a.no_cut, w.yours()] + a.bodies * ["bodies"], ["organ.yaml", "check.txt"], lambda: scene(a, up, w))
        except BaseException:
            if w.ours:
                for left in a.out.iterdir():
                    left.unlink()
                a.out.rmdir()
            raise
        try:
            w.stage("live", "half a core, live", [tets, a.no_cut, w.yours()], ["live.json"], lambda: live(w, kind != "mesh" and coarsenings < COARSENINGS))
            break
        except Coarser as too_fine:
            coarsenings += 1
            w.done["coarser"]["share"] = share * COARSER
            w.say(f"    {too_fine}: meshed anew with {100 * share * COARSER:.2g} % of the tetrahedra")
    both = [tets, digest(w.path("organ.yaml"))]
    w.stage("rest", "check at rest", [both, up], ["rest.json", "rest.vtk"], lambda: rest(up, w))
    cuts = "\ncut:" in w.path("organ.yaml").read_text()
    w.stage("press", f"a press{' and a cut' * cuts}, felt", both, ["press.lcm", "force.csv", "press.json"], lambda: press(cuts, w))
    eye = ["--up", up] if up != "z" else []
    regions = len(json.loads(w.path("mesh.json").read_text())["regions"])
    w.stage("picture", "picture", both + eye, ["organ.png"], lambda: w.call("tm-view", w.path("organ.yaml"), "--png", w.path("organ.png"), *(["--through", "0.5", "--no-supports"] if regions > 1 else []), *eye) and "organ.png")
    if not a.no_video:
        w.stage("video", "video", [digest(w.path("press.lcm")), a.video] + eye, ["organ.mp4"], lambda: w.call("tm-view", w.path("press.lcm"), "--scene", w.path("organ.yaml"), "--video", w.path("organ.mp4"), "--fps", "25", "--size", a.video, *eye, *(["--through", "0.5", "--no-supports"] if regions > 1 else [])) and "organ.mp4")
    felt = TOO_MUCH not in w.done["live"]["said"]
    w.say(f"{a.out}: look at organ.{'png' if a.no_video else 'mp4'}; edit organ.yaml and run this again" + (f"; feel it: tm-session {w.path('organ.yaml')} --play" if felt else ""))


def check(a):
    if not a.source.is_file():
        raise Stop(f"{a.source}: {'a folder; name a file' if a.source.is_dir() else 'no such file; name an image, a surface or a mesh'}")
    kind = kind_of(a.source)
    if kind == "surface" and not a.unit:
        raise Stop(f"{a.source}: a surface file has no unit; add --unit mm (usual for scanners and segmentation tools), or m")
    if kind == "image" and a.unit:
        raise Stop("--unit: an image contains its unit; leave it out")
    for option, value in (("--budget", a.budget), ("--label", a.label), ("--smooth", a.smooth)):
        if value and kind != "image":
            raise Stop(f"{option} applies only to images; leave it out")
    for label in a.label:
        if any(ord(c) < 32 or ord(c) == 127 for c in label):
            raise Stop(f"--label {label!r}: the name contains a control character; use letters and digits")
    if a.size and kind == "mesh":
        raise Stop("--size: this is a mesh already; leave it out, or refine the mesh by tm-mesh refine")
    if a.out.exists() and not a.out.is_dir():
        raise Stop(f"{a.out}: is a file; name a folder")
    if not a.no_video and not shutil.which("ffmpeg"):
        raise Stop("ffmpeg is not installed; apt-get install ffmpeg, or add --no-video")
    return kind


def main():
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    a = arguments()
    a.source, a.out = plain(a.source), plain(a.out)
    try:
        run(a, check(a))
    except Stop as stop:
        print(f"{stop}" if str(stop).startswith(str(a.source)) else f"tm-organ: {stop}", file=sys.stderr)
        return stop.code
    except OSError as error:
        print(f"tm-organ: {error}; check the path and the disk", file=sys.stderr)
        return 2 if isinstance(error, PermissionError) else 1
    except KeyboardInterrupt:
        print("tm-organ: interrupted; the same command continues from here", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
