"""Air drag that grows with the square of the speed."""

from cradle_env.effects.declaration import Effect, Parameter, Values


def _apply(cradle, bobs, values: Values) -> None:
    bobs["c2"] = values["c2"]


quadratic_drag = Effect(
    name="quadratic_drag",
    symbol="c₂",
    acts_on="bob",
    summary="drag proportional to |v| v, as at Reynolds numbers of some hundreds",
    equation="F = −c2 |v| v",
    reference="Nelson & Olsson, Am. J. Phys. 54, 112 (1986)",
    energy="takes c2 |v|³",
    looks_like="large swings decay faster than exponentially, small ones slower",
    parameters=(Parameter("c2", "c₂", "kg/m", "force per squared speed", absent=0.0, low=0.0, high=1.0, scale=1e-3),),
    apply=_apply,
)
