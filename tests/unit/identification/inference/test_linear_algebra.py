"""What is inferred hangs on no number of threads."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from identification import Experiment, calibrate, diagnose
from identification.diagnosis.next_experiment.design import design
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.searcher import Searcher
from identification.diagnosis.uncertainty import detection_limits, intervals
from identification.inference.fit_result import with_known_noise
from studies.diagnosis.study import fit_near
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle


def threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.fixture
def experiment(tmp_path):
    recording = record(SoftCradle(1, kappa=190.0, k_f=18000.0, b=0.002), {1: 0.2}, duration=8.0, seed=1)
    return Experiment.load(write_experiment(tmp_path, [recording]))


@pytest.mark.parametrize("infer", [calibrate, diagnose, design])
def test_linear_algebra_runs_on_one_thread_while_something_is_inferred(experiment, infer):
    def progress(*_):
        assert threads() == {1}
        raise InterruptedError

    with threadpool_limits(3, user_api="blas"):
        with pytest.raises(InterruptedError):
            infer(experiment, progress=progress)
        assert threads() == {3}  # and does so no longer afterwards


@pytest.mark.parametrize(
    ("module", "compute"),
    [
        (intervals, intervals.compute_intervals),
        (detection_limits, lambda fitted: detection_limits.compute_detection_limits(fitted, [])),
    ],
)
def test_so_it_does_while_a_report_is_made(experiment, module, compute, monkeypatch):
    def in_threads(*_):
        assert threads() == {1}
        raise InterruptedError

    fitted = fit_near(Searcher(FitCache(None, ""), 0, None), with_known_noise(experiment), {})
    monkeypatch.setattr(module, "in_threads", in_threads)
    with threadpool_limits(3, user_api="blas"), pytest.raises(InterruptedError):
        compute(fitted)
