"""The paper's figures from its equations, and a judgement of its claims: one file for each group of figures."""

from identification.reproduce import (
    bands,
    contacts,
    energy,
    exponent,
    impacts,
    judgements,
    models,
    numbers,
    pairs,
    resonance,
    strings,
)

#: All figures, in the order in which they are made.
FIGURES = (
    impacts.FIGURE,
    models.FIGURES[0],
    strings.FIGURE,
    models.FIGURES[1],
    exponent.FIGURE,
    *judgements.FIGURES,
    bands.FIGURE,
    resonance.FIGURE,
    energy.FIGURE,
    *contacts.FIGURES,
    numbers.FIGURE,
    pairs.FIGURE,
)
