"""Where the derivatives by a parameter stand in the arrays of `tangents`."""

import numpy as np

# Derivatives of a bob's state by one parameter: x, z, their velocities, the coefficients of its strings' tension.
MEMORY = np.int64(4)
STATES = 7
# Those of what stands in its record: place of the pivot, radial pull of its strings per tension and inertia, drag over
# inertia, a^2, length of a string, fall, kappa, 1 / inertia.
PIVOT, PULL, DAMPING, SPACING2, STRING, FALL, KAPPA, MOBILITY = range(8)
BOB_FIELDS = 8
# Those of what decides an impact: k_f k_el^-0.6, alpha and n of e = 1 - alpha v^n, a constant e, a bob's radius.
STIFFNESS, ALPHA, EXPONENT, RESTITUTION, RADIUS = range(5)
LAW_FIELDS = 5
