"""What a run gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from cradle_env import display, plotting, run_tables
from cradle_env.cradle import Cradle
from cradle_env.kernel_records import records
from cradle_env.release import InitialState, Release
from cradle_env.synchronization import WINDOW, newton_exponent, newton_exponent_slope, sigma, sigma_slope

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

#: One row per pair of an impact: time [s], pair (i: bobs i and i + 1), approach speed [m/s], energy taken [J]; what
#: contacts take that are followed in time stands in the ledger alone.
IMPACT = np.dtype([("time", "f8"), ("pair", "i8"), ("speed", "f8"), ("loss", "f8")])


@dataclass(frozen=True)
class Energy:
    """Energy ledger of a run [J], arrays of shape (T,), summed over bobs. `total` is constant.

    gravity counts the attraction of bobs too; strings is what the strings hold and have lost, lost_by_strings what of
    it was gone at their last slack; drag counts every force against the motion, impacts what contacts have taken;
    support is what a frame that moves has brought in (less what it has been given).
    """

    kinetic: np.ndarray
    gravity: np.ndarray
    strings: np.ndarray
    lost_by_strings: np.ndarray
    drag: np.ndarray
    impacts: np.ndarray
    support: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """Sum of all that is held and all that was taken, less what came in [J]."""
        return self.kinetic + self.gravity + self.strings + self.drag + self.impacts - self.support


@dataclass(frozen=True)
class Trajectory:
    """A run of N bobs in T samples, as `simulate` returns it.

    Attributes
    ----------
    cradle : Cradle
    release : Release or InitialState
    t : ndarray, shape (T,)
        Times [s].
    theta, theta_dot : ndarray, shape (T, N)
        Angles [rad] and their rates [rad/s], positive towards the last bob.
    r, r_dot : ndarray, shape (T, N)
        Distances from the line through a bob's pivots [m], and their rates [m/s].
    impacts : structured ndarray, shape (M,)
        Rows of `IMPACT`: time [s], pair (i: bobs i and i + 1), approach speed [m/s], energy loss [J].
    ledger : ndarray, shape (T, N, 7), optional
        Energies [J] that `energy` sums up; None if the run kept none.
    d_theta, d_r : mapping of str to ndarray, shape (T, N)
        Derivatives of θ and r by each of the run's `sensitivities`, per its unit; nan from where on they do not exist,
        or are not known: after a graze, after impacts whose order the parameter would decide, where bobs stay in touch.
    d_impact_times : mapping of str to ndarray, shape (M,)
        Those of the instants of the impacts [s per unit].

    Examples
    --------
    >>> from cradle_env import Cradle, Release, simulate
    >>> run = simulate(Cradle(bobs=2), Release(angle=0.1), duration=10.0)
    >>> run.theta.shape, run.sigma().shape, round(run.newton_exponent(), 2)
    ((2401, 2), (2401,), 0.08)
    """

    cradle: Cradle
    release: Release | InitialState
    t: np.ndarray
    theta: np.ndarray
    r: np.ndarray
    theta_dot: np.ndarray
    r_dot: np.ndarray
    impacts: np.ndarray
    ledger: np.ndarray | None = None
    d_theta: Mapping[str, np.ndarray] = field(default_factory=dict)
    d_r: Mapping[str, np.ndarray] = field(default_factory=dict)
    d_impact_times: Mapping[str, np.ndarray] = field(default_factory=dict)

    def lead(self) -> tuple[int, float]:
        """The lifted end bob.

        Returns
        -------
        index : int
            Of the bob, from 0.
        theta0 : float
            Its release angle [rad]; its first peak in a run from an `InitialState`.
        """
        if isinstance(self.release, Release):
            return self.release.lead(self.cradle)
        within = self.t <= self.t[0] + self.cradle.period
        peaks = np.abs(self.theta[within]).max(axis=0)
        end = self.cradle.bobs - 1 if peaks[-1] >= peaks[0] else 0
        return end, float(peaks[end])

    def sigma(self) -> np.ndarray:
        """Synchronization σ(t) of the bobs.

        Returns
        -------
        ndarray, shape (T,)
            nan if the bobs have nothing to synchronize with: one bob, none lifted, or all lifted to the same angle.

        Raises
        ------
        ValueError
            For samples that are not evenly spaced, or too sparse.

        References
        ----------
        Lee & Hong, arXiv:2401.16693, section 4.2; see `cradle_env.sigma`.
        """
        end, theta0 = self.lead()
        return sigma(self.t, self.theta[:, end], theta0 if self._synchronizes() else np.nan, self.cradle.period)

    def _synchronizes(self) -> bool:
        """Whether the bobs have something to synchronize with, see `Release.check_synchronizes`."""
        if not isinstance(self.release, Release):
            return self.cradle.bobs > 1
        try:
            self.release.check_synchronizes(self.cradle)
        except ValueError:
            return False
        return True

    def newton_exponent(self, window: tuple[float, float] = WINDOW) -> float:
        """Newton exponent λ, the rate of synchronization.

        Parameters
        ----------
        window : (float, float)
            Times [s] over which λ is averaged.

        Returns
        -------
        float
            λ [1/s], nan if σ is nan; see `cradle_env.newton_exponent`.
        """
        return float(newton_exponent(self.t, self.sigma(), window))

    @property
    def d_sigma(self) -> dict[str, np.ndarray]:
        """Derivatives of σ, (T,) each, by each of the run's `sensitivities`."""
        end, theta0 = self.lead()
        if not self._synchronizes():
            return {name: np.full(len(self.t), np.nan) for name in self.d_theta}
        return {
            name: sigma_slope(
                self.t, self.theta[:, end], theta0, self.cradle.period, slope[:, end], self._lead_slope(name, end)
            )
            for name, slope in self.d_theta.items()
        }

    @property
    def d_newton_exponent(self) -> dict[str, float]:
        """Derivatives of λ [1/s per unit], over the standard window, by each of the run's `sensitivities`."""
        values = self.sigma()
        return {name: newton_exponent_slope(self.t, values, slope) for name, slope in self.d_sigma.items()}

    def _lead_slope(self, name: str, end: int) -> float:
        """Derivative of θ0 of `lead`."""
        if isinstance(self.release, Release):
            angle = self.release.angles_of(self.cradle)[end]
            return float(np.sign(angle)) if name in ("release_angle", f"release_angle[{end + 1}]") else 0.0
        within = self.t <= self.t[0] + self.cradle.period
        peak = int(np.abs(self.theta[within, end]).argmax())
        return float(np.sign(self.theta[peak, end]) * self.d_theta[name][peak, end])

    def x(self) -> np.ndarray:
        """Horizontal positions of the bobs.

        Returns
        -------
        ndarray, shape (T, N)
            [m] from the middle of the pivots; relative to the frame if that moves.
        """
        along = np.sin(self.theta) if self.cradle.has("large_angle") else self.theta
        return self.cradle.pivots + self.r * along

    def gaps(self) -> np.ndarray:
        """Distances between the surfaces of neighbours.

        Returns
        -------
        ndarray, shape (T, N − 1)
            [m]
        """
        z = -self.r * np.cos(self.theta) if self.cradle.has("large_angle") else np.zeros_like(self.r)
        return np.hypot(np.diff(self.x(), axis=1), np.diff(z, axis=1)) - 2.0 * self.cradle.radius

    def swing_energy(self) -> np.ndarray:
        """Kinetic energy, and potential energy over that of bobs that hang at the same r.

        Returns
        -------
        ndarray, shape (T,)
            [J]

        Raises
        ------
        ValueError
            If the run kept no energy ledger.
        """
        energy, weights = self.energy(), records(self.cradle)[1]["mass"] * self.cradle.gravity
        return energy.kinetic + energy.gravity + self.r @ weights

    def energy(self) -> Energy:
        """The energy ledger.

        Returns
        -------
        Energy
            Arrays of shape (T,) [J]; their `total` is constant.

        Raises
        ------
        ValueError
            If the run kept no energy ledger.

        Examples
        --------
        >>> from cradle_env import Cradle, Release, simulate
        >>> energy = simulate(Cradle(bobs=2), Release(angle=0.1), duration=2.0).energy()
        >>> bool(np.ptp(energy.total) < 1e-6), bool(energy.impacts[-1] > 0.0)
        (True, True)
        """
        if self.ledger is None:
            raise ValueError("this run kept no energy ledger; simulate with ledger=True")
        kinetic, gravity, drag, contacts, strings, lost, support = self.ledger.sum(axis=1).T
        order = np.argsort(self.impacts["time"], kind="stable")
        times = self.impacts["time"][order]
        taken = np.concatenate([[0.0], np.cumsum(self.impacts["loss"][order])])
        return Energy(
            kinetic=kinetic,
            gravity=gravity,
            strings=strings,
            lost_by_strings=lost,
            drag=drag,
            impacts=taken[np.searchsorted(times, self.t, side="right")] + contacts,
            support=support,
        )

    def plot(self) -> Figure:
        """A Matplotlib figure of the run: θ(t) of each bob, first and last swings, σ(t) with exp(−λt), the energy.

        The figure belongs to no window: a notebook shows it, `figure.savefig("run.png")` writes it.
        """
        return plotting.run_figure(self)

    def to_xarray(self) -> xarray.Dataset:
        """The run as an xarray Dataset; every variable states its unit in `attrs["units"]`.

        Dimensions time (T) and bob (N, numbered from 1): theta, r, theta_dot, r_dot (time, bob), sigma (time), nan
        where the samples do not define σ. Dimension impact (M): impact_time, impact_pair, impact_speed, impact_loss,
        see IMPACT. `Dataset.attrs` names the cradle and the release.

        >>> run.to_xarray().theta.sel(bob=5).plot()  # doctest: +SKIP
        """
        return run_tables.dataset(self)

    def to_dataframe(self) -> pandas.DataFrame:
        """The run as a pandas DataFrame: one row per sample, index "t [s]".

        Columns, of each bob i: "theta_i [rad]", "r_i [m]", "theta_dot_i [rad/s]", "r_dot_i [m/s]"; and "sigma", nan
        where the samples do not define σ. The impacts are `pandas.DataFrame(run.impacts)`.
        """
        return run_tables.dataframe(self)

    def __repr__(self) -> str:
        times = f"t={self.t[0]:g} to {self.t[-1]:g} s in {len(self.t)} samples"
        parts = [f"bobs={self.cradle.bobs}", times, f"impacts={len(self.impacts)}"]
        released = self.release if isinstance(self.release, Release) else type(self.release).__name__
        return display.summary_line("Trajectory", [*parts, f"release={released}"])

    def _repr_html_(self) -> str:
        rows = [
            ("cradle", repr(self.cradle)),
            ("release", repr(self.release) if isinstance(self.release, Release) else "an initial state"),
            ("time", f"{self.t[0]:g} to {self.t[-1]:g} s, {len(self.t)} samples"),
            ("impacts", str(len(self.impacts))),
        ]
        description = "First and last swings of the bobs, and σ(t)"
        return display.table("Trajectory", rows) + display.picture(plotting.small_figure(self), description)
