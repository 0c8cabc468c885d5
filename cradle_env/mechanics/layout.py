"""The records that the kernels read, and the arrays that they advance.

A cradle is one record of type CRADLE and an array of N records of type BOB. Everything a bob can have of its
own stands in BOB, so that an effect which singles out bobs needs no kernel of its own. A field that belongs to
an effect is zero where the effect is absent.

The state of a run is one array S (N, COLUMNS), row i for bob i and for the pair i, i + 1; a copy of it is a saved
state, bit for bit. Scratch is a second array W. A block of DIM columns holds a bob's motion y, or dy/dt, and is
addressed as (array, first column).
"""

import numpy as np

# Restitution laws.
KUWABARA_KONO, POWER_LAW, CONSTANT = 0, 1, 2

# Branches of the string tension (eq. 4).
SLACK, LOADING, UNLOADING = 0.0, 1.0, 2.0

# Whole numbers that kernels are called with are typed: numba compiles a kernel anew for every literal.
_INT = np.int64

# What ends a segment of flight: the grid of steps, a string that turns (stretch extreme) or whose tension comes or
# goes (stretch zero), a persistent contact that stops pressing, a resolved contact that parts.
GRID, TURN, TAUT, RELEASE, PART = map(_INT, range(5))

# State of a pair of neighbours: apart, in persistent contact, in a contact that is followed in time.
OPEN, PRESSED, RESOLVED = 0.0, 1.0, 2.0

#: How many parameters the forces from outside may have together.
USER = 48
#: How fast the three exponentials of learned_pair fall with the gap, per radius of a bob.
PAIR_DECAYS = (20.0, 4.0, 1.0)

CRADLE = np.dtype(
    [
        ("gravity", "f8"),  # m/s^2
        ("radius", "f8"),  # of a bob, m
        ("large_angle", "i8"),  # 0: linear gravity and impacts along x (eq. 3)
        ("elastic", "i8"),  # 0: rigid strings
        ("hysteretic", "i8"),  # 0: tension follows the loading line both ways
        ("law", "i8"),  # KUWABARA_KONO, POWER_LAW or CONSTANT
        ("k_el", "f8"),  # N/m^(3/2), eq. 1
        ("k_f", "f8"),  # N s/m^(3/2), eq. 1
        ("alpha", "f8"),  # e = 1 - alpha v^n
        ("exponent", "f8"),
        ("restitution", "f8"),  # constant e
        ("contact_scale", "f8"),  # contact_duration; 0: contacts are not followed in time
        ("contact_k_el", "f8"),  # k_el of contacts that are, such that they last so many times as long,
        ("contact_k_f", "f8"),  # and k_f such that e(v) is the same
        ("step", "f8"),  # of the integration grid, s
        ("series", "i8"),  # 1: bobs that touch nothing fly on Taylor series
        ("tolerance", "f8"),  # of a series: error of the motion that it may leave out, in lengths of the strings
        ("contact_step", "f8"),  # in time scales of a contact that is followed in time
        ("coupled", "i8"),  # 1: bobs act on each other at a distance, and move as one group
        ("reach", "f8"),  # the shortest range of what acts between neighbours, by the step factor, m; 0: nothing does
        ("attraction", "f8"),  # bob_attraction: force at touch, N, and its range, m
        ("attraction_range", "f8"),
        ("drag_slope", "f8"),  # group_drag: growth of b per neighbour at touch, and its range, m
        ("drag_range", "f8"),
        ("departure", "f8", (5,)),  # learned_impact: coefficients, and the scale of speeds, m/s
        ("departure_speed", "f8"),  # 0: none
        ("learned_pairs", "i8"),  # 1: learned_pair acts
        ("pair_speed", "f8"),  # its scale of speeds, m/s
        ("frame_mass", "f8"),  # frame_compliance, kg; 0: a rigid frame
        ("frame_stiffness", "f8"),  # N/m
        ("frame_damping", "f8"),  # kg/s
        ("user_force", "i8"),  # address of a compiled force from outside the package, 0: none
    ]
)

