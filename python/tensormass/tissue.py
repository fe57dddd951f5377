"""Materials, and tissue: a mesh with materials."""
from __future__ import annotations

import ctypes
from typing import Any, Dict, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from . import _bind as c
from ._core import ArgumentError, Bytes, Floats, Ints, Object, address, call, choice, fields, floats, ints, lib, view
from .mesh import Mesh

PRECISION = {"double": c.TM_DOUBLE, "single": c.TM_SINGLE}
LAW: Dict[str, int] = {}  # those that the library names
while lib.tm_law_name(len(LAW)):
    LAW[lib.tm_law_name(len(LAW)).decode()] = len(LAW)
EFFECT = {name[len("TM_REGION_"):].lower(): getattr(c, name) for name in dir(c) if name.startswith("TM_REGION_")}
FORM = {"best": c.TM_FORCE_BEST, "plain": c.TM_FORCE_PLAIN}


class Material:
    """Constants of linear, transversely isotropic tissue (docs/physics.md, eq. 1), and a law for large strains (with_law). Made by one of the class
    methods.

    Pa; density_kg_m3 > 0; damping_1_s >= 0, the rate d of gamma_i = d m_i. MaterialError: constants that are not positive definite.
    """

    def __init__(self, lambda_Pa: float, mu_Pa: float, dlambda_Pa: float = 0.0, dmu_Pa: float = 0.0, beta_Pa: float = 0.0,
                 density_kg_m3: float = 1000.0, damping_1_s: float = 0.0) -> None:
        self._struct = c.tm_material(lambda_Pa, mu_Pa, dlambda_Pa, dmu_Pa, beta_Pa, density_kg_m3, damping_1_s)
        call(lib.tm_material_check, ctypes.byref(self._struct))

    @classmethod
    def _made(cls, function: Any, constants: Sequence[float], density_kg_m3: float, damping_1_s: float) -> "Material":
        made = cls.__new__(cls)
        made._struct = c.tm_material()
        call(function, *constants, ctypes.byref(made._struct))
        made._struct.density_kg_m3, made._struct.damping_1_s = density_kg_m3, damping_1_s
        call(lib.tm_material_check, ctypes.byref(made._struct))
        return made

    @classmethod
    def young(cls, young_Pa: float, poisson: float, density_kg_m3: float = 1000.0, damping_1_s: float = 0.0) -> "Material":
        """Isotropic, from Young's modulus and Poisson's ratio."""
        return cls._made(lib.tm_material_young, (young_Pa, poisson), density_kg_m3, damping_1_s)

    @classmethod
    def lame(cls, lambda_Pa: float, mu_Pa: float, density_kg_m3: float = 1000.0, damping_1_s: float = 0.0) -> "Material":
        """Isotropic, from Lame's coefficients."""
        return cls._made(lib.tm_material_lame, (lambda_Pa, mu_Pa), density_kg_m3, damping_1_s)

    @classmethod
    def paper(cls, lambda_T_Pa: float, mu_T_Pa: float, lambda_L_Pa: float, mu_L_Pa: float, density_kg_m3: float = 1000.0,
              damping_1_s: float = 0.0) -> "Material":
        """The paper's four constants, beta = -(dlambda + 2 dmu)."""
        return cls._made(lib.tm_material_paper, (lambda_T_Pa, mu_T_Pa, lambda_L_Pa, mu_L_Pa), density_kg_m3, damping_1_s)

    @classmethod
    def five(cls, lambda_T_Pa: float, mu_T_Pa: float, lambda_L_Pa: float, mu_L_Pa: float, beta_Pa: float, density_kg_m3: float = 1000.0,
             damping_1_s: float = 0.0) -> "Material":
        """Five constants; beta is independent."""
        return cls._made(lib.tm_material_five, (lambda_T_Pa, mu_T_Pa, lambda_L_Pa, mu_L_Pa, beta_Pa), density_kg_m3, damping_1_s)

    @classmethod
    def engineering(cls, E_L_Pa: float, E_T_Pa: float, nu_LT: float, nu_TT: float, G_L_Pa: float, density_kg_m3: float = 1000.0,
                    damping_1_s: float = 0.0) -> "Material":
        """Five engineering constants; nu_LT = -eps_T/eps_L under tension along the fibre, nu_TT in the cross plane."""
        return cls._made(lib.tm_material_engineering, (E_L_Pa, E_T_Pa, nu_LT, nu_TT, G_L_Pa), density_kg_m3, damping_1_s)

    @staticmethod
    def laws() -> Dict[str, Tuple[str, ...]]:
        """Returns the names of all laws, each with those of its constants, as in scenes."""
        def names(law: int) -> Tuple[str, ...]:
            found = (lib.tm_law_constant_at(law, i) for i in range(c.TM_LAW_CONSTANTS))
            return tuple(c.tm_law_constant.from_address(constant).name.decode() for constant in found if constant)
        return {name: names(law) for name, law in LAW.items()}

    def with_law(self, law: str, stretch_max: float = 0.0, constants: Sequence[float] = ()) -> "Material":
        """Returns a copy with this law: small strains keep the elastic constants, large ones follow the law (docs/nonlinear-laws.md).

        law: linear, neo-hooke, ..., a name of laws(). stretch_max: largest uniaxial stretch that follows the law, 0: 1.6, holzapfel 1.8. constants: values of
        laws()[law], in its order, Pa or without unit. MaterialError: the violated condition.
        """
        made = Material.__new__(Material)
        made._struct = type(self._struct).from_buffer_copy(self._struct)
        given = np.zeros(c.TM_LAW_CONSTANTS)
        given[: len(constants)] = constants
        call(lib.tm_material_set_law, ctypes.byref(made._struct), choice(law, LAW, "law"), address(given), stretch_max)
        return made

    @property
    def law(self) -> str:
        """Name of the law, as for with_law."""
        return lib.tm_law_name(self._struct.law).decode()

    stretch_max: float = property(lambda self: self._struct.stretch_max)  # type: ignore[assignment]
    lambda_Pa: float = property(lambda self: self._struct.lambda_Pa)  # type: ignore[assignment]
    mu_Pa: float = property(lambda self: self._struct.mu_Pa)  # type: ignore[assignment]
    dlambda_Pa: float = property(lambda self: self._struct.dlambda_Pa)  # type: ignore[assignment]
    dmu_Pa: float = property(lambda self: self._struct.dmu_Pa)  # type: ignore[assignment]
    beta_Pa: float = property(lambda self: self._struct.beta_Pa)  # type: ignore[assignment]
    density_kg_m3: float = property(lambda self: self._struct.density_kg_m3)  # type: ignore[assignment]
    damping_1_s: float = property(lambda self: self._struct.damping_1_s)  # type: ignore[assignment]

    @property
    def isotropic(self) -> bool:
        """True if the material needs no fibre."""
        return bool(lib.tm_material_is_isotropic(ctypes.byref(self._struct)))

    def voigt(self, fibre: Any = None) -> Floats:
        """Returns the elasticity matrix (6, 6), Pa (engineering shears xx yy zz yz xz xy), for the unit fibre (3,); None if isotropic."""
        if fibre is None and not self.isotropic:
            raise ArgumentError("fibre: this material has a direction; give a unit vector", c.TM_ERR_ARGUMENT)
        out = np.zeros((6, 6))
        along = None if fibre is None else floats(fibre, (3,), "fibre")
        lib.tm_material_voigt(ctypes.byref(self._struct), address(along), address(out))
        return out

    def __repr__(self) -> str:
        values = ", ".join(f"{n}={getattr(self, n):g}" for n in fields(c.tm_material) if n not in ("law", "law_constant", "stretch_max"))
        return f"Material({values})" + ("" if self.law == "linear" else f".with_law({self.law!r}, {self.stretch_max:g})")


