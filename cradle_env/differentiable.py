"""θ as a function of parameters, with its Jacobian: for optimizers and samplers of other people."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.release import InitialState, Release
from cradle_env.sensitivities import with_parameters
from cradle_env.simulation import simulate

if TYPE_CHECKING:
    import jax


def theta_and_jacobian(
    cradle: Cradle, release: Release | InitialState, times: np.ndarray, values: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Compute θ at some instants, and its derivatives by parameters, from the variational equations.

    The derivatives err by some 1e-5 of the largest.

    Parameters
    ----------
    cradle : Cradle
    release : Release or InitialState
    times : ndarray, shape (T,)
        Instants [s], ascending, not negative.
    values : mapping of str to float
        Values of P parameters, instead of those of cradle and release, by the names that `simulate` takes as
        `sensitivities`.

    Returns
    -------
    theta : ndarray, shape (T, N)
        Angles [rad].
    jacobian : ndarray, shape (T, N, P)
        Derivatives of the angles [rad per unit of the parameter]; nan where they do not exist (`Trajectory.d_theta`).

    Raises
    ------
    ValueError
        For an unknown name, a value out of bounds, and for cradles that have no sensitivities.
    SimulationError
        If the run cannot reach its end.

    Examples
    --------
    >>> import numpy as np
    >>> from cradle_env import Cradle, Release, theta_and_jacobian
    >>> times = np.linspace(0.0, 2.0, 21)
    >>> theta, J = theta_and_jacobian(Cradle(bobs=2), Release(angle=0.2), times, {"k_f": 17e3, "b": 1e-3})
    >>> theta.shape, J.shape
    ((21, 2), (21, 2, 2))
    """
    cradle, release = with_parameters(cradle, release, values)
    run = simulate(cradle, release, times=times, ledger=False, sensitivities=tuple(values))
    return run.theta, np.stack([run.d_theta[name] for name in values], axis=-1)


def jax_theta(
    cradle: Cradle, release: Release | InitialState, times: np.ndarray, names: Sequence[str]
) -> Callable[[jax.Array], jax.Array]:
    """Give θ at some instants as a function that JAX can differentiate, once, and map.

    The simulation runs outside of JAX, as a callback, in double precision. Enable double precision in JAX too
    (`jax.config.update("jax_enable_x64", True)`).

    Parameters
    ----------
    cradle : Cradle
    release : Release or InitialState
    times : ndarray, shape (T,)
        Instants [s], ascending, not negative.
    names : sequence of str
        P parameters, by the names that `simulate` takes as `sensitivities`.

    Returns
    -------
    function
        Of the values of the parameters, an array of shape (P,), that gives θ, an array of shape (T, N) [rad]. In
        reverse and in forward mode its derivatives are those of `theta_and_jacobian`. What that raises, JAX passes on.

    Raises
    ------
    ImportError
        Without JAX.

    Examples
    --------
    >>> import jax, jax.numpy as jnp  # doctest: +SKIP
    >>> jax.config.update("jax_enable_x64", True)  # doctest: +SKIP
    >>> theta = jax_theta(Cradle(bobs=2), Release(angle=0.2), np.linspace(0.0, 2.0, 21), ["k_f"])  # doctest: +SKIP
    >>> jax.grad(lambda p: jnp.sum(theta(p) ** 2))(jnp.array([18e3])).shape  # doctest: +SKIP
    (1,)
    """
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        raise ImportError("JAX is not installed; run `pip install 'newtons-cradle[jax]'`") from None

    shape, names = (len(times), cradle.bobs), tuple(names)

    def values(p: np.ndarray) -> dict[str, float]:
        return dict(zip(names, np.asarray(p, dtype=float).tolist(), strict=True))

    def run(p: np.ndarray) -> np.ndarray:
        changed, start = with_parameters(cradle, release, values(p))
        return simulate(changed, start, times=times, ledger=False).theta.astype(p.dtype)

    def differentiated(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        theta, jacobian = theta_and_jacobian(cradle, release, times, values(p))
        return theta.astype(p.dtype), jacobian.astype(p.dtype)

    @jax.custom_jvp
    def theta(p):
        kind = jax.ShapeDtypeStruct(shape, p.dtype)
        return jax.pure_callback(run, kind, p, vmap_method="sequential")

    @theta.defjvp
    def _(primals, tangents):
        (p,), (dp,) = primals, tangents
        kinds = jax.ShapeDtypeStruct(shape, p.dtype), jax.ShapeDtypeStruct((*shape, len(names)), p.dtype)
        at, jacobian = jax.pure_callback(differentiated, kinds, p, vmap_method="sequential")
        return at, jnp.tensordot(jacobian, dp, axes=1)

    return theta
