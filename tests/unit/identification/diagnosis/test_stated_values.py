"""What a diagnosis says of values that the file states and the data contradict."""

import dataclasses

import pytest

from cradle_env import Cradle
from identification.diagnosis.data_checks.stated_values import warn_of_stated_values
from identification.experiment.experiment import Experiment
from identification.inference.fit_result import FitResult
from identification.inference.least_squares import refine
from identification.inference.likelihood import Likelihood
from tests.synthetic import simulated_run

TRUE = Cradle(bobs=1, b=0.002)


@pytest.mark.parametrize(
    ("stated", "b", "told"),
    [
        (1e-3, 0.002, ()),
        (1.5e-3, 0.002, ()),  # too large by less than a factor of two
        (1.0, 0.002, ("noise is stated as 1.00 rad", "the residuals are 0.00")),  # mrad
        (1e-3, 2.0, ("b is 0.0200 kg/s, at a bound", "0.0200 to 200")),  # g/s
    ],
)
def test_what_the_data_contradict_is_told(stated, b, told):
    run = simulated_run(TRUE, duration=12.0, noise=1e-3)
    likelihood = Likelihood(Experiment(TRUE.replace(b=b), (dataclasses.replace(run, noise=stated),)))
    fitted = FitResult(likelihood, refine(likelihood, likelihood.start(), 30)[0])
    warnings = warn_of_stated_values(fitted)
    assert len(warnings) == bool(told)
    for words in told:
        assert words in warnings[0]
