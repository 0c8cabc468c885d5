"""One control interval of the environment: release, spacer, motion, sigma, reward, observation."""

import math

from cradle_env.mechanics.contact import place
from cradle_env.mechanics.energy_ledger import book, motion_at
from cradle_env.mechanics.event_loop import DONE, FULL, NO_REST, NOT_FINITE, advance
from cradle_env.mechanics.initial_state import put_lifted
from cradle_env.mechanics.integrator import between, pivot_between
from cradle_env.mechanics.jit import entry, jit
from cradle_env.mechanics.layout import (
    COLUMNS,
    FLOWN,
    SUSTAIN,
    SYNCHRONIZE,
    TENSION,
)
from cradle_env.mechanics.spacer import drive, hold
from cradle_env.mechanics.strings import stretch, tension
from cradle_env.mechanics.unison import asynchrony, have_met, relative_swing, resting_angles, swings

# What a step can end with, beside what a run can.
BAD_ACTION = 10
# An action, and which of the three numbers that say what it means.
_LOW, _SET, _HIGH = 0, 1, 2
# Events so close before the end of an interval [s] are left to the next.
_EDGE = 1e-9
# Before the spacer changes its speed, only what happens earlier than this [s] must be over.
_BEFORE = 1e-13

# Columns of a report behind those that an info shows, and how many there are in all.
REWARD, SYNCHRONIZED, OVER = 15, 16, 17
REPORT = 18


@entry
def step(cradles, bobs, table, S, W, angles, episodes, ring, impacts, report, actions, observations, lo, hi):
    """One control interval of the episodes lo..hi-1; returns the first status that is not DONE.

    cradles (K,) CRADLE; bobs (K, N) BOB; S (K, N, COLUMNS); W and angles (N,): scratch; episodes (K,) EPISODE;
    ring (K, R) rad: the lifted bob's angle over sigma's window; impacts (M, 4): those of the last run's interval;
    report (K, REPORT); actions (K, A), taken as -1 or 1 beyond these; observations (K, 4 N + 3).
    """
    worst = DONE
    times, motion = W[0, :0], S[:0]  # the runs take no samples
    for k in range(lo, hi):
        status = _step(
            cradles[k], bobs[k], table, S[k], W, angles, episodes[k], ring[k], actions[k],
            times, motion, impacts, report[k],
        )  # fmt: skip
        episodes[k].status = status
        if status == DONE:
            observe(cradles[k], bobs[k], S[k], episodes[k], observations[k])
            judge(cradles[k], bobs[k], S[k], episodes[k], observations[k], angles, report[k])
        elif worst == DONE:
            worst = status
    return worst


@jit
def meaning(meanings, action):
    """The value that an action in [-1, 1] stands for; 0 is the setting."""
    if action < 0.0:
        return meanings[_SET] + action * (meanings[_SET] - meanings[_LOW])
    return meanings[_SET] + action * (meanings[_HIGH] - meanings[_SET])


@jit
def _step(cradle, bobs, table, S, W, angles, episode, ring, action, times, motion, impacts, report):
    for a in range(len(action)):
        if not abs(action[a]) < math.inf:
            return BAD_ACTION
        action[a] = min(max(action[a], -1.0), 1.0)
    target = meaning(episode.delta_range, action[episode.delta_column] if episode.delta_column >= 0 else 0.0)
    if episode.steps < 0:
        angle = meaning(episode.angle_range, action[episode.angle_column] if episode.angle_column >= 0 else 0.0)
        if not let_go(cradle, bobs, S, W, angles, episode, ring, target, angle):
            return NO_REST
    start = episode.steps * episode.interval * cradle.step
    end = (episode.steps + 1) * episode.interval * cradle.step
    rows, count, fastest = 0, 0, 0.0
    S[0, FLOWN] = 0.0
    rate = (target - episode.delta) / (end - start)
    arrives = abs(rate) <= episode.fastest
    if not arrives:
        rate = math.copysign(episode.fastest, rate)
    if rate != episode.rate:
        status, rows, count, fastest = fly(
            cradle, bobs, table, S, W, episode, start - _BEFORE, times, motion, impacts, rows, count, fastest
        )
        if status != DONE:
            return status
        finite, took = drive(cradle, bobs, S, W, start, rate, times, motion, motion)
        if not finite:
            return NOT_FINITE
        episode.rate = rate
        episode.collisions += took

    for j in range(1, episode.samples + 1):
        t = start + (end - start) * (j / episode.samples)
        status, rows, count, fastest = fly(
            cradle, bobs, table, S, W, episode, t - _EDGE, times, motion, impacts, rows, count, fastest
        )
        if status != DONE:
            return status
        if episode.lifted < len(bobs):  # else there is nothing to synchronize with
            sample_sigma(cradle, bobs, S, episode, ring, t)
    episode.delta = target if arrives else episode.delta + rate * (end - start)
    episode.steps += 1

    if rows > 0:
        episode.struck = impacts[rows - 1, 0]
    report[0], report[1], report[2], report[3] = end, episode.delta, episode.angle, episode.sigma
    report[4] = episode.exponents / max(episode.exponent_count, 1)
    report[5], report[6] = count, fastest
    energies(cradle, bobs, S, episode, end, report)
    report[OVER] = end >= episode.duration - _EDGE
    return DONE