class Surface(NamedTuple):
    """Surface of the active tetrahedra. `triangles` (S, 3) vertices, normals outward; `faces` (S,) the triangles' persistent ids, 4*tet + local vertex."""

    triangles: Ints
    faces: Ints
    revision: int  #: increases by one with every change


def surface_of(owner: object, found: Any) -> Surface:
    """Returns a tm_surface_view as arrays."""
    return Surface(view(owner, found.triangle, (found.count, 3), "int32"), view(owner, found.face, (found.count,), "int32"), found.revision)


class Deformation(NamedTuple):
    """Deformation of the active tetrahedra, F = 1 + grad u."""

    min_det: float  #: smallest det F; inverted at 0 and below
    min_det_tet: int
    inverted: int  #: tetrahedra with det F <= 0
    nonlinear_strain: float  #: largest |grad u^T grad u| / 2, which the linear law neglects
    nonlinear_tet: int
    nonlinear_share: float  #: share of the volume where that is above 0.1
    doubt: str  #: what to do, as a sentence; empty if there is no doubt


def deformation_of(tissue: Any, found: Any) -> Deformation:
    """Returns the library's figures as a Deformation."""
    sentence = ctypes.create_string_buffer(c.TM_ERROR_MESSAGE_MAX)
    lib.tm_tissue_check_deformation(tissue, ctypes.byref(found), sentence)
    return Deformation(found.min_det, found.min_det_tet, found.inverted, found.nonlinear_strain, found.nonlinear_tet, found.nonlinear_share,
                       sentence.value.decode())


