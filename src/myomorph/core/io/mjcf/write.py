"""A model whose joints and muscles MuJoCo can hold, as MJCF that MuJoCo 3 and 4 read."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import ArrayLike

from myomorph.core.io.mesh import mesh_files, write_obj
from myomorph.core.io.mjcf.bodies import new_name
from myomorph.core.io.mjcf.couplings import Cam, curve_text
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import BadModel, quoted
from myomorph.core.model.functions import PiecewisePolynomial
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Axis, Body, Coupler, Joint, Loop, Mesh, Model
from myomorph.core.model.paths import Muscle, PathPoint, TendonWrap, WrapObject
from myomorph.core.model.spatial import Transform, quaternion_from_rotation
from myomorph.core.model.surface import Surface

MASSLESS = 1e-9  # Mass of a body that moves and has none: MuJoCo wants some [kg].
SMALLEST_INERTIA = 1e-12  # [kg m^2]
SMALLEST_SHARE = (
    1e-6  # Of a body's largest principal moment: MuJoCo takes no smaller ones for sure.
)
# Of the slides of points that move: what lets their constraints carry a muscle's force [kg].
ARMATURE = 0.01
TIMESTEP = 0.001  # [s]

STIFFEST = {"solref": f"{2.0 * TIMESTEP:g} 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
"""Constraints as stiff as MuJoCo allows at this time step."""

DEGREE = 4
MAX_HALF_LENGTH = 0.05  # Of a cylinder that is drawn [m].
HIDDEN = "5"  # Group of sites, geoms and tendons that MuJoCo's viewer does not draw at first.

MUSCLE_KEYS = ("force", "scale", "lmin", "lmax", "vmax", "fpmax", "fvmax")
MARKERS = "markers"  # Name of the tuple of sites that are markers.


@dataclass(frozen=True, eq=False)
class MjcfDocument:
    """A document that MuJoCo reads.

    Attributes
    ----------
    root : its outermost element
    meshes : files written into `folder` for it, by `Mesh.file`
    folder : name of the folder beside it
    warnings : what was left out, one line each
    """

    root: etree._Element
    meshes: dict[str, str]
    folder: str
    warnings: tuple[Message, ...]


def mjcf_document(
    model: Model,
    path: str | os.PathLike[str],
    cams: Sequence[Cam] = (),
    surfaces: dict[str, Surface] | None = None,
) -> MjcfDocument:
    """Convert a model to MJCF; its meshes are written into a folder beside the path.

    Parameters
    ----------
    model : each axis moves by its coordinate minus the default, muscles are MuJoCo's
    path : where the document is to be written
    cams : of the dependent coordinates whose function is no polynomial of degree four
    surfaces : meshes by `Mesh.file` [m]; those without one are left out

    Returns
    -------
    the document, which is not written yet

    Raises
    ------
    BadFile : a mesh cannot be written
    BadModel : a muscle is not MuJoCo's
    """
    writer = _Writer(model, Path(path), surfaces or {})
    root = writer.document(cams)
    return MjcfDocument(
        root=root, meshes=writer.files, folder=writer.folder, warnings=tuple(writer.warnings)
    )


def text(values: ArrayLike) -> str:
    """Write numbers as MJCF has them, with all their digits.

    Parameters
    ----------
    values : one number, or several (n,)
    """
    numbers = np.atleast_1d(np.asarray(values, dtype=np.float64))
    return " ".join(repr(float(number)) for number in numbers)


class _Writer:
    def __init__(self, model: Model, path: Path, surfaces: dict[str, Surface]):
        self.model = model
        self.path = path
        self.surfaces = surfaces
        self.warnings: list[Message] = []
        self.elements: dict[str, etree._Element] = {}
        self.sites = set[str]()
        self.geoms = set[str]()
        self.meshes = set[str]()
        self.tendons = set[str]()
        self.actuators = set[str]()
        self.placed: dict[tuple[str, tuple[float, ...]], str] = {}
        self.files: dict[str, str] = {}
        self.folder = f"{path.stem}_meshes"
        self.parents = {joint.parent for joint in model.joints}
        self.coordinates = {coordinate.name: coordinate for coordinate in model.coordinates}

    def document(self, cams: Sequence[Cam]) -> etree._Element:
        """Write all parts of the model; each part adds to the warnings what it leaves out.

        Parameters
        ----------
        cams : of dependent coordinates

        Returns
        -------
        the outermost element
        """
        root = etree.Element("mujoco", model=self.model.name)
        put(
            root,
            "compiler",
            angle="radian",
            inertiafromgeom="false",
            autolimits="false",
            meshdir=self.folder,
        )
        put(
            root,
            "option",
            gravity=text(self.model.gravity),
            timestep=f"{TIMESTEP:g}",
            integrator="implicitfast",
        )
        defaults = put(root, "default")
        put(defaults, "geom", contype="0", conaffinity="0", group="1", rgba="0.85 0.82 0.75 1")
        put(defaults, "site", size="0.003", group="4")
        put(defaults, "tendon", width="0.003", rgba="0.75 0.15 0.15 1")
        put(defaults, "equality", **STIFFEST)
        self.assets = put(root, "asset")
        self.elements[GROUND] = put(root, "worldbody")
        for mesh in self.model.ground_meshes:
            self._mesh(GROUND, mesh)
        joints = {joint.child: joint for joint in self.model.joints}
        for body in self.model.bodies:
            self._body(body, joints[body.name])
        self._surfaces_and_sites()
        self.tendon = put(root, "tendon")
        self.equality = put(root, "equality")
        self.actuator = put(root, "actuator")
        for muscle in self.model.muscles:
            self._muscle(muscle)
        self._couplings(cams)
        for loop in self.model.loops:
            self._loop(loop)
        self._motors()
        self._curves(root, cams)
        markers = put(put(root, "custom"), "tuple", name=MARKERS)
        for name in self.marker_sites:
            put(markers, "element", objtype="site", objname=name, prm="0")
        if not self.marker_sites:
            root.remove(markers.getparent())
        self._left_out()
        return root

    def _body(self, body: Body, joint: Joint) -> None:
        """Write a body with its inertia, made proper where needed, its joint and its meshes."""
        frame = joint.parent_frame
        if joint.kind == "free":
            start = [self.coordinates[name].default for name in joint.coordinates[:3]]
            frame = Transform(joint.child_frame.rotation.T, np.array(start))
        element = put(self.elements[joint.parent], "body", name=body.name, **pose(frame))
        self.elements[body.name] = element
        moves = bool(joint.axes)
        if body.mass > 0.0 or moves:
            inertia = proper_inertia(body.inertia) + (
                SMALLEST_INERTIA * np.eye(3) if not body.inertia.any() else 0.0
            )
            thin = with_least_moments(inertia)
            full = thin[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            mass = body.mass or MASSLESS
            center = body.mass_center
            put(element, "inertial", pos=text(center), mass=text(mass), fullinertia=text(full))
            if np.abs(inertia - body.inertia).max() > 2.0 * SMALLEST_INERTIA:
                self.warnings.append(
                    MODEL.message(
                        f"inertia of '{body.name}' is written with principal moments"
                        f" {moments(inertia)} kg m^2 instead of {moments(body.inertia)}: no rigid"
                        " body has these, and MuJoCo refuses them"
                    )
                )
            if thin is not inertia:
                self.warnings.append(
                    MODEL.message(
                        f"inertia of '{body.name}' is written with principal moments"
                        f" {moments(thin)} kg m^2 instead of {moments(inertia)}: a thin rod has one"
                        " of 0, and MuJoCo wants all above 0"
                    )
                )
        if joint.kind == "free":
            put(element, "freejoint", name=joint.name)
        elif joint.kind == "ball":
            put(element, "joint", name=joint.name, type="ball", pos=text(joint.axes[0].origin))
        else:
            alone = body.mass <= 0.0 and body.name not in self.parents
            self._joints(element, joint, {"armature": text(ARMATURE)} if alone else {})
        for mesh in body.meshes:
            self._mesh(body.name, mesh)

    def _joints(self, element: etree._Element, joint: Joint, more: dict[str, str]) -> None:
        """Write hinges, slides and balls of a joint; `more` are attributes of the first two."""
        axes: list[Axis] = list(joint.axes)
        for kind in joint.kind.split("+"):
            if kind == "weld":
                continue
            axis = axes.pop(0)
            if kind == "ball":
                del axes[:2]
                name = axis.coordinates[0].removesuffix("_rx")
                put(element, "joint", name=name, type="ball", pos=text(axis.origin))
                continue
            coordinate = self.coordinates[axis.coordinates[0]]
            low, high = coordinate.range
            bounded = bool(np.isfinite([low, high]).all() and low < high)
            put(
                element,
                "joint",
                name=coordinate.name,
                type=kind,
                axis=text(axis.vector),
                pos=text(axis.origin),
                ref=text(coordinate.default),
                range=text(coordinate.range if bounded else (0.0, 0.0)),
                limited="true" if bounded and coordinate.clamped else "false",
                **more,
            )

    def _mesh(self, body: str, mesh: Mesh) -> None:
        """Write a shape, or a mesh with its file; a mesh without a surface is left out."""
        if mesh.shape != "mesh":
            put(
                self.elements[body],
                "geom",
                type=mesh.shape,
                size=text(mesh.scale),
                **pose(mesh.pose),
            )
            return
        surface = self.surfaces.get(mesh.file)
        if surface is None or len(surface.vertices) < 4:
            return
        if mesh.file not in self.files:
            stem = Path(mesh.file.replace("\\", "/")).stem
            self.files[mesh.file] = new_name(stem, self.meshes) + ".obj"
            folder = self.path.parent / self.folder
            folder.mkdir(parents=True, exist_ok=True)
            write_obj(surface, folder / self.files[mesh.file])
        name = new_name(Path(self.files[mesh.file]).stem, self.geoms)
        file = self.files[mesh.file]
        put(self.assets, "mesh", name=name, file=file, scale=text(mesh.scale), inertia="shell")
        put(self.elements[body], "geom", type="mesh", mesh=name, **pose(mesh.pose))

    def _surfaces_and_sites(self) -> None:
        """Write the surfaces that muscles wrap around, and markers and frames as sites."""
        used = {wrap.wrap_object for muscle in self.model.muscles for wrap in muscle.path.wraps}
        self.wraps = {}
        for item in self.model.wrap_objects:
            if item.name in used:
                self.wraps[item.name] = self._surface(item)
        self.marker_sites = []
        for marker in self.model.markers:
            name = new_name(marker.name, self.sites)
            self.marker_sites.append(name)
            put(
                self.elements[marker.body],
                "site",
                name=name,
                pos=text(marker.location),
                rgba="0.9 0.3 0.6 1",
            )
        for frame in self.model.frames:
            put(
                self.elements[frame.body],
                "site",
                name=new_name(frame.name, self.sites),
                group=HIDDEN,
                **pose(frame.pose),
            )

    def _surface(self, item: WrapObject) -> str:
        """Write a sphere or cylinder as a geom, and return its name."""
        name = new_name(item.name, self.geoms)
        size = item.size[:1]
        if item.kind != "sphere":
            # A cylinder wraps beyond its ends: its length is only drawn.
            size = (item.size[0], min(0.5 * item.size[1], MAX_HALF_LENGTH))
        put(
            self.elements[item.body],
            "geom",
            name=name,
            type=item.kind,
            size=text(size),
            group=HIDDEN,
            rgba="0.3 0.6 0.9 0.3",
            **pose(item.pose),
        )
        return name

    def _site(self, name: str, body: str, place: ArrayLike, group: str = "3") -> str:
        """Return the name of the site at a position, written where there is none yet.

        Parameters
        ----------
        name : of a new site, numbered where it is taken
        body : that the site is on
        place : (3,) in the body [m]
        group : of a new site

        Returns
        -------
        name of the site
        """
        key = body, tuple(np.asarray(place, dtype=np.float64).tolist())
        if key not in self.placed:
            self.placed[key] = new_name(name, self.sites)
            put(self.elements[body], "site", name=self.placed[key], pos=text(place), group=group)
        return self.placed[key]

    def _muscle(self, muscle: Muscle) -> None:
        """Write a muscle with its tendon; `BadModel` where it is not MuJoCo's."""
        if muscle.kind != "mujoco":
            raise BadModel(f"muscle '{muscle.name}' is a {muscle.kind}, and no muscle of MuJoCo")
        tendon = new_name(f"{muscle.name}_tendon", self.tendons)
        self._tendon(muscle, put(self.tendon, "spatial", name=tendon))
        values = muscle.parameters
        put(
            self.actuator,
            "muscle",
            name=new_name(muscle.name, self.actuators),
            tendon=tendon,
            ctrllimited="true",
            ctrlrange=text((muscle.min_activation, muscle.max_activation)),
            timeconst=text((values["timeconst0"], values["timeconst1"])),
            lengthrange=text((values["lengthrange0"], values["lengthrange1"])),
            range=text((values["range0"], values["range1"])),
            **{key: text(values[key]) for key in MUSCLE_KEYS},
        )

    def _tendon(self, muscle: Muscle, spatial: etree._Element) -> None:
        """Write a muscle's path: points, pulleys before its branches, surfaces behind points.

        Parameters
        ----------
        muscle : its divisors are 0 where a branch ends
        spatial : element of the tendon
        """
        path = muscle.path
        divisors = path.divisors or (1.0,) * (len(path.points) - 1)
        divisor = 1.0
        for index, point in enumerate(path.points):
            next_divisor = next((value for value in divisors[index:] if value), divisor)
            if _begins_branch(index, divisors, next_divisor):
                put(spatial, "pulley", divisor=text(next_divisor))
            elif 0 < index < len(divisors) and divisors[index] not in (0.0, divisor):
                self.warnings.append(
                    MODEL.message(
                        f"muscle '{muscle.name}': a pulley in the middle of its path is left out"
                    )
                )
            divisor = next_divisor
            assert isinstance(point, PathPoint)
            owns_name = point.name.startswith(muscle.name)
            name = point.name if owns_name else f"{muscle.name}-{point.name}"
            put(spatial, "site", site=self._site(name, point.body, point.location))
            for wrap in path.wraps:
                if isinstance(wrap, TendonWrap) and wrap.after == index:
                    self._tendon_wrap(wrap, spatial)

    def _tendon_wrap(self, wrap: TendonWrap, spatial: etree._Element) -> None:
        """Write the surface that a tendon wraps around, with the site on its side."""
        side = {}
        if wrap.side is not None:
            name = f"{wrap.wrap_object}_side"
            side = {"sidesite": self._site(name, wrap.side_body, wrap.side)}
        put(spatial, "geom", geom=self.wraps[wrap.wrap_object], **side)

    def _couplings(self, cams: Sequence[Cam]) -> None:
        """Write couplers as polynomials, locked coordinates, and cams as equal tendons."""
        driven = {cam.follower for cam in cams}
        names = {name for joint in self.model.joints for name in joint.coordinates} - driven
        for coupler in self.model.couplers:
            if coupler.dependent in names:
                self._polynomial(coupler)
        for coordinate in self.model.coordinates:
            if coordinate.locked and coordinate.name in names:
                put(
                    self.equality,
                    "joint",
                    name=f"{coordinate.name}_locked",
                    joint1=coordinate.name,
                    polycoef=text([0.0] * 5),
                )
        for cam in cams:
            self._cam(cam)

    def _cam(self, cam: Cam) -> None:
        """Write a cam as two tendons, and a constraint that keeps them equally long."""
        out = self._cam_tendon(cam, f"{cam.follower}_out", 1.0)
        back = self._cam_tendon(cam, f"{cam.follower}_back", -1.0)
        put(
            self.equality,
            "tendon",
            name=f"{cam.follower}_follows",
            tendon1=out,
            tendon2=back,
            polycoef=text((cam.offset, 1.0, 0.0, 0.0, 0.0)),
        )

    def _cam_tendon(self, cam: Cam, name: str, sign: float) -> str:
        """Write the branches whose weights have a sign as one tendon, and return its name."""
        tendon = new_name(name, self.tendons)
        spatial = put(self.tendon, "spatial", name=tendon, group=HIDDEN, rgba="0 0 0 0")
        site = f"{cam.follower}_cam"
        for branch in cam.branches:
            if branch.weight * sign <= 0.0:
                continue
            put(spatial, "pulley", divisor=text(1.0 / abs(branch.weight)))
            first = self._site(site, branch.body_1, branch.place_1, HIDDEN)
            put(spatial, "site", site=first)
            second = self._site(site, branch.body_2, branch.place_2, HIDDEN)
            put(spatial, "site", site=second)
        return tendon

    def _curves(self, root: etree._Element, cams: Sequence[Cam]) -> None:
        """Write the functions that the cams hold, for readers of the file."""
        custom = put(root, "custom") if cams else root
        joints = {name for joint in self.model.joints for name in joint.coordinates}
        for cam in cams:
            if curve := curve_text(cam.follower, self.model, joints):
                put(custom, "text", name=f"{cam.follower}_follows", data=f"{cam.follower};{curve}")

    def _polynomial(self, coupler: Coupler) -> None:
        """Write a coupler as a polynomial of degree four about the leader's default.

        MuJoCo's joint equality is y - y0 = a0 + a1 (x - x0) + ... + a4 (x - x0)^4 with x0, y0 the
        defaults.
        """
        leader = self.coordinates[coupler.independents[0]]
        dependent = self.coordinates[coupler.dependent]
        function = coupler.function
        assert isinstance(function, PiecewisePolynomial)
        x0 = leader.default
        factorial = 1.0
        coefficients = []
        for order in range(DEGREE + 1):
            factorial *= max(order, 1)
            coefficients.append(float(function(x0, order=order)) / factorial)
        coefficients[0] -= dependent.default
        put(
            self.equality,
            "joint",
            name=coupler.name,
            joint1=dependent.name,
            joint2=leader.name,
            polycoef=text(coefficients),
        )

    def _loop(self, loop: Loop) -> None:
        """Write a loop as an equality of two sites: a weld, or a connect."""
        ends = []
        for body, frame in ((loop.body_1, loop.pose_1), (loop.body_2, loop.pose_2)):
            ends.append(new_name(f"{loop.name}_{body}", self.sites))
            put(self.elements[body], "site", name=ends[-1], group=HIDDEN, **pose(frame))
        tag = "weld" if "weld" in loop.kind.lower() else "connect"
        put(self.equality, tag, name=loop.name, site1=ends[0], site2=ends[1])

    def _motors(self) -> None:
        """Write actuators of coordinates as motors; others are left out with a warning."""
        others = []
        for actuator in self.model.actuators:
            if actuator.kind != "coordinate":
                others.append(actuator.name)
                continue
            bounds = (actuator.min_control, actuator.max_control)
            limited = bool(np.isfinite(bounds).all())
            put(
                self.actuator,
                "motor",
                name=new_name(actuator.name, self.actuators),
                joint=actuator.coordinate,
                gear=text(actuator.optimal_force),
                ctrllimited="true" if limited else "false",
                ctrlrange=text(bounds if limited else (0.0, 0.0)),
            )
        if others:
            self.warnings.append(
                MODEL.message(
                    f"actuators that act on no coordinate are left out: {quoted(others, 3)}"
                )
            )

    def _left_out(self) -> None:
        """Warn of the parts of the model that the document does not have."""
        model = self.model
        viscous = [muscle.name for muscle in model.muscles if muscle.viscosity]
        prescribed = [each.name for each in model.coordinates if each.prescribed is not None]
        parts = {
            "passive torques": [part.name for part in model.passive_torques],
            "bushings": [part.name for part in model.bushings],
            "ligaments": [part.name for part in model.ligaments],
            "viscosities of muscles": viscous,
            "motions that the file prescribes": prescribed,
        }
        for what, names in parts.items():
            if names:
                self.warnings.append(MODEL.message(f"{what} are left out: {quoted(names, 3)}"))
        missing = mesh_files(model) - self.files.keys()
        if missing:
            self.warnings.append(
                MODEL.message(f"{len(missing)} meshes are left out: {quoted(sorted(missing), 3)}")
            )