@jit
def let_go(cradle, bobs, S, W, angles, episode, ring, delta, angle):
    """Sets the spacer, lifts and releases. Returns whether the bobs can be at rest like that."""
    for i in range(len(bobs)):
        hold(cradle, bobs, i, delta)
        for c in range(COLUMNS):
            S[i, c] = 0.0
    angle = put_lifted(cradle, bobs, episode.lifted, angle, episode.hanging != 0, S, W, angles)
    if math.isnan(angle):
        return False
    episode.angle = angle
    episode.steps, episode.delta, episode.rate = 0, delta, 0.0
    ring[0] = episode.angle
    episode.taken = 1
    episode.highest, episode.highest_at, episode.lowest, episode.lowest_at = episode.angle, 0, episode.angle, 0
    return True


@jit
def fly(cradle, bobs, table, S, W, episode, until, times, motion, impacts, rows, count, fastest):
    """Advances to `until` [s] and books the impacts: (status, rows of `impacts` in use, how many impacts, speed of
    the fastest [m/s]). Where there is no room for all, `impacts` keeps the first of them, but for one per bob."""
    while True:
        status, filled = advance(cradle, bobs, table, S, W, until, times, motion, motion, impacts, rows)
        for row in range(rows, filled):
            count += 1
            fastest = max(fastest, impacts[row, 2])
            episode.collisions += impacts[row, 3]
        rows = filled
        if status != FULL:
            return status, rows, count, fastest
        rows = len(impacts) - len(bobs)


@jit
def lead_angle(cradle, bobs, S, i, t):
    """Angle [rad] of bob i at time t [s]."""
    x, z, _, _ = between(S, i, t)
    if cradle.elastic:
        return math.atan2(x - pivot_between(cradle, bobs[i], S, t)[0], -z)
    return x


@jit
def sample_sigma(cradle, bobs, S, episode, ring, t):
    """Takes the lifted bob's angle at t [s]; sigma and lambda as far as it shows.

    sigma belongs to the middle of the window behind t, the last for which it can be known. It is 1 until the first
    window is full.
    """
    angle = lead_angle(cradle, bobs, S, episode.lead, t)
    now, width = episode.taken, 2 * episode.half_window + 1
    ring[now % width] = angle
    episode.taken = now + 1
    first = max(now - width + 1, 0)
    if angle >= episode.highest:
        episode.highest, episode.highest_at = angle, now
    elif episode.highest_at < first:
        episode.highest = -math.inf
        for s in range(first, now + 1):
            if ring[s % width] >= episode.highest:
                episode.highest, episode.highest_at = ring[s % width], s
    if angle <= episode.lowest:
        episode.lowest, episode.lowest_at = angle, now
    elif episode.lowest_at < first:
        episode.lowest = math.inf
        for s in range(first, now + 1):
            if ring[s % width] <= episode.lowest:
                episode.lowest, episode.lowest_at = ring[s % width], s
    if now < width - 1:
        return
    episode.sigma = abs(episode.highest + episode.lowest) / episode.angle
    middle = t * (now - episode.half_window) / now
    if episode.exponent_from < middle <= episode.exponent_to and episode.sigma > episode.floor:
        episode.exponents -= math.log(episode.sigma) / middle
        episode.exponent_count += 1


@jit
def judge(cradle, bobs, S, episode, seen, angles, report):
    """How far the bobs are from swinging in unison at the end of an interval, what that is worth, and whether it has
    lasted. seen: what `observe` has written; angles (N,): scratch."""
    n, lifted, end, before = len(bobs), episode.lifted, report[0], episode.asynchrony
    relative = 0.0
    if lifted < n:  # else there is nothing to synchronize with
        resting_angles(cradle, bobs, end, angles)
        apart, total = swings(cradle, bobs, seen, angles)
        relative = relative_swing(apart, episode.angle, lifted, n)
        episode.asynchrony = asynchrony(apart, total, lifted, n) if have_met(S) else 1.0
    if episode.asynchrony > episode.synchronized_at:
        episode.low_since = math.inf
    else:
        episode.low_since = min(episode.low_since, end)
    report[SYNCHRONIZED] = end - episode.low_since >= episode.window - _EDGE
    report[13], report[14] = episode.asynchrony, relative
    start = (episode.steps - 1) * episode.interval * cradle.step
    report[REWARD] = reward(episode, before, relative, start, end)


