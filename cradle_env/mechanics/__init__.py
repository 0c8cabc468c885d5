"""Numeric kernels: plain floats and arrays in, plain floats and arrays out; no objects, no validation.

parameters   the records a kernel reads: one per cradle, one per bob
strings      tension with hysteresis (eq. 4)
forces       what acts on one bob in flight (eqs. 3, 5, 6), one guarded line per effect
restitution  the Kuwabara-Kono pair impact as universal curves; e(v)
motion       one Runge-Kutta step of a group of bobs that move together
contact      gaps, impacts of two bobs, impacts of a touching group, persistent contact
start        the state at rest from which a run begins
events       the simulation loop
"""
