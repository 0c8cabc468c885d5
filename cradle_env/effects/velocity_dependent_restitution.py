"""Restitution that falls with the speed of the impact."""

from cradle_env.effects.declaration import Effect

velocity_dependent_restitution = Effect(
    name="velocity_dependent_restitution",
    symbol="e(v)",
    acts_on="contact",
    summary="viscoelastic spheres: e falls slowly with impact speed; k_f, or alpha and n",
    equation="F = k_el ε^{3/2} + k_f ε^{1/2} ε̇,  F ≥ 0;  or e = 1 − α vⁿ",
    reference="Lee & Hong eq. 1; Kuwabara & Kono, Jpn. J. Appl. Phys. 26, 1230 (1987)",
    energy="each impact takes m_eff v² (1 − e²) / 2",
    looks_like="gentle late impacts lose a smaller share than hard early ones",
    apply=lambda cradle, bobs, values: None,  # Cradle itself writes the law: k_f, or alpha and n
)