@jit
def reward(episode, before, relative, start, end):
    """The built-in rewards of an interval from start to end [s], as far as the episode lasts, that began with the
    asynchrony `before`; 0 for one that is computed elsewhere."""
    passed = (min(end, episode.duration) - start) / episode.duration
    if episode.reward_kind == SYNCHRONIZE:
        return potential(episode, episode.asynchrony) - potential(episode, before) - passed
    if episode.reward_kind == SUSTAIN and end - episode.struck <= episode.window:
        return passed * min(relative, 1.0)
    return 0.0


@jit
def potential(episode, asynchrony):
    """-ln(asynchrony), between 0 and its value where the episode ends."""
    return -math.log(min(max(asynchrony, episode.synchronized_at), 1.0))


@jit
def energies(cradle, bobs, S, episode, t, report):
    """Writes the energies at t [s] to report[7:13]: kinetic, gravity, strings, drag, collisions, spacer."""
    kinetic, gravity, strings, drag, collisions, spacer = 0.0, 0.0, 0.0, 0.0, episode.collisions, 0.0
    for i in range(len(bobs)):
        held = book(cradle, bobs, S, i, t)
        kinetic += held[0]
        gravity += held[1]
        drag += held[2]
        collisions += held[3]
        strings += held[4]
        spacer += held[6]
    report[7], report[8], report[9], report[10], report[11], report[12] = (
        kinetic, gravity, strings, drag, collisions, spacer,
    )  # fmt: skip


@jit
def observe(cradle, bobs, S, episode, out):
    """Writes what the environment shows: r, theta, dr/dt, dtheta/dt of all bobs, delta, sigma, time since release."""
    n = len(bobs)
    t = max(episode.steps, 0) * episode.interval * cradle.step
    for i in range(n):
        x, z, vx, vz = motion_at(S, i, t)
        r, theta, r_dot, theta_dot = bobs[i].length, x, 0.0, vx
        if cradle.elastic:
            pivot, drive = pivot_between(cradle, bobs[i], S, t)
            x -= pivot
            vx -= drive
            r, theta = math.sqrt(x * x + z * z), math.atan2(x, -z)
            r_dot, theta_dot = (x * vx + z * vz) / r, (x * vz - z * vx) / (r * r)
        out[i] = min(r, episode.largest[0])
        out[n + i] = min(max(theta, -math.pi), math.pi)
        out[2 * n + i] = min(max(r_dot, -episode.largest[1]), episode.largest[1])
        out[3 * n + i] = min(max(theta_dot, -episode.largest[2]), episode.largest[2])
    out[4 * n], out[4 * n + 1], out[4 * n + 2] = episode.delta, min(episode.sigma, 2.0), min(t, episode.duration)


@entry
def begin(cradles, bobs, S, W, angles, episodes, observations, report, k):
    """Holds the bobs of episode k, whose records are set, as they are before the release; and shows them.

    They hang at rest, or are lifted already where the release angle is no action. Returns whether they can.
    """
    delta = episodes[k].delta
    for i in range(bobs.shape[1]):
        hold(cradles[k], bobs[k], i, delta)
        for c in range(COLUMNS):
            S[k, i, c] = 0.0
    angle = meaning(episodes[k].angle_range, 0.0)
    lifted = episodes[k].lifted if episodes[k].angle_column < 0 else 0
    held = put_lifted(cradles[k], bobs[k], lifted, angle, episodes[k].hanging != 0, S[k], W, angles)
    if math.isnan(held):
        return False
    for c in range(report.shape[1]):
        report[k, c] = 0.0
    report[k, 1], report[k, 2], report[k, 3] = episodes[k].delta, held, episodes[k].sigma
    energies(cradles[k], bobs[k], S[k], episodes[k], 0.0, report[k])
    observe(cradles[k], bobs[k], S[k], episodes[k], observations[k])
    return True


@entry
def drawing(cradles, bobs, S, episodes, k, out):
    """Of each bob of episode k, into out (N, 3): x and z in the room [m], and the load of its strings over that at
    rest."""
    t = max(episodes[k].steps, 0) * episodes[k].interval * cradles[k].step
    for i in range(bobs.shape[1]):
        bob = bobs[k, i]
        x, z, vx, vz = motion_at(S[k], i, t)
        out[i, 2] = 1.0
        if cradles[k].elastic:
            r2 = (x - pivot_between(cradles[k], bob, S[k], t)[0]) ** 2 + z * z
            t0, t1, t2 = S[k, i, TENSION], S[k, i, TENSION + 1], S[k, i, TENSION + 2]
            pull = tension(t0, t1, t2, stretch(bob, t, r2))
            out[i, 2] = pull * bob.grip / (bob.mass * cradles[k].gravity)
        x, z, vx, vz = place(cradles[k], bob, t, x, z, vx, vz)
        out[i, 0], out[i, 1] = x, z
        if cradles[k].large_angle == 0:
            out[i, 1] = -bob.length
