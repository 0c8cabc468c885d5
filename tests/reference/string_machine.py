"""A testing machine that pulls a string: its curves, for measurements of strings to be tested on.

Nothing of the package is used. The string is followed sample by sample on a fine path, its state the last reversal
(s*, T*): loading T* + kappa (s − s*), unloading T* (s/s*)^p, slack 0 and forgotten.
"""

import numpy as np

FINE = 40  # steps of the string between two samples


def pull(
    peaks, *, kappa=200.0, low=0.0, exponent=2.0, speed=1e-3, rate=50.0, lead=5e-4, zero=0.0, backlash=0.0, creep=0.0,
    speed_law=0.0, reference=1e-3, stiffening=0.0, noise=5e-3, jitter=0.0, seed=0,
):  # fmt: skip
    """(time [s], displacement [m], force [N]), (T,) each, of cycles up to displacements `peaks` beyond straight [m] and
    down to `low`; lead: slack at the start; zero: of the force; stiffening: 1/m, growth of the slope of loading."""
    corners = [-lead, *np.ravel([[peak, low] for peak in peaks])]
    corners[-1] = -lead if low <= 0.0 else low
    dt, position, path = 1.0 / (rate * FINE), corners[0], [corners[0]]
    for corner in corners[1:]:
        count = max(2, int(abs(corner - position) / (speed * dt)))
        path.extend(np.linspace(position, corner, count + 1)[1:])
        position = corner
    path = np.array(path)
    times = np.arange(len(path)) * dt
    stiffness = kappa * (1.0 + speed_law * np.log(speed / reference))
    held = path[0]  # where the grip is: it follows the screw with play
    force, s_ref, t_ref, loading, before, tension = np.zeros(len(path)), 0.0, 0.0, True, path[0], 0.0
    for i, screw in enumerate(path):
        held = max(held, screw) if screw > before else min(held, screw + backlash)
        before = screw
        s = held - creep * np.log1p(times[i])
        if s <= 0.0:
            s_ref, t_ref, loading, tension, last = 0.0, 0.0, True, 0.0, 0.0
            force[i] = 0.0
            continue
        if i and s != last:
            if (s > last) != loading:
                s_ref, t_ref, loading = last, tension, s > last
            if loading:
                tension = t_ref + stiffness * ((s - s_ref) + 0.5 * stiffening * (s * s - s_ref * s_ref))
            else:
                tension = t_ref * (s / s_ref) ** exponent
        last = s
        force[i] = tension
    rng = np.random.default_rng(seed)
    t, x, f = times[::FINE], path[::FINE], force[::FINE]
    return t, x + jitter * rng.standard_normal(len(x)), f + zero + noise * rng.standard_normal(len(f))


def csv_of(path, t, x, f, unit="mm"):
    """A CSV as a machine writes it."""
    scale = {"mm": 1e3, "m": 1.0}[unit]
    rows = (f"{a!r};{scale * b!r};{c!r}" for a, b, c in zip(t.tolist(), x.tolist(), f.tolist(), strict=True))
    path.write_text("\n".join([f"t [s];displacement [{unit}];force [N]", *rows, ""]), encoding="utf-8")
    return path
