"""Masses, mass centers and inertias as unknowns of `refine`.

Steps are small changes of pseudo-inertias, so that every link stays some body's, and the whole mass
stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from myomorph.body.identify.pseudo_inertia import tangents
from myomorph.body.refine.kind import Here, Kind, KindSlopes, PriorRows, Setup
from myomorph.body.refine.mass_prior import MassPrior, changed
from myomorph.body.refine.options import MASSES
from myomorph.core.fit.unknowns import Block, Unknown
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.inertia import PARAMETERS, inertia_matrices
from myomorph.core.model.series import Motion
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.regressor import regressor_blocks
from myomorph.core.rigid.tree import TreeArrays

WHOLE_SD = 1e-4  # Of the whole body's mass, of itself: it is known
UNITS = ("kg", *("kg m",) * 3, *("kg m^2",) * 6)
"""Of the ten parameters of a link."""


@dataclass(frozen=True, eq=False)
class MassChart:
    """A step of masses after which every link is still some body's.

    Attributes
    ----------
    masses : with the links that move
    in_units : steps are changes of parameters; else they are scaled triangles of E, see `changed`
    """

    masses: Masses
    in_units: bool

    def __call__(self, values: Array, step: Array) -> Array:
        """Change the parameters of all links.

        Parameters
        ----------
        values, step : (10 bodies,)

        Returns
        -------
        (10 bodies,) with the same whole mass
        """
        parameters = values.reshape(-1, 10)
        links = self.masses.mass_prior.moved
        entries = step.reshape(-1, 10)[links]
        if self.in_units:
            slopes = tangents(parameters[links])
            entries = np.asarray(np.linalg.solve(slopes, entries[:, :, None])[:, :, 0], np.float64)
        return self.masses.changed(parameters, entries).ravel()


@read_only
class Masses(Kind):
    """Inertial parameters of links.

    Attributes
    ----------
    bodies : names
    mass_prior : what is known before anything is measured
    """

    bodies: tuple[str, ...]
    mass_prior: MassPrior

    name = MASSES

    @classmethod
    def of(cls, setup: Setup) -> Masses:
        """Begin with the masses that `identify` finds."""
        return cls(
            bodies=setup.model.body_names,
            mass_prior=MassPrior.of(setup.masses, setup.options.mass_sd),
        )

    def start(self) -> Array:
        """Take the parameters of the prior.

        Returns
        -------
        (bodies, 10)
        """
        return self.mass_prior.reference

    def block(self, values: Array) -> Block:
        """List the parameters, with steps of pseudo-inertias.

        Parameters
        ----------
        values : (bodies, 10) where the search begins

        Returns
        -------
        ten unknowns for each body
        """
        return Block(
            name=MASSES,
            unknowns=self._unknowns(values),
            chart=MassChart(masses=self, in_units=False),
        )

    def block_in_units(self, values: Array) -> Block:
        """List the parameters, with steps in their units.

        Parameters
        ----------
        values : (bodies, 10)

        Returns
        -------
        ten unknowns for each body
        """
        return Block(
            name=MASSES,
            unknowns=self._unknowns(values),
            chart=MassChart(masses=self, in_units=True),
        )

    def _unknowns(self, values: Array) -> tuple[Unknown, ...]:
        """List the parameters (bodies, 10); links without a mass worth changing are fixed."""
        moves = np.zeros(len(values), bool)
        moves[self.mass_prior.moved] = True
        return tuple(
            Unknown(
                name=f"{body} {parameter}",
                unit=UNITS[number],
                where=f"body {body}: inertial parameter {parameter}",
                start=float(values[link, number]),
                fixed=not moves[link],
            )
            for link, body in enumerate(self.bodies)
            for number, parameter in enumerate(PARAMETERS)
        )

    @property
    def columns(self) -> Ints:
        """(steps,) places of the links that move among the parameters of all links."""
        return (10 * self.mass_prior.moved[:, None] + np.arange(10)).ravel()

    def units(self, values: Array) -> Array:
        """Differentiate the parameters of links that move in steps.

        Parameters
        ----------
        values : (bodies, 10)

        Returns
        -------
        (10 links moved, 10 links moved)
        """
        slopes = tangents(values[self.mass_prior.moved])
        return np.asarray(scipy.linalg.block_diag(*slopes), dtype=np.float64)

    def changed(self, values: Array, entries: Array) -> Array:
        """Change the masses of the links that move; the whole mass stays.

        Parameters
        ----------
        values : (bodies, 10) parameters
        entries : (links moved, 10) scaled triangles of E, see `mass_prior.changed`

        Returns
        -------
        (bodies, 10)
        """
        links = self.mass_prior.moved
        parameters = values.copy()
        parameters[links] = changed(parameters[links], entries)
        whole = self.mass_prior.reference[:, 0].sum()
        # A step keeps the whole mass to first order only; what is left would outweigh all that it
        # gains.
        return np.asarray(parameters * (whole / parameters[:, 0].sum()))

    def tree(self, tree: TreeArrays, values: Array) -> TreeArrays:
        """Give the tree these masses.

        Parameters
        ----------
        tree : with the lengths
        values : (bodies, 10) parameters

        Returns
        -------
        its arrays with them
        """
        mass = values[:, 0]
        has_mass = mass[:, None] > 0.0
        center = np.divide(
            values[:, 1:4], mass[:, None], out=np.zeros((len(mass), 3)), where=has_mass
        )
        norms = np.einsum("bi,bi->b", center, center)[:, None, None]
        # I_c = I_o - m (|c|^2 1 - c c^T)
        lever = norms * np.eye(3) - np.einsum("bi,bj->bij", center, center)
        inertia = inertia_matrices(values) - mass[:, None, None] * lever
        return tree._replace(
            mass=np.concatenate([[0.0], mass]),
            mass_center=np.concatenate([np.zeros((1, 3)), center]),
            inertia=np.concatenate([np.zeros((1, 3, 3)), inertia]),
        )

    def slopes(self, here: Here) -> KindSlopes:
        """Differentiate the residual in the steps: the regressor Y, for Y phi is linear in phi.

        Returns
        -------
        (frames, 6, 10 links moved)
        """
        links = self.mass_prior.moved
        data = here.state.data
        rates = here.state.rates
        model = here.problem.skeleton(here.point)
        slopes = tangents(here.point[MASSES][links])
        result = np.zeros((len(data.time), 6, 10 * len(links)))
        motion = Motion(
            time=data.time,
            names=model.coordinate_names,
            values=rates.c.copy(),
            velocities=rates.cdot.copy(),
            accelerations=rates.cddot.copy(),
        )
        for block in regressor_blocks(model, motion):
            by_link = block.rows.reshape(len(block.rows), 6, -1, 10)[:, :, links]
            by_step = np.einsum("fqli,lij->fqlj", by_link, slopes, optimize=True)
            result[block.frames] = by_step.reshape(len(by_link), 6, -1)
        result[~data.use] = 0.0
        return KindSlopes(residual=result)

    def prior_rows(self, values: Array) -> PriorRows:
        """Compare parameters with the prior, and their sum with the whole mass.

        Parameters
        ----------
        values : (bodies, 10)

        Returns
        -------
        misses in standard deviations
        """
        prior = self.mass_prior
        slopes = tangents(values[prior.moved])
        links = len(slopes)
        rows = np.zeros((10 * links + 1, 10 * links))
        for link, block in enumerate(prior.rows @ slopes):
            rows[10 * link : 10 * link + 10, 10 * link : 10 * link + 10] = block
        whole = prior.reference[:, 0].sum()
        whole_sd = WHOLE_SD * whole
        rows[-1] = slopes[:, 0].ravel() / whole_sd
        miss = (values[:, 0].sum() - whole) / whole_sd
        return PriorRows(rows=rows, misses=np.append(prior.misses(values).ravel(), miss))
