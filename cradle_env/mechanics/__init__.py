"""Numeric kernels: plain floats and arrays in, plain floats and arrays out; no objects, no validation.

From the bottom up:

jit          how kernels are compiled and cached
parameters   the records a kernel reads, one per cradle and one per bob; the columns of state and scratch
strings      tension with hysteresis (eq. 4)
forces       what acts on one bob in flight (eqs. 3, 5, 6), one guarded line per effect; outside: forces from outside
restitution  the Kuwabara-Kono pair impact as universal curves; e(v)
contact      gaps, contact forces, the tridiagonal problems of touching bobs
motion       one Runge-Kutta step of a group of bobs that move together, and the flight between as a curve
ledger       where the energy is
flight       the next segment of a group, cut at the first event of a string or a contact
meeting      when two neighbours touch
impact       impacts of two bobs, of a touching group, and contacts that become persistent
start        the state from which a run begins
events       the simulation loop
spacer       the pivots in motion
control      one control interval of the environment
"""
