"""One eighth-order step of a bob that moves alone; local variables make it 4 times as fast as loops.

Written by `python -m cradle_env.mechanics.write_one_bob_step`; edit that instead.
"""

from cradle_env.mechanics.forces import pivot_at, rates
from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.layout import BROUGHT, CONTACT_LOSS, DRAG, OUT, RATE0, START, T0, TENSION


@jit
def step_one_bob(cradle, bobs, S, W, i, h):
    """Advances bob i by h [s] from the start of its segment, into W[:, OUT]."""
    bob = bobs[i]
    drive = bob.drive
    t0, t1, t2 = S[i, TENSION], S[i, TENSION + 1], S[i, TENSION + 2]  # memory of the strings
    x0, z0, vx0, vz0 = S[i, START], S[i, START + 1], S[i, START + 2], S[i, START + 3]

    # Stage 0. Rates of stage k: uk, wk of the coordinates, axk, azk of the velocities, pk of the energy lost to drag,
    # qk of the energy that a moving pivot brings in.
    u0, w0, ax0, az0 = S[i, RATE0], S[i, RATE0 + 1], S[i, RATE0 + 2], S[i, RATE0 + 3]
    p0, q0 = S[i, RATE0 + DRAG], S[i, RATE0 + BROUGHT]

    # Stage 1
    t = S[i, T0] + 0.05260015195876773 * h
    c0 = 0.05260015195876773
    x = x0 + h * (c0 * u0)
    z = z0 + h * (c0 * w0)
    u1 = vx0 + h * (c0 * ax0)
    w1 = vz0 + h * (c0 * az0)
    ax1, az1, _, _ = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u1, w1)

    # Stage 2
    t = S[i, T0] + 0.0789002279381516 * h
    c0 = 0.0197250569845379
    c1 = 0.0591751709536137
    x = x0 + h * (c0 * u0 + c1 * u1)
    z = z0 + h * (c0 * w0 + c1 * w1)
    u2 = vx0 + h * (c0 * ax0 + c1 * ax1)
    w2 = vz0 + h * (c0 * az0 + c1 * az1)
    ax2, az2, _, _ = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u2, w2)

    # Stage 3
    t = S[i, T0] + 0.1183503419072274 * h
    c0 = 0.02958758547680685
    c2 = 0.08876275643042054
    x = x0 + h * (c0 * u0 + c2 * u2)
    z = z0 + h * (c0 * w0 + c2 * w2)
    u3 = vx0 + h * (c0 * ax0 + c2 * ax2)
    w3 = vz0 + h * (c0 * az0 + c2 * az2)
    ax3, az3, _, _ = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u3, w3)

    # Stage 4
    t = S[i, T0] + 0.2816496580927726 * h
    c0 = 0.2413651341592667
    c2 = -0.8845494793282861
    c3 = 0.924834003261792
    x = x0 + h * (c0 * u0 + c2 * u2 + c3 * u3)
    z = z0 + h * (c0 * w0 + c2 * w2 + c3 * w3)
    u4 = vx0 + h * (c0 * ax0 + c2 * ax2 + c3 * ax3)
    w4 = vz0 + h * (c0 * az0 + c2 * az2 + c3 * az3)
    ax4, az4, _, _ = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u4, w4)

    # Stage 5
    t = S[i, T0] + 0.3333333333333333 * h
    c0 = 0.037037037037037035
    c3 = 0.17082860872947386
    c4 = 0.12546768756682242
    x = x0 + h * (c0 * u0 + c3 * u3 + c4 * u4)
    z = z0 + h * (c0 * w0 + c3 * w3 + c4 * w4)
    u5 = vx0 + h * (c0 * ax0 + c3 * ax3 + c4 * ax4)
    w5 = vz0 + h * (c0 * az0 + c3 * az3 + c4 * az4)
    ax5, az5, p5, pull = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u5, w5)
    q5 = -drive * pull

    # Stage 6
    t = S[i, T0] + 0.25 * h
    c0 = 0.037109375
    c3 = 0.17025221101954405
    c4 = 0.06021653898045596
    c5 = -0.017578125
    x = x0 + h * (c0 * u0 + c3 * u3 + c4 * u4 + c5 * u5)
    z = z0 + h * (c0 * w0 + c3 * w3 + c4 * w4 + c5 * w5)
    u6 = vx0 + h * (c0 * ax0 + c3 * ax3 + c4 * ax4 + c5 * ax5)
    w6 = vz0 + h * (c0 * az0 + c3 * az3 + c4 * az4 + c5 * az5)
    ax6, az6, p6, pull = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u6, w6)
    q6 = -drive * pull

    # Stage 7
    t = S[i, T0] + 0.3076923076923077 * h
    c0 = 0.03709200011850479
    c3 = 0.17038392571223998
    c4 = 0.10726203044637328
    c5 = -0.015319437748624402
    c6 = 0.008273789163814023
    x = x0 + h * (c0 * u0 + c3 * u3 + c4 * u4 + c5 * u5 + c6 * u6)
    z = z0 + h * (c0 * w0 + c3 * w3 + c4 * w4 + c5 * w5 + c6 * w6)
    u7 = vx0 + h * (c0 * ax0 + c3 * ax3 + c4 * ax4 + c5 * ax5 + c6 * ax6)
    w7 = vz0 + h * (c0 * az0 + c3 * az3 + c4 * az4 + c5 * az5 + c6 * az6)
    ax7, az7, p7, pull = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u7, w7)
    q7 = -drive * pull

    # Stage 8
    t = S[i, T0] + 0.6512820512820513 * h
    c0 = 0.6241109587160757
    c3 = -3.3608926294469414
    c4 = -0.868219346841726
    c5 = 27.59209969944671
    c6 = 20.154067550477894
    c7 = -43.48988418106996
    x = x0 + h * (c0 * u0 + c3 * u3 + c4 * u4 + c5 * u5 + c6 * u6 + c7 * u7)
    z = z0 + h * (c0 * w0 + c3 * w3 + c4 * w4 + c5 * w5 + c6 * w6 + c7 * w7)
    u8 = vx0 + h * (c0 * ax0 + c3 * ax3 + c4 * ax4 + c5 * ax5 + c6 * ax6 + c7 * ax7)
    w8 = vz0 + h * (c0 * az0 + c3 * az3 + c4 * az4 + c5 * az5 + c6 * az6 + c7 * az7)
    ax8, az8, p8, pull = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u8, w8)
    q8 = -drive * pull

    # Stage 9
    t = S[i, T0] + 0.6 * h
    c0 = 0.47766253643826434
    c3 = -2.4881146199716677
    c4 = -0.590290826836843
    c5 = 21.230051448181193
    c6 = 15.279233632882423
    c7 = -33.28821096898486
    c8 = -0.020331201708508627
    x = x0 + h * (c0 * u0 + c3 * u3 + c4 * u4 + c5 * u5 + c6 * u6 + c7 * u7 + c8 * u8)
    z = z0 + h * (c0 * w0 + c3 * w3 + c4 * w4 + c5 * w5 + c6 * w6 + c7 * w7 + c8 * w8)
    u9 = vx0 + h * (c0 * ax0 + c3 * ax3 + c4 * ax4 + c5 * ax5 + c6 * ax6 + c7 * ax7 + c8 * ax8)
    w9 = vz0 + h * (c0 * az0 + c3 * az3 + c4 * az4 + c5 * az5 + c6 * az6 + c7 * az7 + c8 * az8)
    ax9, az9, p9, pull = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u9, w9)
    q9 = -drive * pull

    # Stage 10
    t = S[i, T0] + 0.8571428571428571 * h
    c0 = -0.9371424300859873
    c3 = 5.186372428844064
    c4 = 1.0914373489967295
    c5 = -8.149787010746927
    c6 = -18.52006565999696
    c7 = 22.739487099350505
    c8 = 2.4936055526796523
    c9 = -3.0467644718982196
    x = x0 + h * (c0 * u0 + c3 * u3 + c4 * u4 + c5 * u5 + c6 * u6 + c7 * u7 + c8 * u8 + c9 * u9)
    z = z0 + h * (c0 * w0 + c3 * w3 + c4 * w4 + c5 * w5 + c6 * w6 + c7 * w7 + c8 * w8 + c9 * w9)
    u10 = vx0 + h * (c0 * ax0 + c3 * ax3 + c4 * ax4 + c5 * ax5 + c6 * ax6 + c7 * ax7 + c8 * ax8 + c9 * ax9)
    w10 = vz0 + h * (c0 * az0 + c3 * az3 + c4 * az4 + c5 * az5 + c6 * az6 + c7 * az7 + c8 * az8 + c9 * az9)
    ax10, az10, p10, pull = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u10, w10)
    q10 = -drive * pull

    # Stage 11
    t = S[i, T0] + 1.0 * h
    c0 = 2.273310147516538
    c3 = -10.53449546673725
    c4 = -2.0008720582248625
    c5 = -17.9589318631188
    c6 = 27.94888452941996
    c7 = -2.8589982771350235
    c8 = -8.87285693353063
    c9 = 12.360567175794303
    c10 = 0.6433927460157636
    x = x0 + h * (c0 * u0 + c3 * u3 + c4 * u4 + c5 * u5 + c6 * u6 + c7 * u7 + c8 * u8 + c9 * u9 + c10 * u10)
    z = z0 + h * (c0 * w0 + c3 * w3 + c4 * w4 + c5 * w5 + c6 * w6 + c7 * w7 + c8 * w8 + c9 * w9 + c10 * w10)
    u11 = vx0 + h * (c0 * ax0 + c3 * ax3 + c4 * ax4 + c5 * ax5 + c6 * ax6 + c7 * ax7 + c8 * ax8 + c9 * ax9 + c10 * ax10)
    w11 = vz0 + h * (c0 * az0 + c3 * az3 + c4 * az4 + c5 * az5 + c6 * az6 + c7 * az7 + c8 * az8 + c9 * az9 + c10 * az10)
    ax11, az11, p11, pull = rates(cradle, bob, t0, t1, t2, t, pivot_at(bob, t), drive, x, z, u11, w11)
    q11 = -drive * pull

    # Result
    c0 = 0.054293734116568765
    c5 = 4.450312892752409
    c6 = 1.8915178993145003
    c7 = -5.801203960010585
    c8 = 0.3111643669578199
    c9 = -0.1521609496625161
    c10 = 0.20136540080403034
    c11 = 0.04471061572777259
    W[i, OUT] = x0 + h * (c0 * u0 + c5 * u5 + c6 * u6 + c7 * u7 + c8 * u8 + c9 * u9 + c10 * u10 + c11 * u11)
    W[i, OUT + 1] = z0 + h * (c0 * w0 + c5 * w5 + c6 * w6 + c7 * w7 + c8 * w8 + c9 * w9 + c10 * w10 + c11 * w11)
    W[i, OUT + 2] = vx0 + h * (
        c0 * ax0 + c5 * ax5 + c6 * ax6 + c7 * ax7 + c8 * ax8 + c9 * ax9 + c10 * ax10 + c11 * ax11
    )
    W[i, OUT + 3] = vz0 + h * (
        c0 * az0 + c5 * az5 + c6 * az6 + c7 * az7 + c8 * az8 + c9 * az9 + c10 * az10 + c11 * az11
    )
    W[i, OUT + DRAG] = S[i, START + DRAG] + h * (
        c0 * p0 + c5 * p5 + c6 * p6 + c7 * p7 + c8 * p8 + c9 * p9 + c10 * p10 + c11 * p11
    )
    W[i, OUT + BROUGHT] = S[i, START + BROUGHT] + h * (
        c0 * q0 + c5 * q5 + c6 * q6 + c7 * q7 + c8 * q8 + c9 * q9 + c10 * q10 + c11 * q11
    )
    W[i, OUT + CONTACT_LOSS] = S[i, START + CONTACT_LOSS]
