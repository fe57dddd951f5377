"""python -m tensormass SCENE: runs a scene and prints its figures, or shows it in PyVista (--show, tensormass[viz])."""
from __future__ import annotations

import argparse
import sys
import warnings
from typing import List, Optional

import numpy as np

from . import Error, Scene, SceneWarning, __version__


def _arguments(given: Optional[List[str]]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tensormass", description="Runs a scene and shows it: a line a frame and instrument, or a picture.")
    parser.add_argument("scene", help="a scene file (docs/scene-reference.md)")
    parser.add_argument("--seconds", type=float, help="how long; instead of the scene's")
    parser.add_argument("--set", action="append", default=[], metavar="PATH=VALUE", help="override a value of the scene; may be repeated")
    parser.add_argument("--unset", action="append", default=[], metavar="PATH", help="leave this key of the scene out")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="a line after one frame in so many [1]")
    parser.add_argument("--show", action="store_true", help="in a window (pip install 'tensormass[viz]')")
    parser.add_argument("--picture", metavar="FILE", help="of the last frame, .png (pip install 'tensormass[viz]')")
    parser.add_argument("--version", action="version", version=f"tensormass {__version__}")
    return parser.parse_args(given)


def _line(scene: Scene) -> str:
    parts = [f"{scene.time_s:8.3f} s  {scene.alive_count:7d} tets  {1e3 * float(np.abs(scene.u_m).max()):8.3f} mm at most"]
    for i, instrument in enumerate(scene.instruments):
        reaction = scene.reaction(i)
        force = ", ".join(f"{f:7.3f}" for f in reaction.force_N)
        parts.append(f"{instrument.mode} [{force}] N" + (f" {' '.join(reaction.flag_names)}" if reaction.flags else ""))
    return "  ".join(parts)


def main(given: Optional[List[str]] = None) -> int:
    """Returns 0, or 2 after bad input, as the programs do."""
    options = _arguments(given)
    sets = {**{key: value for key, _, value in (s.partition("=") for s in options.set)}, **{key: None for key in options.unset}}
    warnings.simplefilter("always", SceneWarning)
    warnings.showwarning = lambda message, *_, **__: print(message, file=sys.stderr)
    try:
        scene = Scene(options.scene, sets)
        print(f"{scene.title or options.scene}: {scene.model} model, {scene.mesh.tet_count} tetrahedra, {scene.substeps} substeps of "
              f"{1e6 * scene.dt_s:.0f} us a frame")
        if options.show:
            from .viz import play

            play(scene, options.seconds)
        else:
            every = max(1, options.every)
            scene.run(options.seconds, lambda s: print(_line(s), flush=True) if s.frames % every == 0 else None)
        if options.picture:
            from .viz import picture

            picture(scene, options.picture)
    except Error as error:
        print(error, file=sys.stderr)
        return 2 if error.status in ("TM_ERR_ARGUMENT", "TM_ERR_FILE", "TM_ERR_MESH", "TM_ERR_MATERIAL", "TM_ERR_SUPPORT", "TM_ERR_EXCLUDED") else 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