BOB = np.dtype(
    [
        ("mass", "f8"),  # kg
        ("added_mass", "f8"),  # inertia without weight, kg
        ("mobility", "f8"),  # 1 / (mass + added_mass)
        ("fall", "f8"),  # acceleration of free fall, m/s^2
        ("pivot", "f8"),  # its x at t = 0, had it always moved as it does now, m
        ("misplaced", "f8"),  # what of it the spacer does not set, m
        ("drive", "f8"),  # its velocity along x, m/s
        ("length", "f8"),  # r0, m
        ("half_spacing", "f8"),  # a, m
        ("string", "f8"),  # length of an unstretched string that has not crept, sqrt(r0^2 + a^2), m
        ("creep", "f8"),  # string_creep, m
        ("grip", "f8"),  # radial force of the four strings per tension of one, 4 r0 / string (eq. 5)
        ("kappa", "f8"),  # loading stiffness of one string, N/m
        ("longest", "f8"),  # segment on a series, 2 / omega of the radial motion, s
        ("b", "f8"),  # linear drag, kg/s
        ("c2", "f8"),  # quadratic_drag, kg/m
        ("tau_c", "f8"),  # pivot_friction, N m
        ("pull", "f8", (3,)),  # learned_pair, of the pair with the next bob: N, for each of PAIR_DECAYS
        ("film", "f8", (3,)),
        ("user", "f8", (USER,)),  # parameters of the force from outside
        ("user_state", "f8", (6,)),  # what passes to and from it
    ]
)

# What an episode's reward is: see control_interval.reward.
SYNCHRONIZE, SUSTAIN, ELSEWHERE = 0, 1, 2

# An episode of the environment: what is set, then what has come of it.
EPISODE = np.dtype(
    [
        ("interval", "i8"),  # integration steps per control interval
        ("samples", "i8"),  # of sigma per control interval
        ("half_window", "i8"),  # of sigma's envelopes, in samples
        ("lead", "i8"),  # the lifted end bob
        ("lifted", "i8"),  # how many are lifted, from the end with the highest number
        ("hanging", "i8"),  # 1: the release starts at the hanging length
        ("delta_column", "i8"),  # of an action, -1: none; likewise the release angle's
        ("angle_column", "i8"),
        ("delta_range", "f8", (3,)),  # what the actions -1, 0 and 1 mean
        ("angle_range", "f8", (3,)),  # rad
        ("fastest", "f8"),  # of delta, 1/s
        ("exponent_from", "f8"),  # lambda's window, s, and its floor of sigma
        ("exponent_to", "f8"),
        ("floor", "f8"),
        ("synchronized_at", "f8"),  # asynchrony
        ("window", "f8"),  # for how long, s
        ("duration", "f8"),  # s
        ("reward_kind", "i8"),  # SYNCHRONIZE, SUSTAIN or ELSEWHERE
        ("largest", "f8", (3,)),  # r [m], dr/dt [m/s], dtheta/dt [rad/s] that an observation shows
        ("steps", "i8"),  # since the release, -1: not yet released
        ("delta", "f8"),
        ("rate", "f8"),  # of delta, 1/s
        ("angle", "f8"),  # of the release, rad
        ("taken", "i8"),  # samples of the lifted bob's angle
        ("highest", "f8"),  # of them within the window, rad, and which; likewise the lowest
        ("highest_at", "i8"),
        ("lowest", "f8"),
        ("lowest_at", "i8"),
        ("sigma", "f8"),
        ("asynchrony", "f8"),
        ("low_since", "f8"),  # when it came to synchronized_at or below, s; inf: it is above
        ("struck", "f8"),  # the last impact, s
        ("exponents", "f8"),  # sum of -ln(sigma) / t, and of how many
        ("exponent_count", "i8"),
        ("collisions", "f8"),  # energy taken by impacts, J
        ("status", "i8"),
    ]
)

#: Width of a block: two coordinates, two velocities, the energy [J] that drag and the contact with the next bob
#: have taken, that which the pivot's motion has brought in; in row 0 also x and dx/dt of the frame. Elastic strings:
#: (x, z) in the room, z upwards from the pivots. Rigid strings: (theta, 0).
DIM = 9
#: Where in a block the coordinates, the velocities, these three energies and the frame stand.
COORDINATES, VELOCITIES, DRAG, CONTACT_LOSS, BROUGHT, FRAME = map(_INT, (0, 2, 4, 5, 6, 7))

