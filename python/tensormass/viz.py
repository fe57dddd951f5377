"""Pictures of a world or a scene in PyVista (pip install 'tensormass[viz]')."""
from __future__ import annotations

from typing import Any, Optional, Union

import numpy as np

from .scene import Scene
from .world import World


def _pyvista() -> Any:
    try:
        import pyvista
    except ImportError as error:
        raise ImportError("showing needs PyVista; pip install 'tensormass[viz]'") from error
    return pyvista


def surface(of: Union[World, Scene]) -> Any:
    """Returns a pyvista.PolyData of the current surface, with the array "displacement_mm". Its points are all vertices of the mesh."""
    mesh = of.mesh if isinstance(of, Scene) else of.tissue.mesh
    triangles = (of if isinstance(of, Scene) else of.tissue).surface.triangles
    faces = np.column_stack([np.full(len(triangles), 3), triangles]).ravel()
    data = _pyvista().PolyData(mesh.rest_m + of.u_m, faces)
    data["displacement_mm"] = 1e3 * np.linalg.norm(of.u_m, axis=1)
    return data


def _tools(plotter: Any, scene: Scene) -> None:
    for i, instrument in enumerate(scene.instruments):
        line = _pyvista().Line(scene.pose(i).tip_m, instrument.trocar_m)
        plotter.add_mesh(line.tube(radius=instrument.radius_m), color="lightsteelblue", name=f"tool{i}")


def _draw(plotter: Any, scene: Scene) -> None:
    plotter.add_mesh(surface(scene), scalars="displacement_mm", name="tissue", cmap="viridis", smooth_shading=True)
    _tools(plotter, scene)


def picture(scene: Scene, path: str) -> None:
    """Writes a picture of the scene's current state to an image file."""
    plotter = _pyvista().Plotter(off_screen=True)
    _draw(plotter, scene)
    plotter.screenshot(path)
    plotter.close()


def play(scene: Scene, seconds: Optional[float] = None) -> None:
    """Runs the scene in a window."""
    plotter = _pyvista().Plotter()
    _draw(plotter, scene)
    plotter.show(interactive_update=True, auto_close=False)

    def each(now: Scene) -> None:
        _draw(plotter, now)
        plotter.update()

    scene.run(seconds, each)
    plotter.show()
