"""tensormass: simulation of soft tissue with haptic feedback. Tensor/mass finite elements, explicit dynamics, contact, cutting. SI units everywhere.

    import tensormass as tm

    mesh = tm.Mesh.block((0.06, 0.06, 0.03), (12, 12, 6))
    tissue = tm.Tissue(mesh, tm.Material.young(5e3, 0.45, density_kg_m3=1060, damping_1_s=40))
    world = tm.World(tissue)
    world.add_support(mesh.near((0, 0, 0), (0, 0, 1)))
    contact = world.add_contact([tm.Instrument(trocar_m=(0.03, 0.03, 0.15), tip_m=(0.03, 0.03, 0.035))])
    reaction, = contact.frame([tm.Pose((0.03, 0.03, 0.028))], substeps=2000)
    reaction.force_N

Unless stated otherwise, arrays are views of the library's memory and keep it alive. Errors raise a tensormass.Error with the library's message.
See docs/python.md.
"""
from ._core import (
    ArgumentError, ContractError, ConvergenceError, DeformationWarning, Error, ExcludedError, FileError, LimitError, MaterialError, MeshError, NoMemoryError, SceneWarning,
    StepError, SupportError, UnstableError, lib,
)
from .bodies import Tie, Ties, Touch, TouchReport
from .controller import Controller, Extrapolator, controller_patch, parameters, sample
from .instruments import Contact, Cut, Friction, Grasp, FrictionStation, Instrument, Pose, Reaction, tip_force
from .log import Channel, read_log
from .mesh import Mesh, Quality, memory_in_use, read_fibres
from .solve import ComplianceFactor, Precomputed, Problem, Report, solve_static
from .patch import Patch, PatchBuilder, PatchSolver
from .model import Model, Timing
from .scene import Body, Scene
from .state import Settled, Stage
from .tissue import Deformation, Material, Surface, Tissue
from .world import World

__version__: str = lib.tm_version().decode()
__all__ = [
    "ArgumentError", "Body", "Channel", "Contact", "ContractError", "Controller", "ConvergenceError", "Cut", "Deformation", "DeformationWarning", "Error", "ExcludedError", "Extrapolator",
    "ComplianceFactor", "FileError", "Friction", "Grasp", "FrictionStation", "Instrument", "LimitError", "Material", "MaterialError", "Mesh", "MeshError", "Model", "Timing", "NoMemoryError",
    "Patch", "PatchBuilder", "PatchSolver", "Pose", "Precomputed", "Problem", "Quality", "Reaction", "Report", "Scene", "SceneWarning", "Settled",
    "Stage", "StepError", "SupportError", "Surface", "Tie", "Ties", "Tissue", "Touch", "TouchReport", "UnstableError", "World", "controller_patch", "memory_in_use", "parameters",
    "read_fibres", "read_log", "sample", "solve_static", "tip_force",
]