# Columns of the state S. Each group of bobs that move together flies on its own segment, from T0 to T1.
T0, T1 = map(_INT, (0, 1))  # s
START, END = map(_INT, (2, 2 + DIM))  # motion at the start and the end of the segment
RATE0, RATE1 = map(_INT, (2 + 2 * DIM, 2 + 3 * DIM))  # its derivative there
BRANCH, TENSION = 38, 39  # of the strings; their tension [N] as the coefficients of 1, s, s^2, stretch s [m]
WORK, LOST = 42, 43  # energy given to the strings [J]; what of it they had lost at the last slack
FIRST, LAST = 44, 45  # the group: its first bob, and one past its last
DUE, WHOSE = 46, 47  # what ends the segment, and for which bob or pair
LINK, MEETING = 48, 49  # of pair i, i + 1: its state; the instant at which it will touch [s], inf: not foreseen
SAMPLED = 50  # samples already taken
STEPS, TURNS, IMPACTS, MULTI_BODY, SETTLED = 51, 52, 53, 54, 55  # how often what happened to this bob or pair
EVENTS, PROGRESS = 56, 57  # of row 0: events since the run last made headway, and when that was [s]
DISSIPATION = 58  # k_f of the contact of pair i while it is followed in time [N s/m^(3/2)]
FLOWN = 59  # of row 0: steps of single bobs since the caller last set it to 0
WORKED = 60  # the radius up to which WORK counts [m], where strings do not creep
# Of pair i, on series: when it was seen last [s], its gap, opening speed and the square of its relative speed.
SEEN, SEEN_GAP, SEEN_OPENING, SEEN_SQUARE = 61, 62, 63, 64

# Taylor series: for each power of time x, z and their velocities in the room, then the work of drag [J].
ORDER = 18  # see docs/explanation/accuracy.md
WORK_OF_DRAG = 4 * (ORDER + 1)
SERIES_WIDTH = WORK_OF_DRAG + 4 * ((ORDER + 4) // 4)
ON_SERIES, SERIES = 65, _INT(66)  # 1: this bob's segment is a series; it
# The segment that follows on a series, where it is laid already: 1; where it ends, and what ends it.
LATER, LATER_T1, LATER_DUE, LATER_END = 66 + SERIES_WIDTH + _INT([0, 1, 2, 3])
LATER_SERIES = LATER_END + DIM
COLUMNS = int(LATER_SERIES) + SERIES_WIDTH

# Columns of the scratch W (N, SCRATCH).
TRIAL, OUT = map(_INT, (0, DIM))  # a stage's motion; where a step arrives
STAGES = _INT(2 * DIM)  # 12 blocks
FORCE = 14 * DIM  # contact force of pair i [N]
WANTED, ACTIVE, SOLUTION, DIAGONAL, UPPER, VALUE = range(FORCE + 1, FORCE + 7)  # of contact.solve_chain
LOSS = FORCE + 7  # what an impact took from pair i [J]
N_X, N_Z = FORCE + 8, FORCE + 9  # unit vector of pair i
CHAIN_D, CHAIN_U = FORCE + 10, FORCE + 11  # diagonal and off-diagonal of a chain's equations, dimensionless
CHAIN = FORCE + 12  # a chain's overlap, its rate, impulse and work; 4 each: now, at a stage, and of 7 stages d/dtau
CANDIDATE = CHAIN + 4 * 9  # 1: this contact may persist; 2: it presses
# Lanes, in row 0 only: see `lanes`; which bob is in each, 1 for the segment after its present one, and the branch.
LANES = _INT(CANDIDATE + 1)
LANE_BOB, LANE_LATER, LANE_BRANCH = LANES + 4 * (21 + ORDER) + _INT([0, 4, 8])
SCRATCH = int(LANE_BRANCH) + 4

# Columns of a row of impacts: time [s], pair from 0, approach speed [m/s], energy taken [J]. Where the caller gives it
# LOGGED columns, also the bobs struck as one, first and one past the last, the state of the pair after, and how each of
# its bobs goes on: motion, branch and tension of its strings.
STRUCK_FIRST, STRUCK_LAST, LEFT_LINK, LEFT = map(_INT, (4, 5, 6, 7))
LEFT_WIDTH = _INT(8)
LOGGED = int(LEFT + 2 * LEFT_WIDTH)