def _begins_branch(index: int, divisors: Sequence[float], divisor: float) -> bool:
    """Return whether a branch of a tendon with a pulley begins at a point.

    Parameters
    ----------
    index : of the point
    divisors : between each point and the next; 0 between two branches
    divisor : of the branch from the point on
    """
    return divisor != 1.0 if index == 0 else divisors[index - 1] == 0.0


def put(parent: etree._Element, tag: str, **attributes: str) -> etree._Element:
    """Add an element to a parent.

    Parameters
    ----------
    parent : gets the element as its last child
    tag : of the element
    attributes : empty ones are left out

    Returns
    -------
    the new element
    """
    return etree.SubElement(parent, tag, {key: value for key, value in attributes.items() if value})


def pose(frame: Transform) -> dict[str, str]:
    """Write a pose as attributes.

    Parameters
    ----------
    frame : in the parent's frame

    Returns
    -------
    position [m] and quaternion w, x, y, z, as texts
    """
    return {"pos": text(frame.translation), "quat": text(quaternion_from_rotation(frame.rotation))}


def proper_inertia(inertia: ArrayLike) -> np.ndarray:
    """Find the nearest inertia whose principal moments A, B, C keep to A + B >= C.

    Those of every body do.

    Parameters
    ----------
    inertia : (3, 3) about the center of mass [kg m^2]

    Returns
    -------
    (3, 3) [kg m^2], with the same principal axes
    """
    values, axes = np.linalg.eigh(np.asarray(inertia, dtype=np.float64))
    lack = values[2] - values[0] - values[1]
    if lack <= 0.0:
        return np.array(inertia)
    # A little more than needed: rounding would break it again.
    share = lack * (1.0 + 1e-9) / 3.0
    return (axes * (values + share * np.array([1.0, 1.0, -1.0]))) @ axes.T


def with_least_moments(inertia: np.ndarray) -> np.ndarray:
    """Raise principal moments to the least that MuJoCo takes.

    Parameters
    ----------
    inertia : (3, 3) about the center of mass [kg m^2]

    Returns
    -------
    (3, 3) [kg m^2] with the same principal axes; the very same where nothing is raised
    """
    values, axes = np.linalg.eigh(inertia)
    least = SMALLEST_SHARE * values[2]
    if values[0] >= least:
        return inertia
    return np.asarray((axes * np.maximum(values, least)) @ axes.T)


def moments(inertia: ArrayLike) -> str:
    """Write the principal moments of an inertia, the smallest first.

    Parameters
    ----------
    inertia : (3, 3) [kg m^2]
    """
    values = np.linalg.eigvalsh(np.asarray(inertia, dtype=np.float64))
    return ", ".join(f"{value:.3g}" for value in values)