class Tissue(Object):
    """Assembled tissue of a mesh with materials: stiffness tensors, lumped masses, surface. Only cutting changes it.

    materials: one, or one a material number. region_material: (R,) material of each region, None: region i has material i (one material: all). fibres: (T,
    3) unit vectors, copied; None if every material is isotropic. cuttable: allocate the memory that cutting needs. alive: (T,) bool, build without the
    others. precision: of the stored edge tensors (with rotation also of its correction), or of the stresses of a nonlinear law, "double" or "single" (for supported tissue). form: of the force loop, "best" or "plain" (bit-identical
    on every machine). strain_smoothing: reduces locking near Poisson's ratio 0.5 (docs/strain-smoothing.md); a number is the share of the shear that is
    averaged too (True: 0.4; with rotation 0, the only one). rotation: above 0 (0.02), World.add_rotation makes tetrahedra corotational that rotate more
    than this. region_effects: for each region the names of those of rotation, smoothing and viscosity that act in it, such as [("rotation",), ()];
    None: all act in all regions. Regions that differ here must not share a vertex (docs/bodies.md).
    """

    _kept: Tuple[Any, ...]  # arrays that the definition points to

    def __init__(self, mesh: Mesh, materials: Union[Material, Sequence[Material]], *, region_material: Any = None, fibres: Any = None,
                 precision: str = "double", form: str = "best", cuttable: bool = False, alive: Any = None,
                 strain_smoothing: Union[bool, float] = False, rotation: float = 0.0,
                 region_effects: Optional[Sequence[Sequence[str]]] = None) -> None:
        self._fill(mesh, materials, region_material, fibres, strain_smoothing, rotation)
        if region_effects is not None:
            flags = np.array([sum(choice(name, EFFECT, "region_effects") for name in set(names)) for names in region_effects], np.uint8)
            if flags.shape != (mesh.region_count,):
                raise ArgumentError(f"region_effects: has {len(flags)} regions; give {mesh.region_count}", c.TM_ERR_ARGUMENT)
            self._definition.region_effects = flags.ctypes.data
            self._kept = (*self._kept, flags)
        self._definition.precision = choice(precision, PRECISION, "precision")
        self._definition.form = choice(form, FORM, "form")
        self._definition.cuttable = cuttable
        living = None if alive is None else np.ascontiguousarray(alive, np.uint8)
        if living is not None and living.shape != (mesh.tet_count,):
            raise ArgumentError(f"alive: has shape {living.shape}; give ({mesh.tet_count},)", c.TM_ERR_ARGUMENT)
        self._definition.alive = None if living is None else living.ctypes.data
        self._build([mesh])

    def _fill(self, mesh: Mesh, materials: Union[Material, Sequence[Material]], region_material: Any, fibres: Any,
              strain_smoothing: Union[bool, float] = False, rotation: float = 0.0) -> None:
        self._mesh = mesh
        several = [materials] if isinstance(materials, Material) else list(materials)
        material = (c.tm_material * len(several))(*[m._struct for m in several])
        if region_material is None and len(several) == 1:
            region_material = np.zeros(mesh.region_count, np.int32)
        region = None if region_material is None else ints(region_material, (mesh.region_count,), "region_material")
        fibre = None if fibres is None else floats(fibres, (mesh.tet_count, 3), "fibres")
        definition = lib.tm_tissue_def_default()
        definition.mesh = mesh._pointer
        definition.material_count, definition.material = len(several), ctypes.addressof(material)
        definition.region_material = None if region is None else region.ctypes.data
        definition.fibre = None if fibre is None else fibre.ctypes.data
        definition.strain_smoothing, definition.rotation = strain_smoothing is not False, rotation
        if not isinstance(strain_smoothing, bool):
            definition.smoothed_shear_share = strain_smoothing
        elif rotation > 0:
            definition.smoothed_shear_share = 0.0
        self._definition, self._kept = definition, (material, region, fibre)

    def _build(self, parents: Sequence[Object]) -> None:
        pointer = ctypes.c_void_p()
        call(lib.tm_tissue_create, ctypes.byref(self._definition), ctypes.byref(pointer))
        self._own(pointer, lib.tm_tissue_destroy, parents)

    @classmethod
    def _borrow(cls, pointer: int, mesh: Mesh, owner: Object) -> "Tissue":
        tissue = cls.__new__(cls)
        tissue._mesh = mesh
        tissue._own(pointer, None, [owner])
        return tissue

    @property
    def mesh(self) -> Mesh:
        """Mesh that it was made from."""
        return self._mesh

    @property
    def mass_kg(self) -> Floats:
        """(V,) lumped masses, kg; 0: in no active tetrahedron."""
        return view(self, lib.tm_tissue_mass_kg(self), (self._mesh.vertex_count,))

    @property
    def damping_kg_s(self) -> Floats:
        """(V,) gamma, sum of d times lumped mass, kg/s."""
        return view(self, lib.tm_tissue_damping_kg_s(self), (self._mesh.vertex_count,))

    @property
    def alive(self) -> Bytes:
        """(T,) 1: active, 0: removed."""
        return view(self, lib.tm_tissue_alive(self), (self._mesh.tet_count,), "uint8")

    @property
    def alive_count(self) -> int:
        """Number of active tetrahedra."""
        return int(lib.tm_tissue_alive_count(self))

    @property
    def bytes(self) -> int:
        """Memory it uses, bytes."""
        return int(lib.tm_tissue_bytes(self))

    @property
    def surface(self) -> Surface:
        """Surface that can be touched; get it again after a cut."""
        return surface_of(self, lib.tm_tissue_surface(self))

    def _displacements(self, u_m: Any) -> Floats:
        return floats(u_m, (self._mesh.vertex_count, 3), "u_m")

    def force(self, u_m: Any) -> Floats:
        """Returns the internal force -K u (V, 3), N, of displacements (V, 3), m."""
        u = self._displacements(u_m)
        out = np.empty_like(u)
        lib.tm_tissue_force(self, address(u), address(out))
        return out

    def energy(self, u_m: Any) -> float:
        """Returns the stored energy u.K u / 2, J."""
        u = self._displacements(u_m)
        return float(lib.tm_tissue_energy(self, address(u)))

    def deformation(self, u_m: Any) -> Deformation:
        """Returns the deformation by displacements (V, 3), m: inverted tetrahedra, and strains that the linear law neglects."""
        u = self._displacements(u_m)
        return deformation_of(self, lib.tm_tissue_deformation(self, address(u)))

    def vertex_tensor(self, vertex: int) -> Floats:
        """Returns the tensor K_kk (3, 3), N/m."""
        K = np.zeros((3, 3))
        lib.tm_tissue_vertex_tensor(self, vertex, address(K))
        return K

    def edge_tensor(self, edge: int) -> Floats:
        """Returns the tensor K_kl (3, 3) with k < l, N/m."""
        K = np.zeros((3, 3))
        lib.tm_tissue_edge_tensor(self, edge, address(K))
        return K

    def critical_step(self) -> Tuple[float, int]:
        """Returns (guaranteed critical step, s; tetrahedron that sets it)."""
        tet = ctypes.c_int32(-1)
        return float(lib.tm_critical_step_guaranteed(self, ctypes.byref(tet))), tet.value

    def critical_step_estimate(self, fixed: Any = None, tolerance: float = 1e-3, max_iterations: int = 20000) -> float:
        """Estimates the critical step 2/omega_max of the assembled system by power iteration, s: an upper estimate. fixed: (V, 3) bool, constrained
        components."""
        mask = None if fixed is None else np.ascontiguousarray(fixed, np.uint8)
        if mask is not None and mask.shape != (self._mesh.vertex_count, 3):
            raise ArgumentError(f"fixed: has shape {mask.shape}; give ({self._mesh.vertex_count}, 3)", c.TM_ERR_ARGUMENT)
        step = ctypes.c_double()
        call(lib.tm_critical_step_estimate, self, address(mask), tolerance, max_iterations, ctypes.byref(step))
        return step.value

    def cut(self, tets: Any) -> Ints:
        """Removes tetrahedra (n,) and others that must go to keep the mesh manifold; returns the (m,) removed ones. Needs cuttable=True."""
        listed = ints(tets, (-1,), "tets")
        removed = np.empty(self._mesh.tet_count, np.int32)
        count = lib.tm_cut_remove(self, address(listed), len(listed), address(removed), len(removed))
        return removed[:count].copy()
